"""One action's process, from its first start to its end for good: output, exit code, signals, respawn.

Owns: the process and its state (`process_state`). Must not know: handlers of events, and the configuration of
the action.
"""

import asyncio
import signal
from collections.abc import Callable
from typing import Any, Final, Protocol

from bus_launch.launch import logging
from bus_launch.launch.actions.process_lines import ProcessLines
from bus_launch.launch.actions.process_state import ProcessEvent, ProcessState, next_state
from bus_launch.launch.core import LaunchContext
from bus_launch.launch.events.process import (
    ProcessExited,
    ProcessIO,
    ProcessStarted,
    ProcessStderr,
    ProcessStdout,
)

__all__ = ["Process", "ProcessRun", "shown_command"]

_LAST_OUTPUT_S: Final = 0.5
"""After a process has ended, output of the processes that it has started is read for this long."""

_FAILED_START_S: Final = 1.0
"""After a start that failed, the next one comes no sooner: its reason, such as a missing file, may last."""


class Output(Protocol):
    """A stream that a process writes to."""

    async def read(self) -> bytes:
        """The next bytes; none at its end."""


class Process(Protocol):
    """A process that was started: a `launch.child.Child`."""

    @property
    def pid(self) -> int: ...
    @property
    def stdout(self) -> Output: ...
    @property
    def stderr(self) -> Output: ...
    async def wait(self) -> int: ...
    def send_signal(self, number: int) -> None: ...
    def close(self) -> None: ...


class ProcessRun:
    """Runs the process that `start` starts, and again up to `respawns` times; below zero: without limit.

    `details` are the arguments of its events; the pid is added. `patience_s`: how long it may take to end
    after SIGINT, and then after SIGTERM.
    """

    def __init__(
        self,
        context: LaunchContext,
        details: dict[str, Any],
        start: Callable[[], Process],
        lines: ProcessLines,
        *,
        patience_s: tuple[float, float],
        respawns: int,
        respawn_delay_s: float,
    ) -> None:
        """Needs a running event loop; the process is started in the loop's next turn."""
        self._context = context
        self._details = details
        self._start = start
        self.lines = lines
        self._patience_s = patience_s
        self._respawns_left = respawns
        self._respawn_delay_s = respawn_delay_s
        self._logger = logging.get_logger(details["name"])
        self._state = ProcessState.STARTING
        self._process: Process | None = None
        self.return_code: int | None = None
        """The exit code; None before the end."""
        self._end_requested = asyncio.Event()
        """Wakes the wait for the next start."""
        loop = asyncio.get_running_loop()
        self.completed: asyncio.Future[None] = loop.create_future()
        """Done when it has ended for good; has the exception of an error."""
        loop.create_task(self._run()).add_done_callback(self._complete)

    @property
    def state(self) -> ProcessState:
        return self._state

    def end(self, *, says_so: bool) -> None:
        """Have it end, now or when it has started, and don't start it again. `says_so`: log the signal."""
        was_running = self._state is ProcessState.RUNNING
        self._on(ProcessEvent.END)
        self._end_requested.set()
        if was_running:
            self._interrupt(says_so=says_so)

    def send(self, number: signal.Signals, *, says_so: bool = True) -> None:
        """Send it a signal, if it runs."""
        if self._process is None:
            return
        if says_so:
            name = self._details["name"]
            self._logger.info(f"sending signal '{number.name}' to process[{name}]")
        try:
            self._process.send_signal(number)
        except ProcessLookupError:
            pass

    def _on(self, event: ProcessEvent) -> None:
        self._state = next_state(self._state, event)

    def _complete(self, task: "asyncio.Task[None]") -> None:
        if self.completed.done():
            return
        if not task.cancelled() and (error := task.exception()) is not None:
            self.completed.set_exception(error)
        else:
            self.completed.set_result(None)

    # --- from start to end

    async def _run(self) -> None:
        while self._state is not ProcessState.ENDED:
            has_started = await self._run_once()
            if self._state is ProcessState.WAITING:
                least_s = 0.0 if has_started else _FAILED_START_S
                await self._wait_for_restart(max(self._respawn_delay_s, least_s))

    async def _wait_for_restart(self, delay_s: float) -> None:
        if not self._respawns_left:
            self._on(ProcessEvent.GIVE_UP)
            return
        self._respawns_left -= 1
        try:
            async with asyncio.timeout(delay_s):
                await self._end_requested.wait()
        except TimeoutError:
            if self._state is ProcessState.WAITING:  # it was not to end at the same moment
                self._on(ProcessEvent.RESTART)

    async def _run_once(self) -> bool:
        """Returns whether it could be started."""
        details = self._details
        try:
            process = self._start()
        except (OSError, ValueError) as error:
            self._logger.error(f"exception occurred while executing process: {error}")
            self._on(ProcessEvent.EXIT)
            return False
        self._process, self.return_code = process, None
        details["pid"] = process.pid
        self._logger.info(f"process started with pid [{process.pid}]")
        self._context.emit_event_sync(ProcessStarted(**details))
        self._on(ProcessEvent.START)
        if self._state is ProcessState.ENDING:
            self._interrupt(says_so=True)
        readers = [
            asyncio.create_task(self._read(process.stdout, ProcessStdout)),
            asyncio.create_task(self._read(process.stderr, ProcessStderr)),
        ]
        try:
            code = await process.wait()
            await asyncio.wait(readers, timeout=_LAST_OUTPUT_S)
        finally:
            for reader in readers:
                reader.cancel()
            await asyncio.gather(*readers, return_exceptions=True)
            process.close()
            self._process = None
            self._on(ProcessEvent.EXIT)
        self.lines.flush()
        self.return_code = code
        if code == 0:
            self._logger.info(f"process has finished cleanly [pid {process.pid}]")
        else:
            shown = shown_command(details["cmd"])
            self._logger.error(f"process has died [pid {process.pid}, exit code {code}, cmd '{shown}'].")
        self._context.emit_event_sync(ProcessExited(returncode=code, **details))
        return True

    async def _read(self, stream: Output, made: type[ProcessIO]) -> None:
        """One chunk at a time; the next one is read when this one's events were handled."""
        while text := await stream.read():
            self._context.emit_event_sync(made(text=text, **self._details))
            await self._context._event_queue.join()

    # --- its end

    def _interrupt(self, *, says_so: bool) -> None:
        self.send(signal.SIGINT, says_so=says_so)
        escalation = asyncio.get_running_loop().create_task(self._escalate())
        self.completed.add_done_callback(lambda _: escalation.cancel())

    async def _escalate(self) -> None:
        name, total = self._details["name"], 0.0
        first, second = self._patience_s
        steps = ((first, signal.SIGINT, signal.SIGTERM), (second, signal.SIGTERM, signal.SIGKILL))
        for timeout, sent, following in steps:
            await asyncio.sleep(timeout)
            total += timeout
            if self._state is not ProcessState.ENDING:
                return
            self._logger.error(
                f"process[{name}] failed to terminate '{total:g}' seconds after receiving "
                f"'{sent.name}', escalating to '{following.name}'"
            )
            self.send(following)


def shown_command(words: list[str]) -> str:
    """A command line for the log."""
    return " ".join(word for word in words if word.strip())
