"""The tests' view of the processes of a launch: their output and their end, from another thread.

Owns: the output so far, and waiting for more. Must not know: unittest, how the launch runs.
"""

import threading
from collections.abc import Callable, Iterator
from typing import Any

from bus_launch.launch.core import LaunchDescriptionEntity
from bus_launch.launch.events.process import ProcessExited, ProcessIO, RunningProcessEvent

__all__ = ["ActiveIoHandler", "ActiveProcInfoHandler", "NoMatchingProcessException", "matching"]


class NoMatchingProcessException(Exception):
    """No process has such a name, or was started by such an action."""


class _Watched:
    def __init__(self) -> None:
        self._news = threading.Condition()

    def _wait_for(self, is_true: Callable[[], bool], timeout: float | None) -> bool:
        with self._news:
            return self._news.wait_for(is_true, timeout)


class ActiveProcInfoHandler(_Watched):
    """The last event of each process: `handler[process].returncode` once it has ended.

    A process is given by its action, its name (`talker-1`), or a part of its name or command.
    """

    def __init__(self) -> None:
        super().__init__()
        self._events: dict[LaunchDescriptionEntity, RunningProcessEvent] = {}

    def append(self, event: RunningProcessEvent) -> None:
        with self._news:
            self._events[event.action] = event
            self._news.notify_all()

    def __iter__(self) -> Iterator[RunningProcessEvent]:
        return iter(list(self._events.values()))

    def __getitem__(self, process: Any) -> RunningProcessEvent:
        return self._events[matching(self, process)]

    def processes(self) -> list[LaunchDescriptionEntity]:
        return list(self._events)

    def process_names(self) -> list[str]:
        return [event.process_name for event in self]

    def names_of(self, action: LaunchDescriptionEntity) -> tuple[str, str]:
        event = self._events[action]
        return event.process_name, " ".join(event.cmd)

    def assertWaitForStartup(self, process: Any, cmd_args: Any = None, *, timeout: float = 10) -> None:
        """Raises AssertionError if it has not started within `timeout` seconds."""
        assert self._wait_for(lambda: self._find(process) is not None, timeout), (
            f"Timed out waiting for process '{_shown(process)}' to start"
        )

    def assertWaitForShutdown(self, process: Any, cmd_args: Any = None, *, timeout: float = 10) -> None:
        """Raises AssertionError if it has not ended within `timeout` seconds."""
        assert self._wait_for(lambda: isinstance(self._find(process), ProcessExited), timeout), (
            f"Timed out waiting for process '{_shown(process)}' to finish"
        )

    def _find(self, process: Any) -> RunningProcessEvent | None:
        try:
            return self[process]
        except NoMatchingProcessException:
            return None


class ActiveIoHandler(_Watched):
    """All that each process has written: `handler[process]`, as events with `text`."""

    def __init__(self, processes: ActiveProcInfoHandler) -> None:
        super().__init__()
        self._processes = processes
        self._events: list[ProcessIO] = []

    def append(self, event: ProcessIO) -> None:
        with self._news:
            self._events.append(event)
            self._news.notify_all()

    def __iter__(self) -> Iterator[ProcessIO]:
        return iter(list(self._events))

    def __getitem__(self, process: Any) -> list[ProcessIO]:
        action = matching(self._processes, process)
        return [event for event in self if event.action is action]

    def processes(self) -> list[LaunchDescriptionEntity]:
        return list(dict.fromkeys(event.action for event in self))

    def process_names(self) -> list[str]:
        return list(dict.fromkeys(event.process_name for event in self))

    def text(self, process: Any = None, stream: str | None = None) -> str:
        """The output of one process, or of all, on stdout, stderr or both."""
        events = list(self) if process is None else self[process]
        wanted = [event for event in events if stream is None or event.from_stderr == (stream == "stderr")]
        return b"".join(event.text for event in wanted).decode(errors="replace")

    def waitFor(
        self,
        expected_output: Any,
        process: Any = None,
        cmd_args: Any = None,
        *,
        timeout: float = 10,
        stream: str = "stderr",
        strip_ansi_escape_sequences: bool = True,
        **ignored: Any,
    ) -> bool:
        """Whether a text, a match of a pattern, or several in turn, come within `timeout` seconds."""

        def has_come() -> bool:
            try:
                return contains(self.text(process, stream), expected_output)
            except NoMatchingProcessException:
                return False  # it is about to start

        return self._wait_for(has_come, timeout)

    def assertWaitFor(self, expected_output: Any, process: Any = None, *args: Any, **kwargs: Any) -> None:
        """As `waitFor`; raises AssertionError if it does not come."""
        assert self.waitFor(expected_output, process, *args, **kwargs), (
            f"Waiting for output timed out: {_shown(expected_output)!r} did not come"
            f"{'' if process is None else f' from {_shown(process)}'}"
        )


def contains(text: str, expected: Any) -> bool:
    """A text stands in it; a pattern matches somewhere; of several, one after the other."""
    position = 0
    for one in expected if isinstance(expected, list | tuple) else [expected]:
        if hasattr(one, "search"):
            match = one.search(text, position)
            if match is None:
                return False
            position = match.end()
        else:
            found = text.find(str(one), position)
            if found < 0:
                return False
            position = found + len(str(one))
    return True


def matching(processes: ActiveProcInfoHandler, process: Any) -> LaunchDescriptionEntity:
    """The action of a process; raises NoMatchingProcessException if no process, or more than one, is
    meant.
    """
    known = processes.processes()
    if isinstance(process, LaunchDescriptionEntity):
        if process in known:
            return process
        raise NoMatchingProcessException(f"Did not find any processes matching {_shown(process)}")
    exact = [one for one in known if processes.names_of(one)[0] == process]
    found = exact or [one for one in known if any(process in name for name in processes.names_of(one))]
    if len(found) == 1:
        return found[0]
    names = ", ".join(processes.process_names())
    problem = "Did not find any" if not found else "Found several"
    raise NoMatchingProcessException(f"{problem} processes matching '{process}'; there are: {names}")


def _shown(one: Any) -> str:
    return one.describe() if isinstance(one, LaunchDescriptionEntity) else str(one)
