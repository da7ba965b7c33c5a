"""bus_cli.doctor.procfs: the kernel's data, read from real processes."""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from bus_cli.doctor import procfs

NOBODY = 2**22 + 1
"""A number above the largest possible pid."""


CODE = "print('ready', flush=True); input()"


@pytest.fixture
def child() -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-c", CODE, "some (odd) name"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == b"ready\n"
        yield child
        child.kill()


def test_states(child: subprocess.Popen[bytes]) -> None:
    assert procfs.state(child.pid) not in ("", "T", "Z")
    child.send_signal(signal.SIGSTOP)
    os.waitid(os.P_PID, child.pid, os.WSTOPPED)
    assert procfs.state(child.pid) == "T"
    child.kill()
    os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)
    assert procfs.state(child.pid) == "Z"
    assert procfs.command_line(child.pid) == []
    child.wait()
    assert procfs.state(child.pid) == ""


def test_what_a_process_is(child: subprocess.Popen[bytes]) -> None:
    assert procfs.command_line(child.pid) == [sys.executable, "-c", CODE, "some (odd) name"]
    program = procfs.executable(child.pid)
    assert program is not None
    assert Path(program).samefile(sys.executable)
    age_s = procfs.age_s(child.pid)
    assert age_s is not None
    assert -1 < age_s < 10_000
    assert child.pid in procfs.pids_of(os.geteuid())
    used, most = procfs.open_files(child.pid) or (0, 0)
    assert 0 < used < most


def test_nobody() -> None:
    assert procfs.state(NOBODY) == ""
    assert procfs.age_s(NOBODY) is None
    assert procfs.command_line(NOBODY) == []
    assert procfs.executable(NOBODY) is None
    assert procfs.open_files(NOBODY) is None
    assert procfs.listens_on(NOBODY, {1: "/x"}) == []


def test_who_listens(tmp_path: Path) -> None:
    path, idle = tmp_path / "with blank.sock", tmp_path / "idle.sock"
    with socket.socket(socket.AF_UNIX) as listening, socket.socket(socket.AF_UNIX) as bound:
        listening.bind(str(path))
        listening.listen(1)
        bound.bind(str(idle))
        sockets = procfs.listening_paths()
        assert str(path) in sockets.values()
        assert str(idle) not in sockets.values()
        assert str(path) in procfs.listens_on(os.getpid(), sockets)
    assert str(path) not in procfs.listening_paths().values()


def test_numbers(tmp_path: Path) -> None:
    file = tmp_path / "numbers"
    file.write_text("7 8 9\nMemAvailable:   123 kB\nText: none\n")
    assert procfs.number_in(str(file)) == 7
    assert procfs.number_in(str(file), "MemAvailable:") == 123
    assert procfs.number_in(str(file), "Missing:") is None
    assert procfs.number_in(str(file), "Text:") is None
    assert procfs.number_in(str(tmp_path / "missing")) is None
