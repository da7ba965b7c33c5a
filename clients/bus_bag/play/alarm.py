"""Waiting for a time on the event loop, to some ten microseconds.

The loop's own timers count milliseconds. A timer of the kernel is a descriptor, to which the loop listens as
to a socket; where there is none, the loop's timers do.
"""

import asyncio
import os
import sys
from collections.abc import Callable
from time import monotonic_ns

__all__ = ["Alarm"]

_NS_PER_S = 1_000_000_000
_CLOCK_MONOTONIC = 1
_ABSOLUTE = 1


class Alarm:
    """Wakes one waiter: at a time, or by `wake`. To be made and closed on the event loop."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._waiting: asyncio.Future[None] | None = None
        self._is_woken = False
        self._handle: asyncio.TimerHandle | None = None
        self._descriptor = -1
        self._set: Callable[[int], None] = self._call_later
        if sys.platform == "linux":
            self._descriptor, self._set = _kernel_timer()
            self._loop.add_reader(self._descriptor, self._ring)

    async def wait(self, due_ns: int | None) -> None:
        """Until `due_ns` of the monotonic clock, or `wake`; None: until `wake` alone. It may end early.

        A `wake` while nobody waits ends the next wait at once. Cancellation leaves nothing behind.
        """
        if self._is_woken:
            self._is_woken = False
            return
        if due_ns is not None:
            self._set(due_ns)
        self._waiting = self._loop.create_future()
        try:
            await self._waiting
        finally:
            self._waiting = None
            if self._handle is not None:
                self._handle.cancel()

    def wake(self) -> None:
        """End the wait, or the next one."""
        if self._waiting is None or self._waiting.done():
            self._is_woken = True
        else:
            self._waiting.set_result(None)

    def close(self) -> None:
        """Nobody may wait any more."""
        if self._descriptor >= 0:
            self._loop.remove_reader(self._descriptor)
            os.close(self._descriptor)
            self._descriptor = -1

    def _ring(self) -> None:
        try:
            os.read(self._descriptor, 8)
        except BlockingIOError:  # it was set again meanwhile
            return
        self._end()

    def _end(self) -> None:
        if self._waiting is not None and not self._waiting.done():
            self._waiting.set_result(None)

    def _call_later(self, due_ns: int) -> None:
        self._handle = self._loop.call_later(max(0, due_ns - monotonic_ns()) / _NS_PER_S, self._end)


def _kernel_timer() -> tuple[int, Callable[[int], None]]:
    """A descriptor that becomes readable at the time to which it is set. (Python has this from 3.13 on.)"""
    import ctypes

    libc = ctypes.CDLL(None, use_errno=True)
    descriptor: int = libc.timerfd_create(_CLOCK_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC)
    if descriptor < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"no timer: {os.strerror(number)}")
    times = (
        ctypes.c_long * 4
    )()  # seconds and nanoseconds: of the period, which there is none, and of the time
    settime = libc.timerfd_settime

    def set_to(due_ns: int) -> None:
        times[2], times[3] = divmod(max(1, due_ns), _NS_PER_S)  # 0 would switch it off
        settime(descriptor, _ABSOLUTE, times, None)

    return descriptor, set_to
