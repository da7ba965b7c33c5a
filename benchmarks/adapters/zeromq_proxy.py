"""pyzmq through a process in the middle: zmq.proxy from XSUB to XPUB, over ipc, without losses.

Both ends use benchmarks.adapters.zeromq, and both connect.
"""

import asyncio
import os
import sys
from threading import Thread

import zmq

from benchmarks.adapters import zeromq
from benchmarks.work import Work
from benchmarks.worker import Parent, options, run

_QUEUE = 1_000


def _address(side: str) -> str:
    return f"ipc://{os.environ['BENCH_FOLDER']}/proxy-{side}.sock"


async def publisher(parent: Parent) -> None:
    work: Work = options(Work)
    socket = zeromq.publishing_socket(work)
    socket.connect(_address("in"))
    await zeromq.publish(parent, work, socket)


async def subscriber(parent: Parent) -> None:
    work: Work = options(Work)
    socket = zeromq.subscribing_socket(work)
    socket.connect(_address("out"))
    await zeromq.subscribe(parent, work, socket)


async def relay(parent: Parent) -> None:
    context = zmq.Context()
    taking, giving = context.socket(zmq.XSUB), context.socket(zmq.XPUB)
    for socket in (taking, giving):
        # The size of later messages is unknown, and a longer queue does not make it faster.
        socket.setsockopt(zmq.RCVHWM, _QUEUE)
        socket.setsockopt(zmq.SNDHWM, _QUEUE)
    giving.setsockopt(zmq.XPUB_NODROP, 1)
    taking.bind(_address("in"))
    giving.bind(_address("out"))
    Thread(target=zmq.proxy, args=(taking, giving), daemon=True).start()
    parent.tell("ready")
    await asyncio.Event().wait()


if __name__ == "__main__":
    run({"publisher": publisher, "subscriber": subscriber, "relay": relay}[sys.argv[1]])
