"""Forks processes of one that has imported everything: a new one costs milliseconds, and is known at once.

The line is a socket that keeps messages apart. An order with descriptors is answered by the pid of a new
process, which has these descriptors; a pid, once the process has ended, by its status. What lives when the
line ends is killed.
"""

import os
import signal
import socket
from collections.abc import Callable
from typing import TypeVar

import msgspec

R = TypeVar("R")
E = TypeVar("E")

MOST_BYTES = 1 << 17
"""No order is longer."""

_DESCRIPTORS = 3
"""No order has more."""


def serve(line_number: int, roles: type[R], be: Callable[[R, list[int]], E]) -> E | None:
    """Fork a process for each role that comes over the line, which is to `be` that.

    Returns None in the process that forks, once the line has ended; in the others what `be` returns.
    """
    children: set[int] = set()
    decode = msgspec.json.Decoder(roles | int).decode
    with socket.socket(fileno=line_number) as line:
        while True:
            data, descriptors, _, _ = socket.recv_fds(line, MOST_BYTES, _DESCRIPTORS)
            if not data:
                break
            order = decode(data)
            if isinstance(order, int):
                children.discard(order)
                answer = os.waitstatus_to_exitcode(os.waitpid(order, 0)[1])
            else:
                answer = os.fork()
                if not answer:
                    line.close()
                    return be(order, descriptors)
                for descriptor in descriptors:
                    os.close(descriptor)
                children.add(answer)
            line.send(b"%d" % answer)
    for child in children:
        os.kill(child, signal.SIGKILL)
    return None
