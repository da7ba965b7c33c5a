"""Errors that the user of a program can fix, not its author: shown in one line, without a traceback.

Owns the list of these errors, and the end of a program that does not catch one. Callers that catch them
(tests, notebooks, supervisors) see ordinary exceptions. Must not know nodes.
"""

import os
import sys
from types import TracebackType
from typing import Final

from bus.errors import BrokerUnavailable, CommandLineError, StartError

__all__ = ["START_ERRORS", "check_descriptors", "shown_in_one_line", "text_of"]

START_ERRORS: Final = (BrokerUnavailable, CommandLineError, StartError)

_MIN_DESCRIPTORS = 32
"""Enough for an event loop, the connection to busd, the start of a busd, and rings of a few topics."""


def check_descriptors() -> None:
    """Raise StartError if the limit of open files is too low for any node."""
    limit = os.sysconf("SC_OPEN_MAX")  # the soft limit, without an import of `resource`
    if 0 <= limit < _MIN_DESCRIPTORS:
        with shown_in_one_line:
            raise StartError(
                f"this process may open {limit} files (soft limit RLIMIT_NOFILE), but a program on the bus "
                f"needs {_MIN_DESCRIPTORS} or more: try ulimit -n 1024 in the shell that starts it"
            )


def text_of(error: BaseException) -> str:
    """The line for an error: `BrokerUnavailable: no busd listens on ...`."""
    return f"{type(error).__name__}: {error}"


class _ShownInOneLine:
    """For `with shown_in_one_line:`. Python prints one line for an uncaught start error of the body.

    The exit status stays 1. All other errors go to the previous hook. At an interactive prompt and with
    `python -X dev`, every error keeps its traceback.
    """

    __slots__ = ()

    def __enter__(self) -> None:
        pass

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # Installed only now: a program without such an error keeps Python's own hook.
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
