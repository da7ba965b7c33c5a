"""When our readers and writers of an RTPS domain have something to do. Pure.

Each of them knows its own time (`due_ns`), which many events change. Instead of a search after each event, an
entity is marked as touched, and asked once at the end of the turn.
"""

import heapq
from collections.abc import Callable, Iterator
from itertools import count

__all__ = ["DueTimes"]

_SPARE = 64


class DueTimes:
    """The times of entities, by entity id."""

    def __init__(self) -> None:
        self._touched: dict[bytes, None] = {}
        self._plan: list[tuple[int, int, bytes]] = []
        """A heap. An entry that differs from `_planned` is void."""
        self._planned: dict[bytes, int] = {}
        self._turns = count()

    @property
    def first_ns(self) -> int | None:
        """The earliest time, or an earlier one that is void by now."""
        return self._plan[0][0] if self._plan else None

    def touch(self, entity: bytes) -> None:
        """Note that the time of an entity may have changed, or that it has gone."""
        self._touched[entity] = None

    def take_due(self, now_ns: int) -> Iterator[bytes]:
        """Yield each entity that is due. Each is touched, because it has another time afterwards."""
        while self._plan and self._plan[0][0] <= now_ns:
            due_ns, _, entity = heapq.heappop(self._plan)
            if self._planned.get(entity) == due_ns:
                del self._planned[entity]
                self._touched[entity] = None
                yield entity

    def settle(self, due_ns_of: Callable[[bytes], int | None]) -> None:
        """Ask for the times of all touched entities. None: nothing is due."""
        touched, self._touched = self._touched, {}
        for entity in touched:
            due_ns = due_ns_of(entity)
            if due_ns is None:
                self._planned.pop(entity, None)
            elif due_ns != self._planned.get(entity):
                self._planned[entity] = due_ns
                heapq.heappush(self._plan, (due_ns, next(self._turns), entity))
        if len(self._plan) > 4 * len(self._planned) + _SPARE:
            self._plan = [one for one in self._plan if self._planned.get(one[2]) == one[0]]
            heapq.heapify(self._plan)
