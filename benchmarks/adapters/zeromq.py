"""pyzmq, PUB and SUB over ipc, with libzmq's own I/O thread at each end.

The subscriber waits for libzmq's descriptor on uvloop, which is quicker than zmq.asyncio. In a flood the
publisher blocks where the subscriber's queue is full (XPUB_NODROP), so that nothing is lost.
"""

import asyncio
import os
import sys
from pathlib import Path
from typing import Any

import zmq

from benchmarks.adapters import roles
from benchmarks.work import Work
from benchmarks.worker import Parent, options, run

_QUEUE = 10_000


def _address() -> str:
    return f"ipc://{Path(os.environ['BENCH_FOLDER']) / 'zmq.sock'}"


async def publisher(parent: Parent) -> None:
    # XPUB is PUB that is told of subscriptions: so it knows when it reaches the subscriber.
    socket: Any = zmq.Context().socket(zmq.XPUB)
    socket.setsockopt(zmq.SNDHWM, _QUEUE)
    socket.setsockopt(zmq.XPUB_NODROP, 1)
    socket.connect(_address())
    socket.recv()
    send = socket.send
    await roles.publish(parent, options(Work), lambda text: send(text.encode()))


async def subscriber(parent: Parent) -> None:
    taker = roles.Taker(parent, options(Work))
    socket: Any = zmq.Context().socket(zmq.SUB)
    socket.setsockopt(zmq.RCVHWM, _QUEUE)
    socket.setsockopt(zmq.SUBSCRIBE, b"")
    socket.bind(_address())
    receive, take = socket.recv, taker.take

    def drain() -> None:
        try:
            while True:
                take(receive(zmq.NOBLOCK).decode())
        except zmq.Again:
            pass

    asyncio.get_running_loop().add_reader(socket.getsockopt(zmq.FD), drain)
    parent.tell("ready")
    drain()  # its descriptor tells of changes only
    await taker.finish()


if __name__ == "__main__":
    run({"publisher": publisher, "subscriber": subscriber}[sys.argv[1]])
