"""Forks processes of one that has imported everything: a new one costs milliseconds, and is known at once.

The line is a socket that keeps messages apart. An order with a descriptor is answered by the pid of a new
process, which has that descriptor; a pid, once the process has ended, by its status. What lives when the line
ends is killed.
"""

import os
import signal
import socket
from collections.abc import Callable
from typing import NoReturn, TypeVar

import msgspec

R = TypeVar("R")


def serve(line_number: int, roles: type[R], be: Callable[[R, socket.socket], NoReturn]) -> None:
    """Fork a process for each role that comes over the line, which is to `be` that."""
    children: set[int] = set()
    decode = msgspec.json.Decoder(roles | int).decode  # type: ignore[operator]
    with socket.socket(fileno=line_number) as line:
        while True:
            data, descriptors, _, _ = socket.recv_fds(line, 1 << 16, 1)
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
                    be(order, socket.socket(fileno=descriptors[0]))
                os.close(descriptors[0])
                children.add(answer)
            line.send(b"%d" % answer)
    for child in children:
        os.kill(child, signal.SIGKILL)
