"""A process of idle.py: its node publishes some topics, subscribes to its neighbour's topics, and waits."""

import asyncio

import msgspec

import bus
from benchmarks.worker import Parent, options, run
from bus.msg.std_msgs import String


class Place(msgspec.Struct, frozen=True):
    """Process `index` of `processes`. Each publishes a number of `topics`."""

    index: int
    processes: int
    topics: int


async def main(parent: Parent) -> None:
    place: Place = options(Place)
    neighbour = (place.index + 1) % place.processes
    heard = asyncio.Event()
    waiting = set(range(place.topics))

    def hear(topic: int) -> None:
        waiting.discard(topic)
        if not waiting:
            heard.set()

    async with bus.Node(f"idle_{place.index}") as node:
        pubs = [
            await node.create_publisher(String, f"idle_{place.index}_{topic}")
            for topic in range(place.topics)
        ]
        for topic in range(place.topics):
            await node.create_subscription(
                String, f"idle_{neighbour}_{topic}", callback=lambda message: hear(int(message.data))
            )
        for topic, pub in enumerate(pubs):
            await pub.wait_for_subscriptions()
            pub.publish(String(data=str(topic)))
        await heard.wait()
        parent.tell("ready")
        await asyncio.Event().wait()


if __name__ == "__main__":
    run(main)
