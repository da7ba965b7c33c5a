"""A process that a test starts in the launch, with its output."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from bus_launch.launch.actions import ExecuteLocal, ExecuteProcess
from bus_launch.launch.events import matches_action
from bus_launch.launch.events.process import ProcessExited, ProcessStarted, ShutdownProcess
from bus_launch.launch.launch_description import LaunchDescription
from bus_launch.launch.launch_service import LaunchService
from bus_launch.launch.utilities import ensure_argument_type
from bus_launch.launch_testing.processes import ActiveIoHandler, ActiveProcInfoHandler

__all__ = ["ProcessProxy", "launch_process"]


class ProcessProxy:
    """The state and the output of the process of `process_action`; `output_filter` changes the output."""

    def __init__(
        self,
        process_action: ExecuteLocal,
        proc_info: ActiveProcInfoHandler,
        proc_output: ActiveIoHandler,
        *,
        output_filter: Callable[[str], str] | None = None,
    ) -> None:
        ensure_argument_type(process_action, ExecuteProcess, "process_action")
        ensure_argument_type(proc_info, ActiveProcInfoHandler, "proc_info")
        ensure_argument_type(proc_output, ActiveIoHandler, "proc_output")
        if output_filter is not None and not callable(output_filter):
            raise TypeError(f"Expected 'output_filter' to be callable but got '{output_filter!r}'")
        self._action = process_action
        self._info = proc_info
        self._output = proc_output
        self._filter = output_filter

    def wait_for_shutdown(self, timeout: float | None = None) -> bool:
        """Wait for the end of the process; returns whether it came within the time."""
        with self._info.proc_event:
            return self._info.proc_event.wait_for(lambda: self.terminated, timeout)

    def wait_for_output(
        self, condition: Callable[[str], object] | None = None, timeout: float | None = None
    ) -> "Found":
        """Whether `condition(output)` becomes true within the time, while the process runs.

        Without a condition, this waits until the process runs. The result shows the last output that it
        looked at.
        """
        if condition is not None and not callable(condition):
            raise TypeError(f"Expected 'condition' to be callable but got '{condition!r}'")
        found = Found()

        def is_true() -> bool:
            if not self.running:
                return False
            found.output = self.output
            return condition is None or bool(condition(found.output))

        with self._output.io_event:
            found.is_found = bool(self._output.io_event.wait_for(is_true, timeout))
        return found

    @property
    def target_process_action(self) -> ExecuteLocal:
        return self._action

    @property
    def stderr(self) -> str:
        return self._text("stderr")

    @property
    def stdout(self) -> str:
        return self._text("stdout")

    @property
    def output(self) -> str:
        return self._text(None)

    @property
    def running(self) -> bool:
        return self._is_in(ProcessStarted)

    @property
    def terminated(self) -> bool:
        return self._is_in(ProcessExited)

    @property
    def exit_code(self) -> int:
        """Raises KeyError before the process has started, AttributeError while it runs."""
        code: int = self._info[self._action].returncode  # type: ignore[attr-defined]
        return code

    def _is_in(self, state: type[ProcessStarted | ProcessExited]) -> bool:
        return self._action in self._info.processes() and isinstance(self._info[self._action], state)

    def _text(self, stream: str | None) -> str:
        is_known = self._action in self._output.processes()
        text = self._output.text(self._action, stream) if is_known else ""
        return text if self._filter is None else self._filter(text)


class Found:
    """The result of a wait: true or false, with the output for messages of assertions."""

    def __init__(self) -> None:
        self.is_found = False
        self.output: str | None = None

    def __bool__(self) -> bool:
        return self.is_found

    def __repr__(self) -> str:
        return f"<{self.is_found}: {self.output!r}>"


@contextmanager
def launch_process(
    launch_service: LaunchService,
    process_action: ExecuteLocal,
    proc_info: ActiveProcInfoHandler,
    proc_output: ActiveIoHandler,
    **kwargs: Any,
) -> Iterator[ProcessProxy]:
    """Start a process in a running launch; yields its ProcessProxy, and ends the process after that."""
    proxy = ProcessProxy(process_action, proc_info, proc_output, **kwargs)
    launch_service.include_launch_description(LaunchDescription([process_action]))
    try:
        yield proxy
    finally:
        if not proxy.terminated:
            launch_service.emit_event(ShutdownProcess(process_matcher=matches_action(process_action)))
