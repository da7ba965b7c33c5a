"""A player on a terminal: its keys, its line, and the terminal's mode after each kind of end or stop."""

import re
import shlex
import signal
import sys
from pathlib import Path

import pytest

from bus.msg.std_msgs import Int64
from cli import BUS
from conftest import Daemon
from neighbours import wait_until
from playing import Sample, write_bag
from terminals import OwnTerminal


@pytest.fixture
def bag(daemon: Daemon, tmp_path: Path) -> Path:
    return write_bag(tmp_path / "bag", [Sample("/x", at, Int64(data=at)) for at in (0, 1, 2, 3_600_000)])


def play(bag: Path, *options: str) -> OwnTerminal:
    return OwnTerminal(*BUS[1:], "bag", "play", str(bag), *options)


def test_keys_steer_it_and_a_line_shows_where_it_is(bag: Path) -> None:
    with play(bag, "-p", "--progress-bar-update-rate", "20") as terminal:
        before = terminal.mode()
        terminal.read_until("Press SPACE for Pause/Resume\r\n")
        terminal.read_until("Press CURSOR_RIGHT for Play Next Message\r\n")
        terminal.read_until("Press CURSOR_UP for Increase Rate 10%\r\n")
        terminal.read_until("Press CURSOR_DOWN for Decrease Rate 10%\r\n")
        terminal.read_until(re.escape("0.00/3600.00 s [P] rate 1, 0 messages"))
        assert terminal.is_raw()
        terminal.write("\x1b[C")
        terminal.read_until(re.escape(" [P] rate 1, 1 message"))
        terminal.write("\x1b[A\x1b[A\x1b[B")
        terminal.read_until(
            r"\r\x1b\[K\[INFO\] .*Set rate to 1.1\r\n.*Set rate to 1.2\r\n.*Set rate to 1.1\r\n"
        )
        terminal.write(" ")
        terminal.read_until("Resuming play.")
        terminal.read_until(re.escape(" [R] rate 1.1, 3 messages"))
        terminal.write(" ")
        terminal.read_until("Pausing play.")
        terminal.write("\x03")
        assert (terminal.wait(), terminal.mode()) == (-signal.SIGINT, before)


@pytest.mark.parametrize(
    "name",
    ["SIGTERM", "SIGHUP", *(pytest.param(one, marks=pytest.mark.nightly) for one in ("SIGQUIT", "SIGUSR1"))],
)
def test_the_terminal_is_put_back_after_a_signal(bag: Path, name: str) -> None:
    number = getattr(signal, name)
    with play(bag) as terminal:
        terminal.read_until("Playback until")
        assert terminal.is_raw()
        terminal.send_signal(number)
        assert terminal.wait() == -number
        assert not terminal.is_raw()


def test_ctrl_z_and_back(bag: Path) -> None:
    """While the player is stopped, the terminal belongs to the shell."""
    command = [sys.executable, *BUS[1:], "bag", "play", str(bag), "--progress-bar-update-rate", "50"]
    with OwnTerminal("-c", "import os; os.execlp('sh', 'sh', '-i')") as terminal:
        terminal.write(f"{shlex.join(command)}\n")
        terminal.read_until(r"/3600\.00 s \[R\]")
        terminal.write("\x1a")
        terminal.read_until("Stopped")
        assert not terminal.is_raw()
        terminal.write("fg\n")
        terminal.read_until(r"fg[^$]*/3600\.00 s \[R\]")
        wait_until(terminal.is_raw)
        terminal.write(" ")
        terminal.read_until("Pausing play.")
        terminal.write("\x03")
        wait_until(lambda: not terminal.is_raw())


def test_keys_are_left_alone_where_that_is_asked_for(bag: Path) -> None:
    with play(bag, "--disable-keyboard-controls", "--progress-bar-update-rate", "0") as terminal:
        terminal.read_until(
            "Set rate to 1\r\n.*No messages for .*\r\n\\[INFO\\] .*Playback until timestamp: -1\r\n$"
        )
        assert not terminal.is_raw()


def test_begun_in_the_background(bag: Path) -> None:
    """A player in the background leaves the terminal to the shell until it is in the foreground."""
    command = [sys.executable, *BUS[1:], "bag", "play", str(bag), "--progress-bar-update-rate", "50"]
    with OwnTerminal("-c", "import os; os.execlp('sh', 'sh', '-i')") as terminal:
        terminal.write(f"{shlex.join(command)} &\n")
        terminal.read_until("Playback until")
        assert not terminal.is_raw()
        terminal.write("echo between; fg\n")
        terminal.read_until(r"\nbetween\r\n[^$]*/3600\.00 s \[R\]")
        wait_until(terminal.is_raw)
        terminal.write(" ")
        terminal.read_until("Pausing play.")
        terminal.write("\x03")
        wait_until(lambda: not terminal.is_raw())
