"""Where the descriptors of many segments stand: out of the way of the program that uses the library.

A process has a descriptor for each ring that it writes, perhaps a thousand. They must not use up what the
program itself may open, nor the numbers below 1024, the only ones that select() knows. So they get numbers
from 1024 on, and beyond the soft limit where the hard limit has room. The soft limit is raised only for that
moment: the program, and the children that inherit its limits, keep the one that they were started with.
"""

import contextlib
import errno
import fcntl
import os
import resource
from collections.abc import Iterator

__all__ = ["OWN", "RESERVE", "check_room", "set_aside"]

RESERVE = 128
"""Descriptors that are left to the program, however much it publishes."""

OWN = 32
"""Left besides: a match may bring the doorbell of another process."""

_SELECT = 1024
"""FD_SETSIZE."""


def check_room() -> None:
    """Raise OSError (EMFILE), saying how many are in use, where one more would be of the reserve."""
    used, limit = _used(), max(resource.getrlimit(resource.RLIMIT_NOFILE))
    if used + OWN + RESERVE >= limit:
        text = f"{used} of {limit} descriptors are in use, the rest is left to the program"
        raise OSError(errno.EMFILE, text)


def set_aside(number: int) -> int:
    """Give descriptor `number`, which is not inherited, a number out of the program's way.

    Returns the new number; the old one where there is none.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    moved = None
    if _used() + RESERVE < soft:
        moved = _moved(number, _SELECT)
    if moved is None and soft < hard:
        with _raised(soft, hard):
            moved = _moved(number, max(soft, _SELECT)) or _moved(number, soft)
    return moved or number


def _used() -> int:
    """Descriptors that this process has open; Linux before 6.2 has to list them."""
    try:
        return os.stat("/proc/self/fd").st_size or len(os.listdir("/proc/self/fd"))  # noqa: PTH116, PTH208
    except OSError:  # no /proc: they are as many as the lowest free number, or more
        probe = os.open("/", os.O_RDONLY | os.O_CLOEXEC)
        os.close(probe)
        return probe


def _moved(number: int, least: int) -> int | None:
    """Its new number, from `least` on; None where none is free within the limit."""
    try:
        moved = fcntl.fcntl(number, fcntl.F_DUPFD_CLOEXEC, least)
    except OSError:
        return None
    os.close(number)
    return moved


@contextlib.contextmanager
def _raised(soft: int, hard: int) -> Iterator[None]:
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    except (OSError, ValueError):  # the system has rules of its own
        yield
        return
    try:
        yield
    finally:
        if resource.getrlimit(resource.RLIMIT_NOFILE) == (hard, hard):  # no other thread has set it meanwhile
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
