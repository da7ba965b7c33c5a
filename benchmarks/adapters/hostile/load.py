"""Loads on the processor that ask nothing of busd, for comparison."""

import asyncio
import os
import socket
from time import monotonic_ns

import bus
from benchmarks.adapters.hostile.attack import Attack
from benchmarks.adapters.hostile.tally import Tally
from bus.msg.std_msgs import String
from bus.runner import loop_factory

_BATCH = 64
_BLOCK_BYTES, _STRIDE = 100_000, 4
"""Bytes written to a socket at once, and the stride in which the receiver reads them: similar to samples for
busd."""


def busy_loop(attack: Attack, tally: Tally) -> None:
    """Use a CPU and nothing else; counts ms."""
    while tally.add(1):
        end_ns = monotonic_ns() + 1_000_000
        while monotonic_ns() < end_ns:
            pass


def two_by_socket(attack: Attack, tally: Tally) -> None:
    """Write to a forked process, by a socket that is not part of the bus."""
    ours, others = socket.socketpair()
    if os.fork() == 0:
        ours.close()
        buffer = bytearray(_BLOCK_BYTES)
        while size := others.recv_into(buffer):
            sum(buffer[:size:_STRIDE])
        os._exit(0)
    others.close()
    block = bytes(_BLOCK_BYTES)
    with ours:
        while tally.add(1):
            ours.sendall(block)


def shared_memory(attack: Attack, tally: Tally) -> None:
    """Flood a subscription in the same process by the library's publisher."""

    async def flood() -> None:
        async with bus.Node("flooder") as node:
            await node.create_subscription(String, "flood", 10, lambda message: None)
            pub = await node.create_publisher(String, "flood", 10)
            await pub.wait_for_subscriptions()
            message = String(data="x" * attack.size)
            while tally.add(_BATCH):
                for _ in range(_BATCH):
                    pub.publish(message)
                await asyncio.sleep(0)

    with asyncio.Runner(loop_factory=loop_factory()) as runner:
        runner.run(flood())
