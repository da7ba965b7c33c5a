"""Tells the C library to keep memory that was freed.

By default glibc gives every block above 128 KiB back to the kernel, and takes the next one anew, zeroed and
page by page: hundreds of page faults for each message of 1 MiB, in every process that it passes, which
cost more than the transport.
"""

import sys

LARGE_BYTES = 128 << 10
"""From this size on glibc gives blocks back."""

_M_TRIM_THRESHOLD = -1
_M_TOP_PAD = -2
_M_MMAP_THRESHOLD = -3
_KEPT_BYTES = 64 << 20

_is_done = False


def keep_freed_memory() -> None:
    """From now on blocks of up to 32 MiB come from the heap, of which 64 MiB are kept (glibc only).

    A process calls it when it first has to do with large messages.
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
    mallopt(_M_MMAP_THRESHOLD, 32 << 20)  # the largest that glibc takes
    mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)
    mallopt(_M_TOP_PAD, 1 << 20)
