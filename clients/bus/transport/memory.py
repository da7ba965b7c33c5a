"""Makes the C library keep freed memory.

By default, glibc returns every block above 128 KiB to the kernel, and gets the next one anew, zeroed and page
by page. That causes hundreds of page faults for each message of 1 MiB, in every process on its way, which
cost more than the transport.
"""

import sys

LARGE_BYTES = 128 << 10
"""Size from which on glibc returns blocks to the kernel."""

_M_TRIM_THRESHOLD = -1
_M_TOP_PAD = -2
_M_MMAP_THRESHOLD = -3
_KEPT_BYTES = 64 << 20

_is_done = False


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
