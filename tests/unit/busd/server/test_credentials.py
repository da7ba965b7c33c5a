"""busd.server.credentials: the peer's identity from the kernel, and its name in a log."""

import errno
import os
import select
import socket
import sys
from pathlib import Path

import pytest

from busd.server.credentials import Credentials, peer_credentials, process_name, program_name
from rows import for_each


def test_credentials_of_a_peer(monkeypatch: pytest.MonkeyPatch) -> None:
    groups = frozenset({os.getegid(), *os.getgroups()})
    mine = Credentials(os.getpid(), os.geteuid(), os.getegid(), groups, ("pid", os.getpid()))
    here, there = socket.socketpair()
    with here, there:
        assert peer_credentials(here) == mine
        monkeypatch.delattr(socket, "SO_PEERCRED")
        first, second = peer_credentials(here), peer_credentials(here)
    assert (first.pid, first.uid, first.gid, first.groups) == (0, -1, -1, frozenset())
    assert first.process != second.process


class Outside(socket.socket):
    """A process of another pid namespace, as the kernel shows it: its pid is 0."""

    def getsockopt(self, level: int, option: int, size: int = 0) -> bytes:  # type: ignore[override]
        answer = super().getsockopt(level, option, size)
        return bytes(4) + answer[4:] if option == socket.SO_PEERCRED else answer


class Earlier(Outside):
    """The same on a kernel without SO_PEERPIDFD."""

    def getsockopt(self, level: int, option: int, size: int = 0) -> bytes:  # type: ignore[override]
        if option == 77:
            raise OSError(errno.ENOPROTOOPT, "Protocol not available")
        return super().getsockopt(level, option, size)


def invisible(kind: type[socket.socket], count: int) -> list[Credentials]:
    """Credentials of connections of this process, as seen from another pid namespace."""
    seen = []
    with kind(socket.AF_UNIX) as listening:
        listening.bind("")
        listening.listen()
        for _ in range(count):
            with kind(socket.AF_UNIX) as client:
                client.connect(listening.getsockname())
                seen.append(peer_credentials(client))
    return seen


def has_process_files() -> bool:
    """True if the kernel has pidfs, which can tell processes without a pid apart."""
    pidfd, poll = os.pidfd_open(os.getpid()), select.epoll()
    try:
        return os.fstat(pidfd).st_dev != os.fstat(poll.fileno()).st_dev
    finally:
        os.close(pidfd)
        poll.close()


class TestAnotherPidNamespace:
    def test_two_connections_of_one_process(self) -> None:
        if not has_process_files():
            pytest.skip("this kernel has no pidfs")
        before = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
        first, second = invisible(Outside, 2)
        assert (first.pid, first.process) == (0, second.process)
        pidfd = os.pidfd_open(os.getpid())
        assert first.process == ("pidfs", os.fstat(pidfd).st_ino)
        os.close(pidfd)
        assert len(os.listdir("/proc/self/fd")) == before  # noqa: PTH208

    @pytest.mark.parametrize("has_option", [True, False])
    def test_on_an_earlier_kernel_each_connection_counts_as_a_process(
        self, has_option: bool, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        pidfd = os.pidfd_open(os.getpid())
        device = os.fstat(pidfd).st_dev  # without pidfs, many files with a single inode have this device
        os.close(pidfd)
        monkeypatch.setattr("busd.server.credentials._anonymous_device", lambda: device)
        before = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
        seen = invisible(Outside if has_option else Earlier, 3)
        assert len({one.process for one in seen}) == 3
        assert len(os.listdir("/proc/self/fd")) == before  # noqa: PTH208


def test_more_groups_than_can_be_told() -> None:
    """busd then assumes no groups. With only some of them, it could miss a rule that denies one of the
    others.
    """

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
