"""When tests may begin: after several calls, and at the latest after some time."""

import threading
from collections.abc import Callable
from typing import Final, TypeVar

__all__ = ["TIMEOUT_S", "ReadyAggregator", "ready_to_test_action_timeout"]

TIMEOUT_S: Final = 15.0
"""Seconds until a launch must be ready, unless its description says how many."""

_T = TypeVar("_T")


class ReadyAggregator:
    """Calls `ready_fn` of a test description at the n-th call of its own `ready_fn`."""

    def __init__(self, ready_fn: Callable[[], object], num_to_aggregate: int) -> None:
        self._call = ready_fn
        self._missing = num_to_aggregate
        self._lock = threading.Lock()

    def ready_fn(self) -> None:
        with self._lock:
            self._missing -= 1
            is_last = self._missing == 0
        if is_last:
            self._call()


def ready_to_test_action_timeout(timeout: float) -> Callable[[_T], _T]:
    """Decorates generate_test_description: tests fail if ReadyToTest has not run `timeout` seconds later."""

    def mark(function: _T) -> _T:
        function.__ready_to_test_action_timeout__ = timeout  # type: ignore[attr-defined]
        return function

    return mark
