"""nats-py with a nats-server started by the benchmark, over loopback TCP: the server has no other transport.

It uses publish and subscribe of core NATS, which has no acknowledgement and disconnects slow subscribers. So
in a flood, the subscriber regularly confirms the received messages (`roles.Window`), and no message is lost.
"""

import asyncio
import os
import sys
from typing import Any

import nats

from benchmarks.adapters import roles
from benchmarks.work import TOPIC, Work
from benchmarks.worker import Parent, options, run

_TAKEN = "taken"


async def _connect() -> Any:
    return await nats.connect(os.environ["BENCH_SERVER"], skip_subject_validation=True)


async def publisher(parent: Parent) -> None:
    work: Work = options(Work)
    client = await _connect()
    publish = client.publish
    window, has_room = roles.Window(work), asyncio.Event()

    async def room(_: object) -> None:
        if window.taken():
            has_room.set()

    async def send(text: str) -> None:
        await publish(TOPIC, text.encode())
        if window.sent():
            has_room.clear()
            await has_room.wait()

    async def send_now(text: str) -> None:
        await publish(TOPIC, text.encode())

    await client.subscribe(_TAKEN, cb=room)
    await client.flush()
    await roles.publish(parent, work, send_now if work.rate else send)


async def subscriber(parent: Parent) -> None:
    work: Work = options(Work)
    client = await _connect()
    taker = roles.Taker(parent, work)
    take, step, count = taker.take, roles.Window(work).step, 0

    async def take_it(message: Any) -> None:
        nonlocal count
        take(message.data.decode())
        count += 1
        if count % step == 0 and not work.rate:
            await client.publish(_TAKEN)

    await client.subscribe(TOPIC, cb=take_it, pending_msgs_limit=0, pending_bytes_limit=0)
    await client.flush()
    parent.tell("ready")
    await taker.finish()


if __name__ == "__main__":
    run({"publisher": publisher, "subscriber": subscriber}[sys.argv[1]])
