"""Forks processes from one with all imports: a new one costs milliseconds, and its pid is known at once.

The line is a socket that keeps messages apart. The answer to an order with descriptors is the pid of a new
process, which has these descriptors. The answer to a pid, once the process has ended, is its status. When the
line ends, remaining processes are killed.
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
"""The longest order."""

_DESCRIPTORS = 3
"""The most descriptors of an order."""


def serve(line_number: int, roles: type[R], be: Callable[[R, list[int]], E]) -> E | None:
    """Fork a process for each role received over the line; it calls `be` with the role.

    Returns None in the forking process, once the line has ended; in the others the result of `be`.
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
