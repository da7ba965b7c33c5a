"""The common part of the endpoints of an AsyncNode: their life, and their place at their node."""

import asyncio
from collections.abc import Callable, Coroutine, Iterable
from enum import Enum
from functools import partial
from typing import Any, Protocol, TypeAlias

from bus.errors import BusError
from bus.node import Node as NativeNode
from bus.qos import QoSProfile as NativeProfile
from bus.types.support import TypeSupport
from bus_ros.rclpy.impl.openings import Openings
from bus_ros.rclpy.impl.rcutils_logger import RcutilsLogger

__all__ = ["TRANSITIONS", "AsyncEntity", "AsyncOwner", "End", "EntityEvent", "EntityState", "current_task"]

End: TypeAlias = tuple[str, str, TypeSupport[Any], NativeProfile]
"""An endpoint in the graph: `publisher` or `subscription`, the topic's full name, the type, the QoS."""


class EntityState(Enum):
    """The life of an endpoint."""

    MADE = "made"
    """By the program. The node does not run."""
    OPENING = "opening"
    """busd is asked to add it to the graph."""
    OPEN = "open"
    """In the graph."""
    DESTROYED = "destroyed"
    """Not usable any more. If it was open, its native endpoint is closed, at once or in the background."""


class EntityEvent(Enum):
    """An event in the life of an endpoint."""

    BEGIN = "begin"
    """Its node runs."""
    OPENED = "opened"
    """busd has added it to the graph."""
    DESTROY = "destroy"
    """The program destroys it, or its node ends, or busd has refused it."""


TRANSITIONS = {
    EntityState.MADE: {
        EntityEvent.BEGIN: EntityState.OPENING,
        EntityEvent.DESTROY: EntityState.DESTROYED,
    },
    EntityState.OPENING: {
        EntityEvent.OPENED: EntityState.OPEN,
        EntityEvent.DESTROY: EntityState.DESTROYED,
    },
    EntityState.OPEN: {EntityEvent.DESTROY: EntityState.DESTROYED},
    EntityState.DESTROYED: dict.fromkeys(EntityEvent, EntityState.DESTROYED),
}
"""For each state, the next one by event. The missing cells are mistakes of this package."""


class AsyncOwner(Protocol):
    """The interface of a node's work for its endpoints."""

    node: Any

    @property
    def native(self) -> NativeNode: ...
    def get_logger(self) -> RcutilsLogger: ...
    def forget(self, entity: "AsyncEntity") -> None:
        """The entity is destroyed."""

    def run_in_group(self, work: Coroutine[Any, Any, Any]) -> "asyncio.Task[Any] | None":
        """Run `work` in the node's task group: its exception ends the node. None: the node ends already."""

    def run_behind(self, work: Coroutine[Any, Any, Any]) -> None:
        """Run `work`, also after the end of the node, which waits for it. Its exception is ignored."""

    def fail(self, error: BaseException) -> None:
        """A callback raised `error`: end the node."""


class AsyncEntity:
    """Base of publishers, subscriptions, services, clients and timers of an AsyncNode."""

    def __init__(self, owner: AsyncOwner) -> None:
        self.node: Any = owner.node
        self.state = EntityState.MADE
        self.is_destroyed = False
        """Whether the state is DESTROYED."""
        self.is_optional = False
        """If busd refuses it access, the node works without it."""
        self._owner = owner
        self._end_opening: Callable[[], None] | None = None
        """While it opens: ends the wait of the publishers on its topic."""

    def begin(self, openings: Openings) -> None:
        """Its node runs, and `open` follows."""
        self._change(EntityEvent.BEGIN)
        topic = self._read_topic()
        if topic is not None and not self.is_destroyed:
            openings.begin(topic)
            self._end_opening = partial(openings.end, topic)

    async def open(self) -> None:
        """Add it to the graph. Raises the error of busd, and then it is destroyed."""
        try:
            await self._ask_to_open()
        finally:
            self._opening_is_over()

    def ends(self) -> Iterable["End"]:
        """Its ends in the graph."""
        return ()

    def destroy(self) -> None:
        """End it: no callback is called any more. A second call does nothing."""
        before = self.state
        if before is EntityState.DESTROYED:
            return
        self._change(EntityEvent.DESTROY)
        self._opening_is_over()
        self._stop()
        self._owner.forget(self)
        if before is EntityState.OPEN:
            self._end()

    # --- for subclasses

    def _read_topic(self) -> str | None:
        """The full name of a topic whose publishers in this event loop wait until it is open."""
        return None

    async def _open(self, native_node: NativeNode) -> None:
        """Make the native endpoint."""

    def _became_open(self) -> None:
        """It is open."""

    def _stop(self) -> None:
        """It is destroyed: stop at once, without waiting."""

    def _close_at_once(self) -> bool:
        """Close the native endpoint, if nothing has to be waited for; returns whether it is closed."""
        return False

    async def _close(self) -> None:
        """Close the native endpoint."""

    # --- inside

    async def _ask_to_open(self) -> None:
        if self.is_destroyed:
            return
        try:
            await self._open(self._owner.native)
        except BaseException as error:
            if self.is_destroyed and isinstance(error, BusError):
                return  # the program destroyed it, or its node, meanwhile
            self.destroy()
            raise
        if self._change(EntityEvent.OPENED) is EntityState.DESTROYED:
            self._end()  # the program destroyed it meanwhile
        else:
            self._became_open()

    def _opening_is_over(self) -> None:
        end, self._end_opening = self._end_opening, None
        if end is not None:
            end()

    def _end(self) -> None:
        if not self._close_at_once():
            self._owner.run_behind(self._close())

    def _change(self, event: EntityEvent) -> EntityState:
        self.state = TRANSITIONS[self.state][event]
        self.is_destroyed = self.state is EntityState.DESTROYED
        return self.state


def current_task() -> "asyncio.Task[Any] | None":
    """The task that runs now; None outside of tasks, and while the loop stands still."""
    return None if asyncio._get_running_loop() is None else asyncio.current_task()
