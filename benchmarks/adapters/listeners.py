"""Programs that take one message of a running talker, each written like a user's program; and that talker.

    python -m benchmarks.adapters.listeners <the system's adapter> listen|talk

For startup.py. A listener imports only the packages that it needs, and not the harness, as in `talkers`. It
reports the arrival of its first message and ends. The talker sends a message each millisecond until its
stdin ends.
"""

import os
import sys
from collections.abc import Callable
from select import select
from time import monotonic_ns

from benchmarks.adapters.talkers import TOPIC, text

_PERIOD_S = 0.001


def bus_string(listens: bool) -> None:
    """busd, by either route."""
    import bus
    from bus.msg.std_msgs import String

    async def listen() -> None:
        async with bus.Node("bench_listener") as node:
            async for _ in await node.create_subscription(String, TOPIC):
                _received()
                break

    async def talk() -> None:
        async with bus.Node("bench_talker") as node:
            pub = await node.create_publisher(String, TOPIC)
            _ready()
            rate = node.create_rate(1 / _PERIOD_S)
            while not _is_over():
                pub.publish(String(data=text()))
                await rate.sleep()

    bus.run(listen() if listens else talk())


def zeromq(listens: bool) -> None:
    """pyzmq without a proxy. The talker binds, because a connection that comes too early is tried again only
    a tenth of a second later."""
    import zmq

    address = f"ipc://{os.environ['BENCH_FOLDER']}/talker.sock"
    with zmq.Context() as context, context.socket(zmq.SUB if listens else zmq.PUB) as socket:
        if listens:
            socket.setsockopt(zmq.SUBSCRIBE, b"")
            socket.connect(address)
            socket.recv().decode()
            _received()
            return
        socket.bind(address)
        _ready()
        while not _is_over(_PERIOD_S):
            socket.send(text().encode())


def _received() -> None:
    print(f'{{"event": "received", "at_ns": {monotonic_ns()}}}', flush=True)


def _ready() -> None:
    print('{"event": "ready"}', flush=True)


def _is_over(within_s: float = 0.0) -> bool:
    """Whether stdin ends within a time."""
    return bool(select([0], [], [], within_s)[0])


LISTENERS: dict[str, Callable[[bool], None]] = {one.__name__: one for one in (bus_string, zeromq)}

if __name__ == "__main__":
    LISTENERS[sys.argv[1]](sys.argv[2] == "listen")
