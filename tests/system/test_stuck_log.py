"""A busd whose stderr is not read still serves its peers, and later reports the number of dropped lines."""

import fcntl
import os
import pty
import re
import select
import socket
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from busd.process.logs import _MOST_WAITING
from conftest import WAIT_S
from neighbours import wait_until
from raw_peer import RawPeer

IN_A_TERMINAL = """
import fcntl, os, subprocess, sys, termios
terminal = int(sys.argv[1])
fcntl.ioctl(terminal, termios.TIOCSCTTY, 0)
settings = termios.tcgetattr(terminal)
settings[3] |= termios.TOSTOP
termios.tcsetattr(terminal, termios.TCSANOW, settings)
busd = subprocess.Popen([sys.executable, "-m", "busd", *sys.argv[2:]], stderr=terminal, process_group=0)
print(busd.pid, flush=True)
sys.stdin.read()
busd.kill()
busd.wait()
"""
"""Runs busd in the background of a terminal, as a shell does after `stty tostop`."""
LEFT_OUT = re.compile(rb"\((\d+) lines were left out\)")


class Ends:
    """The end to which busd writes, and the end for reading that. Stuck until `release`."""

    def __init__(self, kind: str) -> None:
        self._is_terminal = kind == "terminal"
        self.ours, self.theirs = pty.openpty() if self._is_terminal else os.pipe()
        if self._is_terminal:
            termios.tcflow(self.theirs, termios.TCOOFF)
        else:
            os.write(self.theirs, bytes(fcntl.fcntl(self.theirs, fcntl.F_GETPIPE_SZ)))

    def release(self) -> None:
        if self._is_terminal:
            termios.tcflow(self.theirs, termios.TCOON)

    def read_until(self, is_enough: Callable[[bytes], bool]) -> bytes:
        said, end = b"", time.monotonic() + WAIT_S
        while not is_enough(said):
            assert select.select([self.ours], [], [], end - time.monotonic())[0], said[-1000:]
            said += os.read(self.ours, 1 << 16)
        return said

    def close(self) -> None:
        for fd in (self.ours, self.theirs):
            os.close(fd)


@pytest.fixture(params=["pipe", "terminal"])
def ends(request: pytest.FixtureRequest) -> Iterator[Ends]:
    made = Ends(request.param)
    yield made
    made.close()


@pytest.fixture
def start(socket_path: Path) -> Iterator[Callable[[int], subprocess.Popen[bytes]]]:
    """Starts a busd with the given stderr; stops it in order at the end."""
    running: list[subprocess.Popen[bytes]] = []

    def start(stderr: int) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "busd", "--socket", str(socket_path), "--log-level", "debug"]
        running.append(subprocess.Popen(command, stderr=stderr))
        wait_until(lambda: can_connect(socket_path))
        return running[-1]

    yield start
    for process in running:
        process.terminate()
        try:
            assert process.wait(WAIT_S) == 0
        finally:
            process.kill()


def can_connect(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX) as probe:
        return probe.connect_ex(str(path)) == 0


def greet(path: Path, number: int) -> None:
    """Connects clients; busd answers each and logs two lines for it."""
    for _ in range(number):
        with RawPeer(path) as peer:
            peer.hello()


def told(said: bytes) -> int:
    """The number of lines, printed or counted; there may be several counts, and lines after the last."""
    lines = said.count(b"connected") + said.count(b"closed its connection")
    return lines + sum(map(int, LEFT_OUT.findall(said)))


def test_who_talks_to_it_does_not_wait(
    ends: Ends, socket_path: Path, start: Callable[[int], subprocess.Popen[bytes]]
) -> None:
    start(ends.theirs)
    greet(socket_path, _MOST_WAITING)
    ends.release()
    said = ends.read_until(lambda said: told(said) >= 2 * _MOST_WAITING)
    assert LEFT_OUT.search(said)
    greet(socket_path, 1)
    ends.read_until(lambda said: b"connected" in said)


def test_its_end_does_not_wait_either(
    ends: Ends, socket_path: Path, start: Callable[[int], subprocess.Popen[bytes]]
) -> None:
    busd = start(ends.theirs)
    greet(socket_path, 10)
    busd.terminate()
    assert busd.wait(WAIT_S) == 0


def test_one_whose_reader_has_gone(
    socket_path: Path, start: Callable[[int], subprocess.Popen[bytes]]
) -> None:
    ours, theirs = os.pipe()
    os.close(ours)
    start(theirs)
    os.close(theirs)
    greet(socket_path, 100)


def test_behind_a_terminal_that_stops_who_writes_to_it(socket_path: Path) -> None:
    ours, theirs = pty.openpty()
    command = [sys.executable, "-c", IN_A_TERMINAL, str(theirs), "--socket", str(socket_path)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, pass_fds=[theirs], start_new_session=True
    ) as shell:
        assert shell.stdout is not None
        pid = int(shell.stdout.readline())
        said = b""
        while b"listening on" not in said:
            assert select.select([ours], [], [], WAIT_S)[0], Path(f"/proc/{pid}/stat").read_text()
            said += os.read(ours, 4096)
        greet(socket_path, 1)
    os.close(ours)
    os.close(theirs)
