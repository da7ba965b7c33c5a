"""Wakes an event loop at a time: by a timer of the kernel, or by the event loop's own timers without one."""

import asyncio
import sys
from collections.abc import Callable
from time import CLOCK_MONOTONIC, monotonic_ns
from typing import Protocol

from bus import shm
from bus.alarms.schedule import NEVER_NS
from bus.base.descriptor import Descriptor

__all__ = ["KernelWakeUp", "LoopWakeUp", "WakeUp", "make_wake_up"]

_NS_PER_S = 1_000_000_000


class WakeUp(Protocol):
    """Calls `ring` on the event loop at the time set last, and repeats that until another time is set."""

    def set(self, due_ns: int) -> None:
        """Ring when the monotonic clock reaches `due_ns`; NEVER_NS: do not ring."""

    def close(self) -> None:
        """Stop ringing."""

    def abandon(self) -> None:
        """As `close`, in the child of a fork: has no effect on the parent, and does not use the event
        loop."""


class KernelWakeUp:
    """A wake-up by a timerfd: accurate to some ten microseconds, and the process sleeps until then.

    The descriptor is readable from its time on. It is never read, because setting it again clears that, too.

    Raises OSError if the process has no descriptor left.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, ring: Callable[[], object]) -> None:
        create, self._settime = _system_calls()
        self._descriptor = Descriptor(create())
        self._loop = loop
        loop.add_reader(self._descriptor.number, ring)

    def set(self, due_ns: int) -> None:
        # For the kernel, 0 means "never".
        self._settime(self._descriptor.number, 0 if due_ns >= NEVER_NS else max(1, due_ns))

    def close(self) -> None:
        if not self._loop.is_closed():
            self._loop.remove_reader(self._descriptor.number)
        self._descriptor.close()

    def abandon(self) -> None:
        self._descriptor.close()


class LoopWakeUp:
    """A wake-up by the event loop's own timers: accurate to a millisecond, and uvloop polls for the last
    one."""

    def __init__(self, loop: asyncio.AbstractEventLoop, ring: Callable[[], object]) -> None:
        self._loop = loop
        self._ring = ring
        self._handle: asyncio.TimerHandle | None = None

    def set(self, due_ns: int) -> None:
        self.close()
        if due_ns < NEVER_NS:
            delay_s = max(0, due_ns - monotonic_ns()) / _NS_PER_S
            self._handle = self._loop.call_later(delay_s, self._ring)

    def close(self) -> None:
        if self._handle is not None:
            self._handle.cancel()
            self._handle = None

    def abandon(self) -> None:
        self._handle = None


def make_wake_up(loop: asyncio.AbstractEventLoop, ring: Callable[[], object]) -> WakeUp:
    """Make the best wake-up that this Python, this build and the limit of open files allow."""
    if has_kernel_timer():
        try:
            return KernelWakeUp(loop, ring)
        except OSError:
            pass  # no descriptor is left: late timers are better than none
    return LoopWakeUp(loop, ring)


def has_kernel_timer() -> bool:
    """Whether this Python (from 3.13 on) or the native core can make a kernel timer."""
    return sys.platform == "linux" and (sys.version_info >= (3, 13) or shm.has_core())


def _system_calls() -> tuple[Callable[[], int], Callable[[int, int], object]]:
    """Two functions: one makes a timerfd, the other sets it to a time of the monotonic clock."""
    if sys.version_info >= (3, 13):
        import os

        def create() -> int:
            return os.timerfd_create(CLOCK_MONOTONIC, flags=os.TFD_NONBLOCK | os.TFD_CLOEXEC)

        def settime(descriptor: int, due_ns: int) -> object:
            return os.timerfd_settime_ns(descriptor, flags=os.TFD_TIMER_ABSTIME, initial=due_ns)

        return create, settime
    return shm.native.timerfd_create, shm.native.timerfd_settime
