"""The decorator of fixtures that return launch descriptions."""

from collections.abc import Callable
from typing import Any, NamedTuple

import pytest

__all__ = ["LaunchOptions", "fixture", "options_of"]

_OPTIONS = "__launch_options__"


class LaunchOptions(NamedTuple):
    """Options of a fixture."""

    name: str
    scope: str
    shutdown_when_idle: bool
    auto_shutdown: bool


def fixture(
    decorated: Callable[..., Any] | None = None,
    *args: Any,
    shutdown_when_idle: bool = True,
    auto_shutdown: bool = True,
    **kwargs: Any,
) -> Any:
    """A pytest fixture whose launch description runs for the tests that name it in their mark.

    The function returns a LaunchDescription, or a sequence that begins with one. The launch starts with the
    fixture, and ends before tests that run after it. `shutdown_when_idle`: it ends when all processes have
    ended. `auto_shutdown`: it is ended after its tests; otherwise pytest waits until it ends. Other arguments
    are those of `pytest.fixture`.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        name = kwargs.get("name") or function.__name__
        scope = str(kwargs.get("scope", "function"))
        options = LaunchOptions(name, scope, shutdown_when_idle, auto_shutdown)
        made = pytest.fixture(*args, **kwargs)(function)
        for one in (function, made):
            setattr(one, _OPTIONS, options)
        return made

    return decorate if decorated is None else decorate(decorated)


def options_of(function: Any) -> LaunchOptions | None:
    """The options of a decorated function or its fixture; None if it is neither."""
    return getattr(function, _OPTIONS, None)
