"""Checks of descriptors that another process sent. They need no native core: the daemon uses them, too.

Owns the rules that keep another process's segment from harming the process that maps it. Its size can't
change, all its memory is reserved, and no other process can map it writable. The core checks the contents.
"""

import errno
import fcntl
import os

__all__ = ["SEALS", "doorbell_fault", "readers_fault", "ring_fault"]

_GET_SEALS = 1034  # Linux's numbers; the module fcntl has some of them, and only on Linux
_SEAL_NAMES = {2: "SHRINK", 4: "GROW", 16: "FUTURE_WRITE", 1: "SEAL"}
SEALS = sum(_SEAL_NAMES)
"""The seals that a segment must have."""

RING_LEAST_BYTES = 640 + 8 * 16 + 4096
"""Header, index and data of the smallest ring."""
READERS_LEAST_BYTES = 256 + 64
"""Header and one slot."""

_BLOCK_BYTES = 512  # of st_blocks
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


def ring_fault(number: int) -> str:
    """The reason why descriptor `number` can't be a publisher's ring; "" if it can."""
    return _segment_fault(number, RING_LEAST_BYTES)


def readers_fault(number: int) -> str:
    """The reason why descriptor `number` can't be a process's readers' segment; "" if it can."""
    return _segment_fault(number, READERS_LEAST_BYTES)


def doorbell_fault(number: int) -> str:
    """The reason why descriptor `number` can't be a doorbell; "" if it can."""
    try:
        kind = os.readlink(f"/proc/self/fd/{number}")  # noqa: PTH115
        is_blocking = os.get_blocking(number)
    except OSError as error:
        return f"descriptor can't be looked at ({error.strerror})"
    if kind != "anon_inode:[eventfd]":
        return "descriptor is no eventfd"
    return "eventfd would block" if is_blocking else ""


def _segment_fault(number: int, least_bytes: int) -> str:
    try:
        os.get_blocking(number)
        seals = fcntl.fcntl(number, _GET_SEALS)  # before fstat, which a hostile owner of the file can delay
    except OSError as error:
        if error.errno == errno.EINVAL:
            return "descriptor is no memfd"
        return f"descriptor can't be looked at ({error.strerror})"
    try:
        status = os.fstat(number)
        page_bytes = os.fstatvfs(number).f_bsize
    except OSError as error:
        return f"descriptor can't be looked at ({error.strerror})"
    if lacking := [name for seal, name in _SEAL_NAMES.items() if not seals & seal]:
        return f"segment lacks the seals {', '.join(lacking)}"
    if page_bytes != _PAGE_BYTES:
        return "segment is made of huge pages"  # if these run out, an access to the memory raises a signal
    if status.st_size < least_bytes:
        return f"segment has {status.st_size} bytes, the least is {least_bytes}"
    if status.st_blocks * _BLOCK_BYTES < status.st_size:
        return "segment's memory is not reserved"
    return ""
