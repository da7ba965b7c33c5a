"""Buffers that take memory only for the pages that were written."""

import mmap

__all__ = ["paged_buffer"]


def paged_buffer(size: int) -> memoryview:
    """A writable buffer of `size` zero bytes, for a size of several pages of which mostly the first are used.

    The system adds a page of memory when something is written there; a bytearray would take all of it at
    once, to fill it with zeros. Dropping the buffer's last view frees the memory. A child process after
    `fork` has its own copy.

    Raises MemoryError if the system has no room for it.
    """
    # Not `BytesIO(bytes(size)).getbuffer()`, which has the same effect: CPython 3.12.0 and 3.12.1 crash when
    # the garbage collector meets such a view (gh-111049).
    try:
        return memoryview(mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS))
    except OSError as error:  # callers that work with sockets would take it for a socket's error
        raise MemoryError(f"{size} bytes for a buffer: {error.strerror}") from error
