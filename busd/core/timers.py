"""Actions for later: a heap of (due, number, action). Knows no clock; the shell asks for the due ones."""

import heapq
from collections.abc import Callable, Iterator
from itertools import count

NEVER_NS = 1 << 63


class Timers:
    """`earliest_ns` says when to call `due` (NEVER_NS: nothing waits).

    Nothing is cancelled: an action looks whether it still matters.
    """

    def __init__(self) -> None:
        self.earliest_ns = NEVER_NS
        self._heap: list[tuple[int, int, Callable[[int], None]]] = []
        self._numbers = count()

    def add(self, due_ns: int, action: Callable[[int], None]) -> None:
        """`action(now_ns)` is to run at `due_ns` or later."""
        heapq.heappush(self._heap, (due_ns, next(self._numbers), action))
        self.earliest_ns = self._heap[0][0]

    def due(self, now_ns: int) -> Iterator[Callable[[int], None]]:
        """Takes out the actions that are due at `now_ns`."""
        while self._heap and self._heap[0][0] <= now_ns:
            action = heapq.heappop(self._heap)[2]
            self.earliest_ns = self._heap[0][0] if self._heap else NEVER_NS
            yield action
