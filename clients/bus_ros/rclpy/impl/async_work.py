"""The endpoints and the tasks of an AsyncNode, while it runs and while it ends.

Owns the task group of the callbacks, and the tasks that the end of the node waits for. This is a separate
class: a program's nodes may use any name that rclpy does not have. Must not know the life of the node.
"""

import asyncio
from collections.abc import Coroutine
from types import TracebackType
from typing import Any, Final

from bus.errors import AccessDenied
from bus.node import Node as NativeNode
from bus_ros.rclpy.impl.async_entity import AsyncEntity
from bus_ros.rclpy.impl.openings import Openings
from bus_ros.rclpy.impl.rcutils_logger import RcutilsLogger

__all__ = ["AsyncWork"]

_OPENING_S: Final = 5.0
"""The longest time that the end of a node waits for new endpoints, if busd does not answer."""


class AsyncWork:
    """The work of `node`, which runs from `begin` to `end`."""

    def __init__(self, node: Any, native: NativeNode) -> None:
        self.node = node
        self.native = native
        self.entities: dict[AsyncEntity, None] = {}
        """The endpoints and timers that are not destroyed."""
        self.is_optional = False
        """Whether the node works without the endpoints that are added now, if busd refuses it access."""
        self._loop: asyncio.AbstractEventLoop | None = None  # since `attach`
        self._group: asyncio.TaskGroup | None = None
        self._openings: Openings | None = None
        self._opening: set[asyncio.Task[Any]] = set()
        self._behind: set[asyncio.Task[Any]] = set()

    def get_logger(self) -> RcutilsLogger:
        logger: RcutilsLogger = self.node.get_logger()
        return logger

    # --- its life

    def attach(self) -> None:
        """Use the running event loop from now on."""
        self._loop = asyncio.get_running_loop()
        self._openings = Openings.of(self._loop)

    async def begin(self) -> None:
        """Open all endpoints, in the running task's event loop.

        Raises ExceptionGroup if busd refuses one; then call `end`.
        """
        self._group = await asyncio.TaskGroup().__aenter__()
        for entity in tuple(self.entities):
            self._begin(entity)
        while self._opening:
            await asyncio.wait(self._opening)

    async def finish_openings(self) -> None:
        """Wait for endpoints made shortly before the end: they may have messages to publish."""
        if self._opening:
            await asyncio.wait(self._opening, timeout=_OPENING_S)

    async def end(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Wait for the end of all tasks; raises as `asyncio.TaskGroup.__aexit__`. All is destroyed before."""
        group, self._group = self._group, None
        try:
            if group is not None:
                await group.__aexit__(kind, error, trace)
        finally:
            while self._behind:  # a cancellation ends them, and is raised at their end
                await asyncio.gather(*self._behind, return_exceptions=True)

    # --- its endpoints

    def add(self, entity: AsyncEntity) -> None:
        """Add an endpoint, and open it if the node runs."""
        entity.is_optional = self.is_optional
        self.entities[entity] = None
        if self._group is not None:
            self._begin(entity)

    def forget(self, entity: AsyncEntity) -> None:
        self.entities.pop(entity, None)

    def run_in_group(self, work: Coroutine[Any, Any, Any]) -> "asyncio.Task[Any] | None":
        if self._group is not None:
            try:
                return self._group.create_task(work)
            except RuntimeError:  # the group ends already
                pass
        work.close()
        return None

    def run_behind(self, work: Coroutine[Any, Any, Any]) -> None:
        loop = self._loop
        if loop is None or loop.is_closed():
            work.close()
            return
        task = loop.create_task(work)  # the loop may stand still: a program destroys endpoints then, too
        self._behind.add(task)
        task.add_done_callback(self._done_behind)

    def fail(self, error: BaseException) -> None:
        self.run_in_group(_raise(error))

    # --- inside

    def _begin(self, entity: AsyncEntity) -> None:
        assert self._openings is not None
        entity.begin(self._openings)
        task = self.run_in_group(self._open(entity))
        if task is not None:
            self._opening.add(task)
            task.add_done_callback(self._opening.discard)

    async def _open(self, entity: AsyncEntity) -> None:
        try:
            await entity.open()
        except AccessDenied as denied:
            if not entity.is_optional:
                raise
            self.get_logger().warning(f"the node works without one of its own services: {denied}")

    def _done_behind(self, task: "asyncio.Task[Any]") -> None:
        self._behind.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            reason = error or "busd does not take it"
            self.get_logger().warning(f"not everything could be handed over: {reason}")


async def _raise(error: BaseException) -> None:
    raise error
