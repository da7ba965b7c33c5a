"""The services of a recorder's node: those of rosbag2's."""

from collections.abc import Callable
from typing import Any

from bus.node import Node
from bus.types.classes import service_class
from bus_bag.record.recorder import Recorder

__all__ = ["serve"]


async def serve(node: Node, recorder: Recorder) -> None:
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
