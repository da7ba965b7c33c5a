"""`on_aarch64.py alone | talk | listen`: messages by shared memory, in this process or with another one.

Run with an installed wheel, on an emulated machine and beside it. Exit status 1: a message did not come, or
did not come by shared memory.
"""

import asyncio
import platform
import sys
from contextlib import AsyncExitStack

import bus
from bus import shm
from bus.msg.std_msgs import Empty, UInt8MultiArray

COUNT = 20
SIZE = 200_000


def content(number: int) -> bytes:
    return bytes([number]) * SIZE


async def talk(node: bus.Node) -> None:
    publisher = await node.create_publisher(UInt8MultiArray, "/pictures", COUNT)
    done = await node.create_subscription(Empty, "/done", 1)
    await publisher.wait_for_subscriptions()
    for number in range(COUNT):
        await publisher.send(UInt8MultiArray(data=content(number)))
    await done.receive()  # the listener looks at the route, which ends with this publisher


async def listen(node: bus.Node) -> None:
    subscription = await node.create_subscription(UInt8MultiArray, "/pictures", COUNT)
    for number in range(COUNT):
        message, _ = await subscription.receive()
        assert bytes(message.data) == content(number), f"message {number} has other bytes"
    (topic,) = [one.id for one in (await node.graph()).subscriptions if one.topic == "/pictures"]
    routes = [match.route for match in (await node.graph()).matches if match.subscription == topic]
    assert routes == ["shm"], f"routes are {routes}"
    done = await node.create_publisher(Empty, "/done", 1)
    await done.wait_for_subscriptions()
    done.publish(Empty())
    await done.flush()


ROLES = {"alone": (listen, talk), "talk": (talk,), "listen": (listen,)}


async def main(role: str) -> None:
    assert not shm.why_not(), shm.why_not()
    async with AsyncExitStack() as stack, asyncio.timeout(60), asyncio.TaskGroup() as tasks:
        for act in ROLES[role]:
            node = await stack.enter_async_context(bus.Node(act.__name__))
            tasks.create_task(act(node))
    print(f"{platform.machine()} {role}: {COUNT} messages of {SIZE} bytes by shared memory")


bus.run(main(sys.argv[1]))
