"""The alarms of one event loop."""

import asyncio
import os
from collections.abc import Callable
from contextvars import copy_context
from time import monotonic_ns
from typing import ClassVar
from weakref import WeakValueDictionary

from bus.alarms.schedule import NEVER_NS, Alarm, Schedule
from bus.alarms.wake_up import WakeUp, make_wake_up

__all__ = ["Alarms"]


class Alarms:
    """The alarms of an event loop, shared by all users; `acquire` returns them, `release` gives them back.

    Must be used only on that event loop, like `loop.call_later`.
    """

    _all: ClassVar["WeakValueDictionary[int, Alarms]"] = WeakValueDictionary()
    """The objects by the id of the loop, to which each refers.

    A look-up is safe while other threads add objects.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._users = 0
        self._schedule = Schedule()
        self._set_ns = NEVER_NS
        """The time of the wake-up: when the earliest alarm is due, or a canceled alarm before it."""
        self._wake_up: WakeUp | None = make_wake_up(loop, self._ring)
        """None after the close."""

    @classmethod
    def acquire(cls, loop: asyncio.AbstractEventLoop) -> "Alarms":
        """The alarms of `loop`."""
        alarms = cls._all.get(id(loop))
        if alarms is None or alarms._wake_up is None:
            alarms = cls._all[id(loop)] = cls(loop)
        alarms._users += 1
        return alarms

    def release(self) -> None:
        """Give the alarms back. The last user closes them; then there are no more calls."""
        self._users -= 1
        if not self._users and self._wake_up is not None:
            self._wake_up.close()
            self._wake_up = None

    def add(self, due_ns: int, callback: Callable[[], object]) -> Alarm:
        """Call `callback()` when the monotonic clock reaches `due_ns`, on the event loop, never at once.

        It gets the caller's context variables, as with `loop.call_later`. Its exceptions are handled like
        exceptions of any callback of the loop.
        """
        alarm = self._schedule.add(due_ns, callback, copy_context())
        if due_ns < self._set_ns:
            self._set(due_ns)
        return alarm

    def _ring(self) -> None:
        self._set_ns = 0  # `add` need not set the wake-up: the end of this turn does that
        try:
            for callback, context in self._schedule.due(monotonic_ns()):
                context.run(callback)
        finally:
            self._set(self._schedule.earliest_ns)

    def _set(self, due_ns: int) -> None:
        self._set_ns = due_ns
        if self._wake_up is not None:
            self._wake_up.set(due_ns)

    def _abandon(self) -> None:
        """Give up the timer in the child of a fork, because it is the parent's, too."""
        wake_up, self._wake_up = self._wake_up, None
        if wake_up is not None:
            wake_up.abandon()


def _forked() -> None:
    for alarms in tuple(Alarms._all.values()):
        alarms._abandon()


os.register_at_fork(after_in_child=_forked)
