"""eclipse-zenoh, peer to peer over UNIX sockets, with shared memory for long messages. No router, no
scouting.

Each subscriber listens on a socket in the run's folder, and the publisher connects to all of them. It is
reliable and blocks without room, so a flood loses nothing. Paced messages are express (not gathered into
batches). From zenoh's own limit of 3 KiB on, the text is written into its shared memory: at 1 MiB that takes
a fraction of the time. TCP on loopback is no faster than the sockets. The callback runs in zenoh's default
thread for it. In its network thread (`indirect=False`), paced messages are as fast, and floods are several
times slower.

With BENCH_ENDPOINT in the environment, it uses that address, without shared memory, as between two machines:
for comparison with bridges. With BENCH_ATTACHMENT, each message has an attachment with its publisher's id,
its number and its time, as ROS 2's messages have by zenoh, and the subscriber reads it.

With shared memory, zenoh leaves one or two small files in /dev/shm. Its next process removes them.
"""

import asyncio
import json
import os
import struct
import sys
from pathlib import Path
from time import time_ns
from typing import Any

import msgspec
import zenoh
from zenoh.shm import BlockOn, GarbageCollect, ShmProvider

from benchmarks.adapters import roles
from benchmarks.work import HEAD, TOPIC, Work, text_of
from benchmarks.worker import Parent, options, run

_SHARED_SIZE = 3072
_POOL = 64 << 20
_SOCKETS = "zenoh-*.sock"
_ATTACHMENT = struct.Struct("<16sQq")
_TOKENS = f"{TOPIC}/*"
_ENDPOINT = os.environ.get("BENCH_ENDPOINT", "")


def _folder() -> Path:
    return Path(os.environ["BENCH_FOLDER"])


def _is_shared(work: Work) -> bool:
    return work.size >= _SHARED_SIZE and not _ENDPOINT


def _open(work: Work, where: str, paths: list[Path]) -> zenoh.Session:
    config = zenoh.Config()
    settings: dict[str, object] = {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "listen/endpoints": [],
        "transport/shared_memory/enabled": _is_shared(work),
        where: [_ENDPOINT] if _ENDPOINT else [f"unixsock-stream/{path}" for path in paths],
    }
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    return zenoh.open(config)


async def _wait_for_subscribers(session: zenoh.Session, number: int) -> None:
    """Wait for the tokens of that many subscribers. Each declares its token after its subscription."""
    loop = asyncio.get_running_loop()
    came: asyncio.Queue[object] = asyncio.Queue()
    with session.liveliness().declare_subscriber(
        _TOKENS, lambda token: loop.call_soon_threadsafe(came.put_nowait, token), history=True
    ):
        for _ in range(number):
            await came.get()


async def publisher(parent: Parent) -> None:
    work: Work = options(Work)
    with _open(work, "connect/endpoints", list(_folder().glob(_SOCKETS))) as session:
        port = session.declare_publisher(
            TOPIC,
            reliability=zenoh.Reliability.RELIABLE,
            congestion_control=zenoh.CongestionControl.BLOCK,
            express=bool(work.rate),
        )
        await _wait_for_subscribers(session, work.subscribers)
        put = port.put

        def send(text: str) -> None:
            put(text.encode())

        if _is_shared(work):
            allocate, policy = ShmProvider.default_backend(_POOL).alloc, BlockOn(GarbageCollect())

            def send(text: str) -> None:
                place = allocate(len(text), policy)
                place[:] = text.encode()
                put(place)

        if os.environ.get("BENCH_ATTACHMENT"):
            pack, identity, number = _ATTACHMENT.pack, os.urandom(16), 0

            def send(text: str) -> None:
                nonlocal number
                number += 1
                put(text.encode(), attachment=pack(identity, number, time_ns()))

        if work.publish_by == "loan":
            body = text_of(work.size).encode()

            def send(text: str) -> None:
                place = allocate(len(body), policy)
                place[:] = body
                place[: len(text)] = text.encode()
                put(place)

            work = msgspec.structs.replace(work, size=HEAD)

        await roles.publish(parent, work, send)


async def subscriber(parent: Parent) -> None:
    work: Work = options(Work)
    taker = roles.Taker(parent, work)
    take = taker.take

    def receive(sample: Any) -> None:
        take(sample.payload.to_string())

    if os.environ.get("BENCH_ATTACHMENT"):
        unpack = _ATTACHMENT.unpack

        def receive(sample: Any) -> None:
            unpack(sample.attachment.to_bytes())
            take(sample.payload.to_string())

    if work.publish_by == "loan":

        def receive(sample: Any) -> None:
            take(sample.payload.to_bytes())  # zenoh's Python binding has no view of the payload

    path = _folder() / _SOCKETS.replace("*", str(os.getpid()))
    with _open(work, "listen/endpoints", [path]) as session:
        session.declare_subscriber(TOPIC, receive)
        with session.liveliness().declare_token(_TOKENS.replace("*", str(os.getpid()))):
            parent.tell("ready")
            await taker.finish()


if __name__ == "__main__":
    run({"publisher": publisher, "subscriber": subscriber}[sys.argv[1]])
