"""What executors of a program's own use beside `wait_for_ready_callbacks`, by rclpy's names."""

from collections.abc import Callable, Coroutine
from typing import Any

__all__ = ["TimeoutObject", "WakeGuard", "await_or_execute"]


async def await_or_execute(callback: Callable[..., Any], *args: Any) -> Any:
    """Call it, and await what it returns where that is a coroutine."""
    result = callback(*args)
    return await result if isinstance(result, Coroutine) else result


class TimeoutObject:
    """Seconds to wait, which may be changed from one wait to the next."""

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout


class WakeGuard:
    """Stands for the guard condition by which rclpy wakes an executor: `trigger` has it look again."""

    callback = None
    callback_group = None

    def __init__(self, wake: Callable[[], None]) -> None:
        self.trigger = wake

    def destroy(self) -> None:
        """The executor's end ends it."""
