"""Assertions about processes; programs import it as `launch_testing.asserts`."""

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from bus_launch.launch.events.process import ProcessExited
from bus_launch.launch_testing.processes import (
    ActiveIoHandler,
    ActiveProcInfoHandler,
    NoMatchingProcessException,
    contains,
)

__all__ = [
    "EXIT_FORCED",
    "EXIT_OK",
    "EXIT_SIGINT",
    "EXIT_SIGKILL",
    "EXIT_SIGQUIT",
    "EXIT_SIGSEGV",
    "EXIT_SIGTERM",
    "NoMatchingProcessException",
    "SequentialTextChecker",
    "assertExitCodes",
    "assertInStderr",
    "assertInStdout",
    "assertSequentialStdout",
]

EXIT_OK = 0
EXIT_FORCED = 1
EXIT_SIGINT = -2
EXIT_SIGQUIT = -3
EXIT_SIGKILL = -9
EXIT_SIGSEGV = -11
EXIT_SIGTERM = -15


def assertExitCodes(
    proc_info: ActiveProcInfoHandler,
    allowable_exit_codes: Iterable[int] = (EXIT_OK,),
    process: Any = None,
    cmd_args: Any = None,
) -> None:
    """Checks the exit code of one process, or of all."""
    allowed = list(allowable_exit_codes)
    for event in list(proc_info) if process is None else [proc_info[process]]:
        code = event.returncode if isinstance(event, ProcessExited) else None
        assert code in allowed, f"Proc {event.process_name} exited with code {code}"


def assertInStdout(
    proc_output: ActiveIoHandler, expected_output: Any, process: Any, cmd_args: Any = None, **ignored: Any
) -> None:
    """`expected_output`: a text, a pattern, or several in turn."""
    _assert_in(proc_output, expected_output, process, "stdout")


def assertInStderr(
    proc_output: ActiveIoHandler, expected_output: Any, process: Any, cmd_args: Any = None, **ignored: Any
) -> None:
    """`expected_output`: a text, a pattern, or several in turn."""
    _assert_in(proc_output, expected_output, process, "stderr")


def _assert_in(proc_output: ActiveIoHandler, expected: Any, process: Any, stream: str) -> None:
    assert contains(proc_output.text(process, stream), expected), (
        f"Did not find '{expected}' in output for any of the matching process: {process}"
    )


class SequentialTextChecker:
    """Looks for texts one after the other."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._position = 0

    def assertInText(self, msg: str) -> None:
        match = re.compile(re.escape(msg)).search(self._text, self._position)
        assert match is not None, f"'{msg}' not found in text"
        self._position = match.end()

    assertInStdout = assertInText


@contextmanager
def assertSequentialStdout(
    proc_output: ActiveIoHandler, process: Any, cmd_args: Any = None
) -> Iterator[SequentialTextChecker]:
    """`with ... as stdout: stdout.assertInStdout("first"); stdout.assertInStdout("second")`."""
    yield SequentialTextChecker(proc_output.text(process, "stdout"))
