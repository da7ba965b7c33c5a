"""The TCP sockets of links if a cable is out: they give up in time, and block no thread.

zenoh does the contrary. It sets SO_LINGER to 10 s: the thread that closes a socket blocks for so long, and
accepts and reads for no other link meanwhile. The cable may be back long before (zenoh #2350, tokio #7751).
And a link by TLS is not closed before all written bytes have left: the far side's nodes stay until TCP, whose
pauses grow, tries again after the cable is back.
"""

import os
import socket
import stat
import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

__all__ = ["give_up_in_time", "tcp_sockets"]

_CLOSE_AT_ONCE = struct.pack("ii", 0, 0)  # what is still to be sent, the system sends afterwards


def give_up_in_time(silence_ms: int) -> None:
    """Have all TCP sockets of this process close at once, and end if no sent bytes have arrived for so long.
    To be called when there is a new socket; in any thread."""
    for one in tcp_sockets():
        with one, suppress(OSError):  # if it was shut down, some systems refuse
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _CLOSE_AT_ONCE)
            if hasattr(socket, "TCP_USER_TIMEOUT"):
                one.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, silence_ms)


def tcp_sockets() -> Iterator[socket.socket]:
    """All TCP sockets of this process, also those that zenoh opened. Each has a new descriptor, which the
    caller closes."""
    for place in Path("/dev/fd").iterdir():
        with suppress(OSError):  # closed meanwhile
            descriptor = int(place.name)
            if not stat.S_ISSOCK(os.fstat(descriptor).st_mode):
                continue
            copy = os.dup(descriptor)
            try:
                found = socket.socket(fileno=copy)
            except OSError:  # the number is another file's by now
                os.close(copy)
                continue
            if found.type == socket.SOCK_STREAM and found.family in (socket.AF_INET, socket.AF_INET6):
                yield found
            else:
                found.close()
