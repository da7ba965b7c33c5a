"""The tests' view of the processes of a launch: their output and their end, from another thread.

Owns: the output so far, and waiting for more. Must not know: unittest, how the launch runs.
"""

import threading
from collections.abc import Callable, Iterator
from typing import Any

from bus_launch.launch.core import LaunchDescriptionEntity
from bus_launch.launch.events.process import ProcessExited, ProcessIO, RunningProcessEvent
from bus_launch.launch_testing.lookup import NoMatchingProcessException, resolveProcesses, shown
from bus_launch.launch_testing.text import build_text_match, without_escapes

__all__ = [
    "ActiveIoHandler",
    "ActiveProcInfoHandler",
    "IoHandler",
    "NoMatchingProcessException",
    "ProcInfoHandler",
]


class _NoSuchProcess(NoMatchingProcessException, KeyError):
    __str__ = Exception.__str__


class _Handler:
    """Processes by their actions, with their names."""

    def __init__(self) -> None:
        self._news = threading.Condition()
        self._commands: dict[Any, tuple[str, list[str]]] = {}

    def _know(self, event: RunningProcessEvent) -> None:
        if event.action not in self._commands:
            self._commands[event.action] = (event.process_name, list(event.cmd))

    def command_of(self, action: Any) -> tuple[str, list[str]]:
        """The name and the command line of a process."""
        return self._commands[action]

    def processes(self) -> list[Any]:
        return list(self._commands)

    def process_names(self) -> list[str]:
        return [name for name, _ in self._commands.values()]

    def _action(self, process: Any) -> LaunchDescriptionEntity:
        """A known action, or the action of the first process with this name, or with this part of it."""
        if not isinstance(process, str) and process in self._commands:
            known: LaunchDescriptionEntity = process
            return known
        try:
            found: LaunchDescriptionEntity = resolveProcesses(
                self, process=process, strict_proc_matching=False
            )[0]
        except NoMatchingProcessException as error:
            raise _NoSuchProcess(str(error)) from None
        return next((one for one in self.processes() if self.command_of(one)[0] == process), found)

    def _wait_for(self, is_true: Callable[[], bool], timeout: float | None) -> bool:
        with self._news:
            return self._news.wait_for(is_true, timeout)


class ProcInfoHandler(_Handler):
    """The last event of each process: `handler[process].returncode` once it has ended.

    A process is given by its action, its name (`talker-1`), or a part of its name.
    """

    def __init__(self) -> None:
        super().__init__()
        self._events: dict[LaunchDescriptionEntity, RunningProcessEvent] = {}

    def append(self, event: RunningProcessEvent) -> None:
        with self._news:
            self._know(event)
            self._events[event.action] = event
            self._news.notify_all()

    def __iter__(self) -> Iterator[RunningProcessEvent]:
        return iter(list(self._events.values()))

    def __getitem__(self, process: Any) -> RunningProcessEvent:
        return self._events[self._action(process)]


class ActiveProcInfoHandler(ProcInfoHandler):
    """A ProcInfoHandler that can wait for processes to start and to end."""

    @property
    def proc_event(self) -> threading.Condition:
        return self._news

    def assertWaitForStartup(self, process: Any, cmd_args: Any = None, *, timeout: float = 10) -> None:
        """Raises AssertionError if it has not started within `timeout` seconds."""
        assert self._wait_for(lambda: self._find(process, cmd_args) is not None, timeout), (
            f"Timed out waiting for process '{shown(process)}' to start"
        )

    def assertWaitForShutdown(self, process: Any, cmd_args: Any = None, *, timeout: float = 10) -> None:
        """Raises AssertionError if it has not ended within `timeout` seconds."""
        assert self._wait_for(lambda: isinstance(self._find(process, cmd_args), ProcessExited), timeout), (
            f"Timed out waiting for process '{shown(process)}' to finish"
        )

    def _find(self, process: Any, cmd_args: Any) -> RunningProcessEvent | None:
        try:
            return self._events[resolveProcesses(self, process=process, cmd_args=cmd_args)[0]]
        except NoMatchingProcessException:
            return None


class IoHandler(_Handler):
    """All that each process has written: `handler[process]`, as events with `text`."""

    def __init__(self) -> None:
        super().__init__()
        self._events: list[ProcessIO] = []

    def append(self, event: ProcessIO) -> None:
        with self._news:
            self._know(event)
            self._events.append(event)
            self._news.notify_all()

    def track(self, process_name: str) -> None:
        """Does nothing: a process is known from its first output on."""

    def __iter__(self) -> Iterator[ProcessIO]:
        return iter(list(self._events))

    def __getitem__(self, process: Any) -> list[ProcessIO]:
        action = self._action(process)
        return [event for event in self if event.action is action]

    def text(self, process: Any = None, stream: str | None = None) -> str:
        """The output of one process, or of all, on stdout, stderr or both."""
        events = list(self) if process is None else self[process]
        wanted = [event for event in events if stream is None or event.from_stderr == (stream == "stderr")]
        return b"".join(event.text for event in wanted).decode(errors="replace")

    def has(
        self,
        expected: Any,
        process: Any,
        cmd_args: Any,
        stream: str,
        output_filter: Callable[[str], str] | None = None,
        *,
        is_strict: bool = True,
        are_escapes_stripped: bool = True,
    ) -> bool:
        """Whether one of the meant processes has written what is expected. Raises ValueError for a wrong
        stream or filter, NoMatchingProcessException for no or several processes.
        """
        if stream not in ("stdout", "stderr"):
            raise ValueError("Invalid value for stream; must be 'stdout' or 'stderr'")
        if output_filter is not None and not callable(output_filter):
            raise ValueError("output_filter is not callable")
        match = build_text_match(expected)
        for one in resolveProcesses(self, process=process, cmd_args=cmd_args, strict_proc_matching=is_strict):
            text = self.text(one, stream)
            if are_escapes_stripped:
                text = without_escapes(text)
            if match(text if output_filter is None else output_filter(text)) is not None:
                return True
        return False


class ActiveIoHandler(IoHandler):
    """An IoHandler that can wait for output."""

    @property
    def io_event(self) -> threading.Condition:
        return self._news

    def waitFor(
        self,
        expected_output: Any,
        process: Any = None,
        cmd_args: Any = None,
        *,
        strict_proc_matching: bool = True,
        output_filter: Callable[[str], str] | None = None,
        timeout: float = 10,
        strip_ansi_escape_sequences: bool = True,
        stream: str = "stderr",
    ) -> bool:
        """Wait for a text, a pattern, or several in turn; returns whether they came within `timeout` seconds.

        As in ROS 2, only stderr is looked at if no stream is named.
        """

        def has_come() -> bool:
            try:
                return self.has(
                    expected_output,
                    process,
                    cmd_args,
                    stream,
                    output_filter,
                    is_strict=strict_proc_matching,
                    are_escapes_stripped=strip_ansi_escape_sequences,
                )
            except NoMatchingProcessException:
                return False

        return self._wait_for(has_come, timeout)

    def assertWaitFor(self, expected_output: Any, process: Any = None, *args: Any, **kwargs: Any) -> None:
        """As `waitFor`; raises AssertionError if it does not come."""
        assert self.waitFor(expected_output, process, *args, **kwargs), (
            f"Waiting for output timed out: {shown(expected_output)!r} did not come"
            f"{'' if process is None else f' from {shown(process)}'}"
        )
