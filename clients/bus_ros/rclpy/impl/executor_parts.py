"""Small parts of executors: errors, the interface of their nodes, and names for executors of programs."""

from collections import deque
from collections.abc import Callable, Coroutine, Iterable
from operator import attrgetter
from typing import Any, Protocol
from weakref import ref

from bus_ros.entity import Owner

__all__ = [
    "ConditionReachedException",
    "ExecutedNode",
    "ShutdownException",
    "TimeoutException",
    "TimeoutObject",
    "WakeGuard",
    "await_or_execute",
    "put_in_order",
]

_PLACE = attrgetter("place")


class ExecutedNode(Owner, Protocol):
    """The interface of a node for its executor."""

    own_executor: Any
    last_executor: "ref[Any] | None"

    @property
    def timers(self) -> Iterable[Any]: ...


class TimeoutException(Exception):
    """The time was over before any callback was ready."""


class ShutdownException(Exception):
    """The executor was shut down while it waited."""


class ConditionReachedException(Exception):
    """The condition of the wait is true."""


def put_in_order(ready: deque[Any]) -> None:
    """Sort entities by their places in a round."""
    ordered = sorted(ready, key=_PLACE)
    ready.clear()
    ready.extend(ordered)


async def await_or_execute(callback: Callable[..., Any], *args: Any) -> Any:
    """Call a callback, and await its result if that is a coroutine."""
    result = callback(*args)
    return await result if isinstance(result, Coroutine) else result


class TimeoutObject:
    """Seconds to wait; a program may change them from one wait to the next."""

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout


class WakeGuard:
    """Replaces the guard condition by which rclpy wakes an executor: `trigger` makes it look again."""

    callback = None
    callback_group = None

    def __init__(self, wake: Callable[[], None]) -> None:
        self.trigger = wake

    def destroy(self) -> None:
        """Does nothing: it ends with the executor."""
