"""Buffers that only use memory for written pages."""

import mmap

__all__ = ["paged_buffer", "zeroed_buffer"]

_QUICKLY_ZEROED_BYTES = 4 << 20


def zeroed_buffer(size: int) -> bytearray | memoryview:
    """Make a writable buffer of `size` zero bytes, in a short time for any size.

    A longer buffer could cost as much as writing it, so it gets its memory page by page; as `paged_buffer`.
    """
    return bytearray(size) if size <= _QUICKLY_ZEROED_BYTES else paged_buffer(size)


def paged_buffer(size: int) -> memoryview:
    """Make a writable buffer of `size` zero bytes, for several pages of which usually only the first are
    used.

    The system adds a page of memory at the first write to it. A bytearray would take all the memory at once,
    to fill it with zeros. When the buffer's last view is dropped, the memory is freed. A child process after
    `fork` has its own copy.

    Raises MemoryError if the system has no room for it.
    """
    # Not `BytesIO(bytes(size)).getbuffer()`, which has the same effect: CPython 3.12.0 and 3.12.1 crash when
    # the garbage collector meets such a view (gh-111049).
    try:
        return memoryview(mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS))
    except OSError as error:  # callers with sockets would confuse it with a socket's error
        raise MemoryError(f"{size} bytes for a buffer: {error.strerror}") from error
