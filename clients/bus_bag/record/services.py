"""The services of a recorder's node: the same as rosbag2's."""

from typing import Protocol

from bus.node import Node
from bus_bag.serving import offer

__all__ = ["Served", "serve"]


class Served(Protocol):
    """The recorder that the services control."""

    @property
    def is_paused(self) -> bool: ...

    def pause(self) -> None: ...

    def resume(self) -> None: ...

    def split(self) -> None: ...

    def snapshot(self) -> bool: ...


async def serve(node: Node, recorder: Served) -> None:
    """Let `node` serve requests to `recorder`, until it is closed."""
    await offer(node, "pause", "Pause", lambda request: recorder.pause())
    await offer(node, "resume", "Resume", lambda request: recorder.resume())
    await offer(node, "is_paused", "IsPaused", lambda request: {"paused": recorder.is_paused})
    await offer(node, "snapshot", "Snapshot", lambda request: {"success": recorder.snapshot()})
    await offer(node, "split_bagfile", "SplitBagfile", lambda request: recorder.split())
