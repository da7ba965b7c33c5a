"""Small parts of executors: errors, the interface of their nodes, the order of a round, nested spins, and
names for executors of programs."""

import sys
from collections import deque
from collections.abc import Callable, Coroutine, Iterable, Iterator
from contextlib import contextmanager
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
    "go_on_with_round",
    "spin_nested",
    "woken_by",
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


def go_on_with_round(executor: Any) -> None:
    """In a round, each ready entity gets one call, in the order of rclpy's wait sets.

    An entity or timer that becomes ready meanwhile waits for the next round. So many messages do not delay
    timers, and timers that are always due do not delay messages.
    """
    if executor._left > 0:
        executor._left -= 1
        return
    ready: deque[Any] = executor.ready
    executor._left = len(ready) - 1
    ordered = sorted(ready, key=_PLACE)
    ready.clear()
    ready.extend(ordered)


def spin_nested(executor: Any, *args: Any) -> bool:
    """Spin in a callback of the executor, without a second call of it: the entity waits in its queue.

    Returns False, and does not spin, if this thread is in none of its callbacks, or the entity may get calls,
    or waits already. Entities of reentrant groups, actions and clients may get several calls at a time.
    """
    entity, engine = _entity_called_here(executor), executor._engine
    if entity is None or entity.held_group is None or not entity.rank:
        return False
    if not entity.is_exclusive or entity.is_closed:
        return False
    with engine.loop:
        entity.is_closed = True
        engine.held += 1  # so executors look at each entity
    try:
        executor._spin_once(*args)
        return True
    finally:
        with engine.loop:
            entity.is_closed = False
            engine.held -= 1
            while engine.passed_over:
                engine.passed_over.pop().wake_up()


def _entity_called_here(executor: Any) -> Any:
    """The entity whose callback of the executor runs innermost in this thread; None if none does.

    To note the thread of each call would cost more.
    """
    spin = sys._getframe(2)  # of `_spin_once`, which called `spin_nested`
    frame = spin.f_back
    while frame is not None:
        if frame.f_code is spin.f_code and frame.f_locals["self"] is executor and "entity" in frame.f_locals:
            return frame.f_locals["entity"]
        frame = frame.f_back
    return None


@contextmanager
def woken_by(future: Any, wake: Callable[[], None]) -> Iterator[None]:
    """Call `wake` when the future is done."""
    future.call_when_done(wake)
    try:
        yield
    finally:
        future.forget_waiter(wake)


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
