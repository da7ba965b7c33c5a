"""Numbers of the segments' descriptors: busd leaves low numbers to the program that uses the library.

A process has a descriptor for each ring that it writes, perhaps a thousand. These must not use up the
descriptors that the program itself may open, and not the numbers below 1024, because `select()` accepts no
others. So they get numbers from 1024 on, and numbers above the soft limit if the hard limit has room. The
soft limit is raised only for that moment, so the program and its children keep their limit.
"""

import contextlib
import errno
import fcntl
import os
import resource
from collections.abc import Iterator

__all__ = ["OWN", "RESERVE", "check_room", "set_aside"]

RESERVE = 128
"""Descriptors that are always left to the program."""

OWN = 32
"""Descriptors left for the library itself: a match may need the doorbell of another process."""

_SELECT = 1024
"""FD_SETSIZE."""


def check_room() -> None:
    """Raise OSError (EMFILE) if another descriptor would use the reserve. It names the number in use."""
    used, limit = _used(), max(resource.getrlimit(resource.RLIMIT_NOFILE))
    if used + OWN + RESERVE >= limit:
        text = f"{used} of {limit} descriptors are in use, the rest is left to the program"
        raise OSError(errno.EMFILE, text)


def set_aside(number: int) -> int:
    """Move descriptor `number`, which children do not inherit, to a number that the program does not need.

    Returns the new number, or the old one if no other is free.
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
    """The number of open descriptors of this process. Linux before 6.2 must list them."""
    try:
        return os.stat("/proc/self/fd").st_size or len(os.listdir("/proc/self/fd"))  # noqa: PTH116, PTH208
    except OSError:  # no /proc: the lowest free number is a lower bound
        probe = os.open("/", os.O_RDONLY | os.O_CLOEXEC)
        os.close(probe)
        return probe


def _moved(number: int, least: int) -> int | None:
    """Move a descriptor to a number from `least` on.

    Returns that, or None if none is free within the limit.
    """
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
    except (OSError, ValueError):  # another rule of the system forbids it
        yield
        return
    try:
        yield
    finally:
        if resource.getrlimit(resource.RLIMIT_NOFILE) == (hard, hard):  # no other thread has set it meanwhile
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
