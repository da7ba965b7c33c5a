"""Waits on the event loop for a time (to about ten microseconds), or for a call of another task."""

import asyncio

from bus.alarms import Alarms

__all__ = ["Alarm"]


class Alarm:
    """Wakes one waiter: at a time, or by `wake`. Make and close it on the event loop."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._alarms = Alarms.acquire(self._loop)
        self._waiting: asyncio.Future[None] | None = None
        self._is_woken = False

    async def wait(self, due_ns: int | None) -> None:
        """Wait until `due_ns` of the monotonic clock, or until `wake`; None: only until `wake`.

        A `wake` without a waiter ends the next wait at once. Cancellation leaves nothing behind.
        """
        if self._is_woken:
            self._is_woken = False
            return
        self._waiting = self._loop.create_future()
        alarm = None if due_ns is None else self._alarms.add(due_ns, self._end)
        try:
            await self._waiting
        finally:
            self._waiting = None
            if alarm is not None:
                alarm.cancel()

    def wake(self) -> None:
        """End the current wait, or the next one."""
        if self._waiting is None or self._waiting.done():
            self._is_woken = True
        else:
            self._waiting.set_result(None)

    def close(self) -> None:
        """Close it; no task may wait any more."""
        self._alarms.release()

    def _end(self) -> None:
        if self._waiting is not None and not self._waiting.done():
            self._waiting.set_result(None)
