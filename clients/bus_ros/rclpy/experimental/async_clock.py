"""The clock of an AsyncNode: tasks sleep by it, in simulated time too."""

import asyncio
from collections.abc import Callable

from bus_ros.rclpy.clock import (
    ANY_JUMP,
    CHANGES_OF_SOURCE,
    BaseClock,
    ClockType,
    JumpHandle,
    OverridableClock,
    TimeJump,
)
from bus_ros.rclpy.exceptions import TimeSourceChangedError

__all__ = ["AsyncClock"]

_NS_PER_S = 1_000_000_000


class AsyncClock(OverridableClock):
    """A ROS clock with a `sleep` to await; `AsyncNode.get_clock` returns it."""

    def __new__(cls, *, clock_type: ClockType = ClockType.ROS_TIME) -> "AsyncClock":
        self = BaseClock.__new__(cls, clock_type=clock_type)
        assert isinstance(self, AsyncClock)
        return self

    def __init__(self, *, clock_type: ClockType = ClockType.ROS_TIME) -> None:
        self._sleeps: dict[asyncio.Future[None], int] = {}
        """Each with the simulated time of its end."""
        self._is_closed = False
        self._jumps: JumpHandle | None = self.create_jump_callback(ANY_JUMP, post_callback=self._on_jump)

    def destroy(self) -> None:
        """Cancel all sleeps; a second call does nothing."""
        self._is_closed = True
        jumps, self._jumps = self._jumps, None
        if jumps is not None:
            jumps.unregister()
        for sleep in self._sleeps:
            sleep.cancel()

    async def sleep(self, duration_sec: float) -> None:
        """Wait for a duration by this clock. Cancellation leaves nothing behind.

        Raises TimeSourceChangedError if simulated time begins or ends meanwhile, CancelledError if the node
        is destroyed meanwhile, RuntimeError if it was destroyed before.
        """
        if self._is_closed:
            raise RuntimeError("cannot sleep by the clock of a destroyed node")
        if duration_sec <= 0:
            await asyncio.sleep(0)
            return
        loop = asyncio.get_running_loop()
        done: asyncio.Future[None] = loop.create_future()
        end: Callable[[], object] | None = None
        if self.ros_time_is_active:
            self._sleeps[done] = self.now().nanoseconds + round(duration_sec * _NS_PER_S)
        else:
            self._sleeps[done] = 0
            end = loop.call_later(duration_sec, _wake, done).cancel
        try:
            await done
        finally:
            del self._sleeps[done]
            if end is not None:
                end()

    def _on_jump(self, jump: TimeJump) -> None:
        if jump.clock_change in CHANGES_OF_SOURCE:
            for sleep in self._sleeps:
                if not sleep.done():
                    sleep.set_exception(TimeSourceChangedError())
            return
        now_ns = self.now().nanoseconds
        for sleep, end_ns in self._sleeps.items():
            if now_ns >= end_ns:
                _wake(sleep)


def _wake(sleep: "asyncio.Future[None]") -> None:
    if not sleep.done():
        sleep.set_result(None)
