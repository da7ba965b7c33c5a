"""multiprocessing.Queue from one process to another, between two separate programs.

multiprocessing only passes a queue to a child process while it spawns the child. So the subscriber, which
makes the queue, acts as if it spawned the publisher. By a UNIX socket it sends the data that a child would
get: the state of the queue, and the descriptors of its pipe. After that, both use the queue as usual: `put`,
and `get`, which blocks.
"""

import multiprocessing
import os
import pickle
import socket
import sys
from multiprocessing import context
from multiprocessing.reduction import ForkingPickler
from typing import Any, cast

from benchmarks.adapters import roles
from benchmarks.work import Work
from benchmarks.worker import Parent, options, run

_DEPTH, _DEPTH_BYTES = 30_000, 32 << 20
_STATE_BYTES = 1 << 16
_given: list[int] = []
"""Descriptors to send with the state. The state names them by their index here."""


class _Given:
    """A descriptor in a pickled state: made when pickling, detached when unpickling."""

    def __init__(self, place: int) -> None:
        self._place = place

    def detach(self) -> int:
        return _given[self._place]


class _Spawning:
    """Replaces the object of a spawned process for multiprocessing."""

    DupFd = _Given

    def duplicate_for_child(self, fd: int) -> int:
        _given.append(fd)
        return len(_given) - 1


def _path() -> str:
    return os.environ["BENCH_FOLDER"] + "/queue.sock"


async def publisher(parent: Parent) -> None:
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(_path())
        state, descriptors, _, _ = socket.recv_fds(connection, _STATE_BYTES, 8)
    _given.extend(descriptors)
    queue: Any = pickle.loads(state)
    queue.cancel_join_thread()
    await roles.publish(parent, options(Work), queue.put)


async def subscriber(parent: Parent) -> None:
    work: Work = options(Work)
    queue: Any = multiprocessing.get_context("spawn").Queue(max(1, min(_DEPTH, _DEPTH_BYTES // work.size)))
    taker = roles.Taker(parent, work)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(_path())
        listener.listen()
        parent.tell("ready")
        connection, _ = listener.accept()
    with connection:
        context.set_spawning_popen(cast(Any, _Spawning()))
        state = ForkingPickler.dumps(queue)
        context.set_spawning_popen(None)
        socket.send_fds(connection, [state], _given)
    roles.take_in_thread(taker, queue.get)
    await taker.finish()


if __name__ == "__main__":
    run({"publisher": publisher, "subscriber": subscriber}[sys.argv[1]])
