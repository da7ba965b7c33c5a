"""Tests of the processes of a launch file; programs import it as `launch_testing`.

A file with `generate_test_description()` and unittest's classes: `bus test FILE` runs it.

`runner.py` runs the launch in its own thread and the tests in another. `processes.py` has the tests' view of
processes, `lookup.py` finds them by name, `text.py` searches their output. `asserts.py`, `tools/`,
`actions.py`, `event_handlers.py`, `ready.py`, `markers.py` and `util.py` are for tests; `pytest/` is a plugin
for pytest.

Invariants: signals come to the launch's thread. Data goes from the launch to the tests through `processes.py`
only. Names and texts are those of the package launch_testing in ROS 2's launch (Jazzy).

Read first: `runner.py`. Tests: `tests/unit/bus_launch/launch_testing/`,
`tests/system/test_launch_processes.py`.
"""

import functools
import inspect
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar

from bus_launch.launch_testing import actions, asserts, event_handlers, markers, tools, util
from bus_launch.launch_testing.processes import (
    ActiveIoHandler,
    ActiveProcInfoHandler,
    IoHandler,
    ProcInfoHandler,
)
from bus_launch.launch_testing.ready import ReadyAggregator, ready_to_test_action_timeout

__all__ = [
    "ActiveIoHandler",
    "ActiveProcInfoHandler",
    "IoHandler",
    "ProcInfoHandler",
    "ReadyAggregator",
    "actions",
    "asserts",
    "event_handlers",
    "markers",
    "parametrize",
    "post_shutdown_test",
    "ready_to_test_action_timeout",
    "tools",
    "util",
]

_T = TypeVar("_T")
_Row = tuple[Callable[..., Any], dict[str, Any]]


def post_shutdown_test() -> Callable[[type[_T]], type[_T]]:
    """Decorates a class whose tests run when all processes have ended; raises TypeError for no class."""

    def mark(test: type[_T]) -> type[_T]:
        if not inspect.isclass(test):
            raise TypeError(f"post_shutdown_test decorates classes of tests, not {test!r}")
        test.__post_shutdown_test__ = True  # type: ignore[attr-defined]
        return test

    return mark


def parametrize(
    argnames: str | Iterable[str], argvalues: Iterable[Any]
) -> Callable[[Callable[..., Any]], Callable[[], Iterator[_Row]]]:
    """Decorates generate_test_description: the tests run once with each of the values.

    The result is a function without arguments. It yields the function for each launch, and its arguments.
    """
    names = argnames.replace(",", " ").split() if isinstance(argnames, str) else list(argnames)
    rows = [value if isinstance(value, tuple) else (value,) for value in argvalues]

    def mark(function: Callable[..., Any]) -> Callable[[], Iterator[_Row]]:
        @functools.wraps(function)
        def each() -> Iterator[_Row]:
            for row in rows:
                given = dict(zip(names, row, strict=True))
                one = functools.partial(function, **given)
                functools.update_wrapper(one, function)
                yield one, given

        each.__parametrized__ = True  # type: ignore[attr-defined]
        return each

    return mark
