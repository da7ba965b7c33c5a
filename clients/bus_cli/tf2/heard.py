"""Completion of frames in the shell: the frames received on /tf and /tf_static within a moment."""

import asyncio
from argparse import Namespace
from typing import Any, Final

__all__ = ["complete_frames"]

TOPICS: Final = ("/tf", "/tf_static")
MOMENT_S: Final = 0.4
"""Moving transforms usually come at least ten times a second, and completion must be fast."""


def complete_frames(prefix: str, parsed_args: Namespace, **_: Any) -> list[str]:
    """Names of frames, sorted; none if no busd runs."""
    from bus.errors import BusError
    from bus_cli.query import get_graph

    try:
        graph = get_graph(parsed_args, may_start=False)
        sent = [topic for topic in TOPICS if graph.publishers_of(topic)]
        heard = asyncio.run(_listen(parsed_args, sent)) if sent else ()
        return sorted(name for name in heard if name.isprintable())
    except (BusError, OSError):
        return []


async def _listen(args: Namespace, topics: list[str]) -> set[str]:
    from bus.qos import Durability, QoSProfile
    from bus.types.classes import message_class
    from bus_cli.stream import open_node

    heard: set[str] = set()

    def on_message(message: Any) -> None:
        for one in message.transforms:
            heard.update((one.header.frame_id, one.child_frame_id))

    kind = message_class("tf2_msgs/msg/TFMessage")
    async with open_node(args) as node:
        for topic in topics:
            latched = Durability.TRANSIENT_LOCAL if topic == "/tf_static" else Durability.VOLATILE
            qos = QoSProfile(depth=100, durability=latched)
            await node.create_subscription(kind, topic, qos, callback=on_message)
        await asyncio.sleep(MOMENT_S)
    return heard
