"""The services of a recorder's node: those of rosbag2's."""

from collections.abc import Callable
from typing import Any, Protocol

from bus.node import Node
from bus.types.classes import service_class

__all__ = ["Served", "serve"]


class Served(Protocol):
    """What the services steer: a recorder."""

    is_paused: bool

    def pause(self) -> None: ...

    def resume(self) -> None: ...

    def split(self) -> None: ...

    def snapshot(self) -> bool: ...


async def serve(node: Node, recorder: Served) -> None:
    """Have `node` do with `recorder` what others ask for, until it is closed."""

    async def offer(name: str, service: str, answer: Callable[[], dict[str, Any] | None]) -> None:
        """`answer` returns the fields of the response."""
        cls = service_class(f"rosbag2_interfaces/srv/{service}")
        await node.create_service(cls, f"~/{name}", lambda request: cls.Response(**(answer() or {})))

    await offer("pause", "Pause", recorder.pause)
    await offer("resume", "Resume", recorder.resume)
    await offer("is_paused", "IsPaused", lambda: {"paused": recorder.is_paused})
    await offer("snapshot", "Snapshot", lambda: {"success": recorder.snapshot()})
    await offer("split_bagfile", "SplitBagfile", recorder.split)
