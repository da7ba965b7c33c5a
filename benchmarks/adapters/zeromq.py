"""pyzmq, PUB and SUB over ipc, with libzmq's own I/O thread at each end.

The subscriber waits for libzmq's descriptor on uvloop, which is faster than zmq.asyncio. With `take_by`
"blocking" it is a plain program that blocks in `recv`. It binds, and the publisher connects to all
subscribers, so no end has to retry. In a flood the publisher blocks while a subscriber's queue is full
(XPUB_NODROP), so no message is lost. Long messages are not copied to or from libzmq (`copy=False`); for short
ones that would be slower.
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

_QUEUE, _QUEUE_BYTES = 10_000, 32 << 20
_LONG = 64 << 10
_NAME = b"#"


def _folder() -> Path:
    return Path(os.environ["BENCH_FOLDER"])


def _addresses() -> list[str]:
    return [f"ipc://{path}" for path in _folder().glob("zmq-*.sock")]


def depth_of(work: Work) -> int:
    """Number of messages in a queue of libzmq, at each end of a connection."""
    return max(2, min(_QUEUE, _QUEUE_BYTES // work.size))


def publishing_socket(work: Work) -> Any:
    """A lossless socket: XPUB is a PUB that learns of subscriptions, so it knows its subscribers."""
    socket = zmq.Context().socket(zmq.XPUB)
    socket.setsockopt(zmq.SNDHWM, depth_of(work))
    socket.setsockopt(zmq.XPUB_NODROP, 1)
    return socket


def subscribing_socket(work: Work) -> Any:
    """A socket that receives everything.

    It subscribes to everything, and to a unique name. A proxy passes on only the first of several equal
    subscriptions, so the publisher counts its subscribers by these names.
    """
    socket = zmq.Context().socket(zmq.SUB)
    socket.setsockopt(zmq.RCVHWM, depth_of(work))
    socket.setsockopt(zmq.SUBSCRIBE, b"")
    socket.setsockopt(zmq.SUBSCRIBE, b"%s%d" % (_NAME, os.getpid()))
    return socket


async def publish(parent: Parent, work: Work, socket: Any) -> None:
    """Run the publisher after `socket` has learned of all subscribers."""
    count = 0
    while count < work.subscribers:
        count += socket.recv().startswith(b"\1" + _NAME)
    send, copy = socket.send, work.size < _LONG
    await roles.publish(parent, work, lambda text: send(text.encode(), copy=copy))


async def subscribe(parent: Parent, work: Work, socket: Any) -> None:
    """Run the subscriber with a bound or connected `socket`."""
    taker = roles.Taker(parent, work)
    receive, take = socket.recv, taker.take
    if work.take_by == "blocking":
        is_short = work.size < _LONG
        roles.take_in_thread(
            taker, lambda: receive().decode() if is_short else str(receive(copy=False).buffer, "utf-8")
        )
        parent.tell("ready")
        await taker.finish()

    def drain() -> None:
        try:
            while True:
                take(receive(zmq.NOBLOCK).decode())
        except zmq.Again:
            pass

    def drain_long() -> None:
        try:
            while True:
                take(str(receive(zmq.NOBLOCK, copy=False).buffer, "utf-8"))
        except zmq.Again:
            pass

    come = drain if work.size < _LONG else drain_long
    asyncio.get_running_loop().add_reader(socket.getsockopt(zmq.FD), come)
    parent.tell("ready")
    come()  # its descriptor only reports changes
    await taker.finish()


async def publisher(parent: Parent) -> None:
    work: Work = options(Work)
    socket = publishing_socket(work)
    for address in _addresses():
        socket.connect(address)
    await publish(parent, work, socket)


async def subscriber(parent: Parent) -> None:
    work: Work = options(Work)
    socket = subscribing_socket(work)
    socket.bind(f"ipc://{_folder()}/zmq-{os.getpid()}.sock")
    await subscribe(parent, work, socket)


if __name__ == "__main__":
    run({"publisher": publisher, "subscriber": subscriber}[sys.argv[1]])
