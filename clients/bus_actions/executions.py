"""The goals of a server that are executed now, each as a task, and the goals that wait for their turn.

Owns: the tasks and the queue before them. Must not know: what a goal is, its states, its messages.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Generic, TypeVar

__all__ = ["Executions"]

T = TypeVar("T")


class Executions(Generic[T]):
    """Executes `at_once` goals concurrently; others follow in order when a task has ended.

    `begin(goal)` makes the task of a goal. `on_end(goal)` is called after the end of each task.
    """

    def __init__(
        self,
        at_once: int,
        begin: Callable[[T], "asyncio.Task[None]"],
        on_end: Callable[[T], object],
    ) -> None:
        self._at_once = at_once
        self._begin = begin
        self._on_end = on_end
        self._waiting: deque[T] = deque()
        self._running: dict[T, asyncio.Task[None]] = {}

    def add(self, goal: T) -> None:
        """Begin it now, or when it is its turn."""
        self._waiting.append(goal)
        self._begin_next()

    def cancel(self, goal: T) -> bool:
        """Cancel the task of a goal that was added and has not ended.

        Returns False for a waiting goal: it leaves the queue, and no task is made for it.
        """
        task = self._running.get(goal)
        if task is None:
            self._waiting.remove(goal)
            return False
        task.cancel()
        return True

    def stop(self) -> tuple[list[T], list[T]]:
        """Cancel all tasks except the calling one.

        Returns the goals that waited, which will not begin, and the goals with a task.
        """
        waiting, self._waiting = list(self._waiting), deque()
        for task in self._others():
            task.cancel()
        return waiting, list(self._running)

    async def wait(self) -> None:
        """Wait until all tasks have ended, except the calling one."""
        if others := self._others():
            await asyncio.wait(others)

    def _others(self) -> "set[asyncio.Task[None]]":
        return {*self._running.values()} - {asyncio.current_task()}

    def _begin_next(self) -> None:
        while self._waiting and len(self._running) < self._at_once:
            goal = self._waiting.popleft()
            task = self._running[goal] = self._begin(goal)
            task.add_done_callback(partial(self._end, goal))

    def _end(self, goal: T, _: "asyncio.Task[None]") -> None:
        del self._running[goal]
        self._on_end(goal)
        self._begin_next()
