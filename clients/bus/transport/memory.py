"""Makes the C library keep freed memory.

By default, glibc returns every block above 128 KiB to the kernel, and also the end of the heap if more than
128 KiB of it are free. It gets the next block from the kernel again, zeroed and page by page. That causes
hundreds of page faults for each message of 1 MiB, in every process on its way, which cost more than the
transport. Two messages of 64 KiB, freed together, are enough for it: busd had 6 page faults for each message
of that size.
"""

import sys

from bus import shm
from bus.base.buffers import zeroed_buffer

LARGE_BYTES = 64 << 10
"""Size of a message from which on glibc returns memory to the kernel."""

_M_TRIM_THRESHOLD = -1
_M_TOP_PAD = -2
_M_MMAP_THRESHOLD = -3
_KEPT_BYTES = 64 << 20

_is_done = False


def room(size: int) -> bytearray | memoryview:
    """A buffer for `size` bytes to be received. Before that, its contents are undefined.

    Python fills a bytearray with zeros first. Without that, busd takes 7 % less CPU time for a message of
    1 MiB, and a longer buffer costs nothing before it is written. It may have pages that the process has
    kept: those of `zeroed_buffer` are new, which costs a page fault for each 4 KiB of each message.
    """
    return shm.native.room(size) if shm.has_core() else zeroed_buffer(size)


def keep_freed_memory() -> None:
    """Allocate blocks of up to 32 MiB from the heap from now on, and keep 64 MiB of it (glibc only).

    A process calls it before its first large message.
    """
    global _is_done
    if _is_done or not sys.platform.startswith("linux"):
        return
    _is_done = True
    import ctypes  # late: few programs need it

    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return
    mallopt(_M_MMAP_THRESHOLD, 32 << 20)  # the largest value that glibc accepts
    mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)
    mallopt(_M_TOP_PAD, 1 << 20)
