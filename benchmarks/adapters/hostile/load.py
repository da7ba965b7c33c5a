"""What uses the processor and asks nothing of busd: what others are compared with."""

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
"""What a socket is given at once, and which part of it is looked at: much like samples for busd."""


def busy_loop(attack: Attack, tally: Tally) -> None:
    """Nothing but use a CPU; counts ms."""
    while tally.add(1):
        end_ns = monotonic_ns() + 1_000_000
        while monotonic_ns() < end_ns:
            pass


def two_by_socket(attack: Attack, tally: Tally) -> None:
    """Writes to a process of its own, by a socket that has nothing to do with the bus."""
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
    """A publisher of the library that floods a subscription of its own process."""

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
