"""Errors that whoever started a program can mend, not its author: shown in one line, without a traceback.

Owns which errors these are and how a program ends that does not catch one. Callers that catch them (tests,
notebooks, supervisors) see ordinary exceptions. Must not know nodes.
"""

import sys
from types import TracebackType
from typing import Final

from bus.errors import BrokerUnavailable, CommandLineError, EnvironmentVariableError

__all__ = ["START_ERRORS", "shown_in_one_line", "text_of"]

START_ERRORS: Final = (BrokerUnavailable, CommandLineError, EnvironmentVariableError)


def text_of(error: BaseException) -> str:
    """The line: `BrokerUnavailable: no busd listens on ...`."""
    return f"{type(error).__name__}: {error}"


class _ShownInOneLine:
    """`with shown_in_one_line:` - if the program does not catch a start error of the body, Python prints one
    line for it. The exit status stays 1.

    All other errors go to the hook that was there before. At an interactive prompt and with `python -X dev`
    every error keeps its traceback.
    """

    __slots__ = ()

    def __enter__(self) -> None:
        pass

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # Only now: a program without such an error keeps Python's own hook.
        if kind is not None and issubclass(kind, START_ERRORS):
            _install()


shown_in_one_line: Final = _ShownInOneLine()


def _install() -> None:
    global _before
    if sys.excepthook is not _hook:
        _before, sys.excepthook = sys.excepthook, _hook


def _hook(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if issubclass(kind, START_ERRORS) and not sys.flags.dev_mode and not hasattr(sys, "ps1"):
        print(text_of(error), file=sys.stderr)
    else:
        _before(kind, error, trace)


_before = sys.__excepthook__
