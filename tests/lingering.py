"""A TCP socket whose last `close()` blocks for an hour."""

import contextlib
import socket
import struct
from collections.abc import Iterator

from bus.base.descriptor import Descriptor

_HOUR_S = 3600


@contextlib.contextmanager
def lingering_socket() -> Iterator[Descriptor]:
    """A connected socket with SO_LINGER and unread bytes; the caller may close it."""
    with socket.socket() as listening:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        with socket.create_connection(listening.getsockname()) as made, listening.accept()[0]:
            made.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                while True:
                    made.send(bytes(1 << 16))
            made.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, _HOUR_S))
            yield Descriptor(made.detach())
