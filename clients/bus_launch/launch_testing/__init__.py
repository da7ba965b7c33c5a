"""Tests of the processes of a launch file; programs import it as `launch_testing`.

A file with `generate_test_description()` and unittest's classes: `bus test FILE` runs it.

`runner.py` runs the launch in its own thread and the tests in another; `processes.py` has what tests see of
processes; `asserts.py`, `actions.py`, `markers.py` and `util.py` are for tests.

Invariants: signals come to the launch's thread; data goes from the launch to the tests through `processes.py`
only; names and texts are ROS 2's.

Read first: `runner.py`. Tests: `tests/unit/bus_launch/launch_testing/`,
`tests/system/test_launch_processes.py`.
"""

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

from bus_launch.launch_testing import actions, asserts, markers, util
from bus_launch.launch_testing.processes import ActiveIoHandler, ActiveProcInfoHandler

__all__ = [
    "ActiveIoHandler",
    "ActiveProcInfoHandler",
    "actions",
    "asserts",
    "markers",
    "parametrize",
    "post_shutdown_test",
    "util",
]

_T = TypeVar("_T")


def post_shutdown_test() -> Callable[[type[_T]], type[_T]]:
    """Decorates a class whose tests run when all processes have ended."""

    def mark(test: type[_T]) -> type[_T]:
        test.__post_shutdown_test__ = True  # type: ignore[attr-defined]
        return test

    return mark


def parametrize(argnames: str | Iterable[str], argvalues: Iterable[Any]) -> Callable[[_T], _T]:
    """Decorates generate_test_description: the tests run once with each of the values."""
    names = argnames.replace(",", " ").split() if isinstance(argnames, str) else list(argnames)

    def mark(function: _T) -> _T:
        rows = [value if len(names) > 1 else (value,) for value in argvalues]
        function.__parametrized__ = [dict(zip(names, row, strict=True)) for row in rows]  # type: ignore[attr-defined]
        return function

    return mark
