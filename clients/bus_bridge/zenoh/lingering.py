"""TCP sockets of this process close at once; what is still to be sent, the system sends afterwards.

zenoh asks for the contrary (SO_LINGER, 10 s). Its thread that closes the socket of a link whose cable is out
stands still for so long, and accepts and reads for no other link meanwhile: the cable may be back long before
(zenoh #2350, tokio #7751).
"""

import os
import socket
import stat
import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

__all__ = ["close_at_once", "tcp_sockets"]

_OFF = struct.pack("ii", 0, 0)


def close_at_once() -> None:
    """Have all TCP sockets of this process do so; to be called when there is a new one. In any thread."""
    for one in tcp_sockets():
        with one, suppress(OSError):  # where it has been shut down, some systems refuse
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _OFF)


def tcp_sockets() -> Iterator[socket.socket]:
    """Those of this process, whoever has opened them: each by a descriptor of its own, to be closed."""
    for place in Path("/dev/fd").iterdir():
        with suppress(OSError):  # closed meanwhile
            descriptor = int(place.name)
            if not stat.S_ISSOCK(os.fstat(descriptor).st_mode):
                continue
            found = socket.socket(fileno=os.dup(descriptor))
            if found.type == socket.SOCK_STREAM and found.family in (socket.AF_INET, socket.AF_INET6):
                yield found
            else:
                found.close()
