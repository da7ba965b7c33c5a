"""Decorators of tests; programs import it as `launch_testing.markers`."""

import functools
import time
from collections.abc import Callable
from typing import Any, TypeVar

__all__ = ["keep_alive", "retry_on_failure"]

_T = TypeVar("_T")


def keep_alive(function: _T) -> _T:
    """Decorates generate_test_description: tests go on when all processes have ended. Here they always do."""
    return function


def retry_on_failure(*, times: int, delay: float | None = None) -> Callable[[Any], Any]:
    """Decorates a test: up to `times` attempts before it counts as failed, `delay` seconds apart.

    Raises ValueError for `times` below 1.
    """
    if times < 1:
        raise ValueError(f"times must be at least 1, not {times}")

    def mark(function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def run(self: Any, *arguments: Any, **named: Any) -> Any:
            for _ in range(times - 1):
                try:
                    return function(self, *arguments, **named)
                except AssertionError:
                    if delay is not None:
                        time.sleep(delay)
            return function(self, *arguments, **named)

        return run

    return mark
