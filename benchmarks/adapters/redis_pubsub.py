"""redis-py, with hiredis if it is installed: PUBLISH and SUBSCRIBE by a redis-server over a UNIX socket.

It uses the blocking client, which is faster than redis.asyncio: the subscriber calls `get_message` in a
thread. A flood is published in pipelines. The subscriber regularly confirms the received messages
(`roles.Window`), so the server need not keep all of them.
"""

import os
import sys
from typing import Any

import redis
from redis.connection import PythonRespSerializer

from benchmarks.adapters import roles
from benchmarks.work import TOPIC, Work
from benchmarks.worker import Parent, options, run

_TAKEN = "taken"
_LONG = 8 << 10
_READ_BYTES = 1 << 20
_PIPELINE = 200
_PIPELINE_BYTES = 1 << 20


def _connect(work: Work) -> Any:
    own: dict[str, Any] = {}
    if work.size >= _LONG:
        # hiredis is slow at packing long messages.
        own["command_packer"] = PythonRespSerializer(_LONG, redis.Redis().get_encoder().encode)
    # redis-py handles messages of the newer protocol more slowly.
    return redis.Redis.from_url(
        os.environ["BENCH_SERVER"], decode_responses=True, protocol=2, socket_read_size=_READ_BYTES, **own
    )


def _subscribe(client: Any, topic: str) -> Any:
    """Make a subscription, confirmed by the server."""
    subscription = client.pubsub()
    subscription.subscribe(topic)
    subscription.get_message(timeout=None)
    return subscription


async def publisher(parent: Parent) -> None:
    work: Work = options(Work)
    client = _connect(work)
    if work.rate:
        await roles.publish(parent, work, lambda text: client.publish(TOPIC, text))
        return
    window, taken = roles.Window(work), _subscribe(client, _TAKEN)
    pipeline = client.pipeline(transaction=False)
    length = max(1, min(_PIPELINE, _PIPELINE_BYTES // work.size))

    def send(text: str) -> None:
        pipeline.publish(TOPIC, text)
        is_full = window.sent()
        if is_full or len(pipeline) >= length:
            pipeline.execute()
        while is_full:
            taken.get_message(timeout=None)
            is_full = not window.taken()

    await roles.publish(parent, work, send, pipeline.execute)


async def subscriber(parent: Parent) -> None:
    work: Work = options(Work)
    client = _connect(work)
    subscription = _subscribe(client, TOPIC)
    taker = roles.Taker(parent, work)
    step, count = roles.Window(work).step, 0

    def receive() -> Any:
        nonlocal count
        data = subscription.get_message(timeout=None)["data"]
        count += 1
        if count % step == 0 and not work.rate:
            client.publish(_TAKEN, "")
        return data

    roles.take_in_thread(taker, receive)
    parent.tell("ready")
    await taker.finish()


if __name__ == "__main__":
    run({"publisher": publisher, "subscriber": subscriber}[sys.argv[1]])
