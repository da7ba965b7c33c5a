"""Serves a service of rosbag2, for the nodes of a recorder and a player."""

from collections.abc import Callable
from inspect import isawaitable
from typing import Any

from bus.node import Node
from bus.types.classes import service_class

__all__ = ["offer"]


async def offer(node: Node, name: str, service: str, answer: Callable[[Any], Any]) -> None:
    """Let `node` serve `~/name`, of a type of rosbag2_interfaces.

    `answer` takes the request, and returns the fields of the response, or None if it has none. It may be
    `async def`.
    """
    cls = service_class(f"rosbag2_interfaces/srv/{service}")

    async def respond(request: Any) -> Any:
        fields = answer(request)
        return cls.Response(**((await fields if isawaitable(fields) else fields) or {}))

    await node.create_service(cls, f"~/{name}", respond)
