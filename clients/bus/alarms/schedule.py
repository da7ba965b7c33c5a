"""Calls for later, in the order of their times. Knows no clock and no event loop."""

from collections.abc import Callable, Iterator
from contextvars import Context
from heapq import heapify, heappop, heappush

__all__ = ["NEVER_NS", "Alarm", "Schedule"]

NEVER_NS = 1 << 63
_FEW = 100
"""Number of canceled alarms that may always stay in the heap."""


class Alarm:
    """One call at one time, made by `Schedule.add`."""

    __slots__ = ("_schedule", "callback", "context")

    def __init__(self, schedule: "Schedule", callback: Callable[[], object], context: Context) -> None:
        self._schedule = schedule
        self.callback: Callable[[], object] | None = callback
        """None once the alarm is canceled or has been called."""
        self.context = context
        """The context variables for the call."""

    def cancel(self) -> None:
        """Cancel the call. No effect if the alarm is canceled already, or was called."""
        if self.callback is not None:
            self._schedule.take_callback(self)


class Schedule:
    """A heap of alarms. `add` costs O(log n), `Alarm.cancel` O(1).

    A canceled alarm leaves the heap when its time comes, or when most of the heap is canceled.
    """

    def __init__(self) -> None:
        self.pending = 0
        """Alarms that are neither called nor canceled."""
        self._heap: list[tuple[int, int, Alarm]] = []
        self._next_number = 0
        self._now_ns = 0

    @property
    def earliest_ns(self) -> int:
        """The time of the next alarm; NEVER_NS without one."""
        heap = self._heap
        while heap and heap[0][2].callback is None:
            heappop(heap)
        return heap[0][0] if heap else NEVER_NS

    def add(self, due_ns: int, callback: Callable[[], object], context: Context) -> Alarm:
        """Add an alarm that `due` returns from `due_ns` on.

        If that time is past, the alarm comes after those already due, so it delays none of them.
        """
        if len(self._heap) > 2 * self.pending + _FEW:
            self._heap[:] = [entry for entry in self._heap if entry[2].callback is not None]
            heapify(self._heap)
        alarm = Alarm(self, callback, context)
        heappush(self._heap, (max(due_ns, self._now_ns), self._next_number, alarm))
        self._next_number += 1
        self.pending += 1
        return alarm

    def due(self, now_ns: int) -> Iterator[tuple[Callable[[], object], Context]]:
        """The calls due at `now_ns`, earliest first; each is removed when it is returned.

        Alarms added meanwhile must wait for the next time, even if they are due.
        """
        heap, end = self._heap, self._next_number
        self._now_ns = now_ns
        while heap and heap[0][0] <= now_ns and heap[0][1] < end:
            alarm = heappop(heap)[2]
            if alarm.callback is not None:
                yield self.take_callback(alarm), alarm.context

    def take_callback(self, alarm: Alarm) -> Callable[[], object]:
        """Take the callback of a pending alarm, which is no longer pending. For `Alarm.cancel` and `due`."""
        callback = alarm.callback
        assert callback is not None
        alarm.callback = None
        self.pending -= 1
        return callback
