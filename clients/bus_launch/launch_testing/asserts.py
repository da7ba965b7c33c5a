"""Assertions about processes; programs import it as `launch_testing.asserts`."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from bus_launch.launch.events.process import ProcessExited
from bus_launch.launch_testing.lookup import (
    NO_CMD_ARGS,
    NoMatchingProcessException,
    matching,
    resolveProcesses,
    shown,
)
from bus_launch.launch_testing.processes import IoHandler, ProcInfoHandler

__all__ = [
    "EXIT_FORCED",
    "EXIT_OK",
    "EXIT_SIGINT",
    "EXIT_SIGKILL",
    "EXIT_SIGQUIT",
    "EXIT_SIGSEGV",
    "EXIT_SIGTERM",
    "NO_CMD_ARGS",
    "NoMatchingProcessException",
    "SequentialTextChecker",
    "assertDefaultStream",
    "assertExitCodes",
    "assertInStderr",
    "assertInStdout",
    "assertInStream",
    "assertSequentialStdout",
]

__path__: list[str] = []  # there may be modules in it: a file for each assertion, as in ROS 2

EXIT_OK = 0
EXIT_FORCED = 1
EXIT_SIGINT = 130
EXIT_SIGQUIT = 131
EXIT_SIGKILL = 137
EXIT_SIGSEGV = 139
EXIT_SIGTERM = 143


def assertExitCodes(
    proc_info: ProcInfoHandler,
    allowable_exit_codes: Iterable[int] = (EXIT_OK,),
    process: Any = None,
    cmd_args: Any = None,
    *,
    strict_proc_matching: bool = True,
) -> None:
    """Checks the exit code of one process, or of all. For a signal, -2 and 130 mean the same."""
    allowed = list(allowable_exit_codes)
    for code in allowed:
        assert isinstance(code, int), f"Provided exit code {code} is not an int"
    allowed += [128 - code for code in allowed if code > 128] + [128 - code for code in allowed if code < 0]
    for one in resolveProcesses(
        proc_info, process=process, cmd_args=cmd_args, strict_proc_matching=strict_proc_matching
    ):
        event = proc_info[one]
        ended = event.returncode if isinstance(event, ProcessExited) else None
        assert ended in allowed, f"Proc {event.process_name} exited with code {ended}"


def assertInStream(
    proc_output: IoHandler,
    expected_output: Any,
    process: Any,
    cmd_args: Any = None,
    *,
    output_filter: Callable[[str], str] | None = None,
    strict_proc_matching: bool = True,
    strip_ansi_escape_sequences: bool = True,
    stream: str = "stderr",
) -> None:
    """`expected_output`: a text, a pattern, or several in turn, in the output so far."""
    is_there = proc_output.has(
        expected_output,
        process,
        cmd_args,
        stream,
        output_filter,
        is_strict=strict_proc_matching,
        are_escapes_stripped=strip_ansi_escape_sequences,
    )
    assert is_there, (
        f"Did not find '{expected_output}' in output for any of the matching processes: {shown(process)}"
    )


def assertInStdout(
    proc_output: IoHandler, expected_output: Any, process: Any, cmd_args: Any = None, **options: Any
) -> None:
    """As assertInStream, for stdout."""
    assertInStream(proc_output, expected_output, process, cmd_args, stream="stdout", **options)


def assertInStderr(
    proc_output: IoHandler, expected_output: Any, process: Any, cmd_args: Any = None, **options: Any
) -> None:
    """As assertInStream, for stderr."""
    assertInStream(proc_output, expected_output, process, cmd_args, stream="stderr", **options)


def assertDefaultStream() -> str:
    """The stream that assertInStream looks at if none is named."""
    return "stderr"


class SequentialTextChecker:
    """Looks for texts one after the other in the output: a text, or the texts of its events."""

    def __init__(self, output: str | Iterable[str]) -> None:
        self._text = output if isinstance(output, str) else "".join(output)
        self._position = 0

    def assertInText(self, msg: str) -> None:
        position = self._text.find(msg, self._position)
        assert position >= 0, (
            f"'{msg}' not found in sequence after previous match.  "
            f"The output near the last matched line:\n{self.get_nearby_lines()}"
        )
        self._position = position + len(msg)

    assertInStdout = assertInText

    def get_nearby_lines(self) -> str:
        """The line of the last match, two lines before it and two after it."""
        before, after = self._text[: self._position], self._text[self._position :]
        return "\n".join(before.split("\n")[-3:]) + "\n".join(after.split("\n")[:3])


@contextmanager
def assertSequentialStdout(
    proc_output: IoHandler, process: Any, cmd_args: Any = None
) -> Iterator[SequentialTextChecker]:
    """`with ... as stdout: stdout.assertInStdout("first"); stdout.assertInStdout("second")`."""
    yield SequentialTextChecker(proc_output.text(matching(proc_output, process, cmd_args), "stdout"))
