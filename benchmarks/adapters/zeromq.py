"""pyzmq, PUB and SUB over ipc, with libzmq's own I/O thread at each end.

The subscriber waits for libzmq's descriptor on uvloop, which is quicker than zmq.asyncio, or it is a plain
program that blocks in `recv` (`take_by` "blocking"). It binds, and the publisher connects to all subscribers:
neither has to try again until the other is there. In a flood the publisher blocks where a subscriber's queue
is full (XPUB_NODROP), so that nothing is lost. Long messages go to libzmq and come from it without a copy
(`copy=False`), which with short ones costs more than it saves.
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
    """Messages in a queue of libzmq, at each end of a connection."""
    return max(2, min(_QUEUE, _QUEUE_BYTES // work.size))


def publishing_socket(work: Work) -> Any:
    """A socket that loses nothing: XPUB is PUB that is told of subscriptions, so it knows its subscribers."""
    socket = zmq.Context().socket(zmq.XPUB)
    socket.setsockopt(zmq.SNDHWM, depth_of(work))
    socket.setsockopt(zmq.XPUB_NODROP, 1)
    return socket


def subscribing_socket(work: Work) -> Any:
    """A socket that takes everything.

    It asks for that and for what begins with a name of its own, because a proxy passes on only the first of
    several equal subscriptions: by those names the publisher counts its subscribers.
    """
    socket = zmq.Context().socket(zmq.SUB)
    socket.setsockopt(zmq.RCVHWM, depth_of(work))
    socket.setsockopt(zmq.SUBSCRIBE, b"")
    socket.setsockopt(zmq.SUBSCRIBE, b"%s%d" % (_NAME, os.getpid()))
    return socket


async def publish(parent: Parent, work: Work, socket: Any) -> None:
    """The publisher, once `socket` has been told of all subscribers."""
    count = 0
    while count < work.subscribers:
        count += socket.recv().startswith(b"\1" + _NAME)
    send, copy = socket.send, work.size < _LONG
    await roles.publish(parent, work, lambda text: send(text.encode(), copy=copy))


async def subscribe(parent: Parent, work: Work, socket: Any) -> None:
    """The subscriber with a `socket` that is bound or connected."""
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
    come()  # its descriptor tells of changes only
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
