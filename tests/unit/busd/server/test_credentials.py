"""busd.server.credentials: who the kernel says is at the other end, and what a log calls him."""

import os
import socket
import sys
from pathlib import Path

import pytest

from busd.server.credentials import Credentials, peer_credentials, process_name, program_name
from rows import for_each


def test_credentials_of_a_peer(monkeypatch: pytest.MonkeyPatch) -> None:
    groups = frozenset({os.getegid(), *os.getgroups()})
    mine = Credentials(os.getpid(), os.geteuid(), os.getegid(), groups)
    here, there = socket.socketpair()
    with here, there:
        assert peer_credentials(here) == mine
        monkeypatch.delattr(socket, "SO_PEERCRED")
        assert peer_credentials(here) == Credentials(pid=0, uid=-1, gid=-1)


def test_more_groups_than_can_be_told() -> None:
    """None, and not a part of them: a rule that denies one of the rest would not be seen to."""

    class Crowded(socket.socket):
        def getsockopt(self, level: int, option: int, size: int = 0) -> bytes:  # type: ignore[override]
            if option == 59:  # SO_PEERGROUPS
                raise OSError(34, "Numerical result out of range")
            return super().getsockopt(level, option, size)

    with Crowded(socket.AF_UNIX) as listening:
        listening.bind("")
        listening.listen()
        with Crowded(socket.AF_UNIX) as client:
            client.connect(listening.getsockname())
            who = peer_credentials(client)
    assert (who.pid, who.groups) == (os.getpid(), None)


def test_a_process_s_name() -> None:
    assert process_name(os.getpid()) == program_name(Path("/proc/self/cmdline").read_bytes())
    assert process_name(2**22 + 1) == "unknown"
    assert program_name(f"{sys.executable}\0".encode()) == Path(sys.executable).name


@for_each(
    ("arguments", "name"),
    [
        (["/usr/bin/busd", "--domain", "1"], "busd"),
        (["python3", "/home/me/talker.py", "-v"], "talker.py"),
        (["/venv/bin/python3.11", "-X", "dev", "-O", "-W", "error", "talker.py"], "talker.py"),
        (["python", "-m", "busd"], "busd"),
        (["python", "-c", "print()"], "python"),
        (["evil\nname\x1b[31m" + "x" * 100], "evil?name?[31m" + "x" * 50),
        (["\ufffd"], "\ufffd"),
        ([""], "unknown"),
    ],
)
def test_program_names(arguments: list[str], name: str) -> None:
    assert program_name("".join(f"{argument}\0" for argument in arguments).encode()) == name
