"""The process at the other end of a UNIX socket, as the kernel says.

Owns SO_PEERCRED, SO_PEERGROUPS, SO_PEERPIDFD, whether a process lives, and the name that a log gives it. Must
not know what a user may do.
"""

import array
import itertools
import os
import select
import socket
import struct
from functools import cache
from pathlib import Path
from typing import Protocol, TypeAlias

import msgspec

__all__ = ["Credentials", "ProcessKey", "lives", "peer_credentials", "process_name", "program_name"]

_UCRED = struct.Struct("=iII")
_LONGEST_NAME = 64
_SO_PEERGROUPS = 59  # Linux's number (4.13 and later); the module socket doesn't have it
_GROUPS_BYTES = 1024  # as much as getsockopt() of Python gives: 256 groups
_SO_PEERPIDFD = 77  # Linux's number (6.5 and later)
_INT = struct.Struct("=i")

ProcessKey: TypeAlias = tuple[str, int]
"""Tells processes apart; equal for two connections of one process if the kernel says so."""

_connections = itertools.count(1)


class _Socket(Protocol):
    """What a socket, asyncio's TransportSocket and uvloop's PseudoSocket have in common here."""

    def getsockopt(self, level: int, option: int, buffer_size: int, /) -> bytes: ...


class Credentials(msgspec.Struct, frozen=True):
    """The process that made the connection, as it was then: its pid may have been given to another since.

    If the system doesn't tell, pid is 0 and uid and gid are -1. A pid is also 0 if the process lives in a pid
    namespace that this one can't see.
    """

    pid: int
    uid: int
    gid: int
    groups: frozenset[int] | None = frozenset()
    """All groups, `gid` included; None if they can't be told, because there are too many."""
    process: ProcessKey = ("pid", 0)
    """The process. If the kernel does not tell which one it is, each connection counts as a process."""


def peer_credentials(peer: _Socket) -> Credentials:
    """The credentials of the process at the other end of a connected UNIX socket.

    Raises OSError for a socket that is not connected.
    """
    if not hasattr(socket, "SO_PEERCRED"):
        return Credentials(pid=0, uid=-1, gid=-1, process=_each_connection())
    pid, uid, gid = _UCRED.unpack(peer.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _UCRED.size))
    process = ("pid", pid) if pid > 0 else _invisible_process(peer)
    return Credentials(pid=pid, uid=uid, gid=gid, groups=_peer_groups(peer, gid), process=process)


def lives(pid: int) -> bool:
    """Whether the process runs, or is stopped; True also if that can't be found out. A zombie does not."""
    try:
        process = os.pidfd_open(pid) if pid > 0 else -1
    except OSError as error:
        return not isinstance(error, ProcessLookupError)
    if process < 0:
        return True
    try:
        ended = select.poll()
        ended.register(process, select.POLLIN)
        return not ended.poll(0)
    finally:
        os.close(process)


def _invisible_process(peer: _Socket) -> ProcessKey:
    """The key of a process that has no pid in this pid namespace.

    A descriptor of the process tells if it is a file of the kernel's pidfs (Linux 6.9 and later): its inode
    number is never used again. Earlier kernels have one inode for all of them.
    """
    try:
        (pidfd,) = _INT.unpack(peer.getsockopt(socket.SOL_SOCKET, _SO_PEERPIDFD, _INT.size))
    except OSError:  # an earlier kernel, no descriptor left, or the process has ended
        return _each_connection()
    try:
        file = os.fstat(pidfd)
        is_shared = file.st_dev == _anonymous_device()
    except OSError:
        return _each_connection()
    finally:
        os.close(pidfd)
    return _each_connection() if is_shared else ("pidfs", file.st_ino)


def _each_connection() -> ProcessKey:
    return "connection", next(_connections)


@cache
def _anonymous_device() -> int:
    """The device of files that share one inode. Raises OSError if no descriptor is left."""
    poll = select.epoll()
    try:
        return os.fstat(poll.fileno()).st_dev
    finally:
        poll.close()


def _peer_groups(peer: _Socket, gid: int) -> frozenset[int] | None:
    groups = array.array("I")  # gid_t
    try:
        groups.frombytes(peer.getsockopt(socket.SOL_SOCKET, _SO_PEERGROUPS, _GROUPS_BYTES))
    except OSError:
        return None
    return frozenset([gid, *groups])


def process_name(pid: int) -> str:
    """A short name for a process, for logs, as program_name makes it; "unknown" if it can't be read."""
    try:
        return program_name(Path(f"/proc/{pid}/cmdline").read_bytes())
    except OSError:
        return "unknown"


def program_name(command_line: bytes) -> str:
    """A name for it: a Python program's script or module, else the program. Printable, at most 64 characters.

    `command_line` has a NUL after each argument, as in proc(5). A process writes what it likes there, so
    the name proves nothing.
    """
    arguments = command_line.decode(errors="replace").removesuffix("\0").split("\0")
    name = _script(arguments) or Path(arguments[0]).name
    return "".join(c if c.isprintable() else "?" for c in name)[:_LONGEST_NAME] or "unknown"


def _script(arguments: list[str]) -> str | None:
    """The script or module that a Python command line runs; None if there is none."""
    if not Path(arguments[0]).name.startswith("python"):
        return None
    rest = iter(arguments[1:])
    for argument in rest:
        if argument == "-m":
            return next(rest, None)
        if argument in ("-W", "-X"):
            next(rest, None)
        elif argument == "-c":
            return None
        elif not argument.startswith("-"):
            return Path(argument).name
    return None
