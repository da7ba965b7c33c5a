"""The TCP sockets of links after a cable is unplugged: they time out, and block no thread.

zenoh's own settings have two problems:

- zenoh sets SO_LINGER to 10 s. The thread that closes a socket blocks for that time, and accepts and reads
  for no other link. The cable may be back long before (zenoh #2350, tokio #7751).
- A TLS link is only closed when all written bytes have left. So the far side's nodes stay until TCP tries
  again after the cable is back, with pauses that grow.
"""

import os
import socket
import stat
import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

__all__ = ["give_up_in_time", "tcp_sockets"]

_CLOSE_AT_ONCE = struct.pack("ii", 0, 0)  # the system sends remaining data afterwards


def give_up_in_time(silence_ms: int) -> None:
    """Let all TCP sockets of this process close at once, and end if no sent bytes have arrived for
    `silence_ms`.

    Call this when there is a new socket; in any thread.
    """
    for one in tcp_sockets():
        with one, suppress(OSError):  # some systems refuse if it was shut down
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _CLOSE_AT_ONCE)
            if hasattr(socket, "TCP_USER_TIMEOUT"):
                one.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, silence_ms)


def tcp_sockets() -> Iterator[socket.socket]:
    """All TCP sockets of this process, including zenoh's. Each has a new descriptor, which the caller
    closes."""
    for place in Path("/dev/fd").iterdir():
        with suppress(OSError):  # closed in the meantime
            descriptor = int(place.name)
            if not stat.S_ISSOCK(os.fstat(descriptor).st_mode):
                continue
            copy = os.dup(descriptor)
            try:
                found = socket.socket(fileno=copy)
            except OSError:  # another file has got the number
                os.close(copy)
                continue
            if found.type == socket.SOCK_STREAM and found.family in (socket.AF_INET, socket.AF_INET6):
                yield found
            else:
                found.close()
