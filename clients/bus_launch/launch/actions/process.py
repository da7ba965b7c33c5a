"""The action that runs a process, from its start to its end: programs import it from `launch.actions`."""

import asyncio
import os
import signal
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from bus_launch.launch import logging
from bus_launch.launch.action import Action
from bus_launch.launch.actions.basic import seconds
from bus_launch.launch.actions.process_lines import ProcessLines
from bus_launch.launch.child import Child
from bus_launch.launch.conditions import evaluate_condition_expression
from bus_launch.launch.core import (
    BaseEventHandler,
    Event,
    LaunchContext,
    LaunchDescriptionEntity,
    SomeEntitiesType,
    SomeSubstitutionsType,
    Substitution,
    normalize_to_list_of_entities,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from bus_launch.launch.descriptions import Executable
from bus_launch.launch.events import Shutdown
from bus_launch.launch.events.process import (
    ProcessExited,
    ProcessIO,
    ProcessStarted,
    ProcessStderr,
    ProcessStdin,
    ProcessStdout,
    ShutdownProcess,
    SignalProcess,
)
from bus_launch.launch.substitutions import LaunchConfiguration

__all__ = ["ExecuteLocal"]

_LAST_OUTPUT_S: Final = 0.5
"""So long, after a process has ended, is read what those write that it has started."""

_SIGTERM_TIMEOUT: Final = LaunchConfiguration("sigterm_timeout", default=5)
_SIGKILL_TIMEOUT: Final = LaunchConfiguration("sigkill_timeout", default=5)

_OnExit = SomeEntitiesType | Callable[..., SomeEntitiesType | None] | None


class ExecuteLocal(Action):
    """Runs a process and prints its output; starts it again, where that is asked for; ends it at shutdown."""

    def __init__(  # noqa: PLR0913 (the genuine one's)
        self,
        *,
        process_description: Executable,
        shell: bool = False,
        sigterm_timeout: SomeSubstitutionsType = _SIGTERM_TIMEOUT,
        sigkill_timeout: SomeSubstitutionsType = _SIGKILL_TIMEOUT,
        emulate_tty: bool = False,
        output: SomeSubstitutionsType | Mapping[str, Any] = "log",
        output_format: str = "[{this.process_description.final_name}] {line}",
        cached_output: bool = False,
        log_cmd: bool = False,
        on_exit: _OnExit = None,
        respawn: bool | SomeSubstitutionsType = False,
        respawn_delay: float | None = None,
        respawn_max_retries: int = -1,
        **kwargs: Any,
    ) -> None:
        """`output`: screen, log, both, own_log, full, or a dict (`launch.logging.get_output_loggers`).

        `on_exit`: actions, or a function of event and context. `respawn`: start it again when it has ended,
        after `respawn_delay` seconds, `respawn_max_retries` times at most.
        """
        super().__init__(**kwargs)
        self.__description = process_description
        self.__shell = shell
        self.__sigterm_timeout = _timeout(sigterm_timeout)
        self.__sigkill_timeout = _timeout(sigkill_timeout)
        self.__emulate_tty = emulate_tty
        output = os.environ.get("OVERRIDE_LAUNCH_PROCESS_OUTPUT") or output
        self.__output: Any = (
            output if isinstance(output, Mapping) else normalize_to_list_of_substitutions(output)
        )
        self.__output_format = output_format
        self.__cached_output = cached_output
        self.__log_cmd = log_cmd
        self.__on_exit = on_exit
        self.__respawn: bool | list[Substitution] = (
            respawn if isinstance(respawn, bool) else normalize_to_list_of_substitutions(respawn)
        )
        self.__respawn_delay = respawn_delay
        self.__respawns_left = respawn_max_retries
        self.__details: dict[str, Any] | None = None
        self.__handler: _Handler | None = None
        self.__child: Child | None = None
        self.__return_code: int | None = None
        self.__lines: ProcessLines | None = None
        self.__completed: asyncio.Future[None] | None = None
        self.__must_end: asyncio.Event | None = None
        self.__is_ending = False
        self.__patience_s = (0.0, 0.0)

    @property
    def process_description(self) -> Executable:
        return self.__description

    @property
    def shell(self) -> bool:
        return self.__shell

    @property
    def emulate_tty(self) -> bool:
        return self.__emulate_tty

    @property
    def output(self) -> Any:
        return self.__output

    @property
    def sigterm_timeout(self) -> list[Substitution]:
        return self.__sigterm_timeout

    @property
    def sigkill_timeout(self) -> list[Substitution]:
        return self.__sigkill_timeout

    @property
    def process_details(self) -> dict[str, Any] | None:
        """What the events of its process have: name, cmd, cwd, env, and pid once it runs."""
        return self.__details

    @property
    def return_code(self) -> int | None:
        """None while it runs, and before."""
        return self.__return_code

    def get_sub_entities(self) -> list[LaunchDescriptionEntity]:
        if callable(self.__on_exit) and not isinstance(self.__on_exit, LaunchDescriptionEntity):
            return []
        return normalize_to_list_of_entities(self.__on_exit)

    def get_stdout(self) -> str:
        """What it has written so far; raises RuntimeError without cached_output=True."""
        return self.__cached("stdout")

    def get_stderr(self) -> str:
        """As `get_stdout`."""
        return self.__cached("stderr")

    def __cached(self, source: str) -> str:
        if not self.__cached_output:
            name = self.__description.final_name
            raise RuntimeError(f"cached output must be true to be able to get {source}, proc '{name}'")
        return "" if self.__lines is None else self.__lines.text(source)

    def get_asyncio_future(self) -> "asyncio.Future[None] | None":
        return self.__completed

    def prepare(self, context: LaunchContext) -> None:
        """Make texts of all substitutions; derived classes may do more."""
        self.__description.prepare(context, self)
        self.__details = {
            "action": self,
            "name": self.__description.final_name,
            "cmd": self.__description.final_cmd,
            "cwd": self.__description.final_cwd,
            "env": self.__description.final_env,
        }
        if not isinstance(self.__respawn, bool):
            self.__respawn = evaluate_condition_expression(context, self.__respawn)

    def execute(self, context: LaunchContext) -> Sequence[LaunchDescriptionEntity] | None:
        if self.__handler is not None:
            name = self.__description.final_name
            raise RuntimeError(f"ExecuteLocal action '{name}': executed more than once: {self.describe()}")
        self.prepare(context)
        if context.is_shutdown:
            return None
        assert context.asyncio_loop is not None
        # Now, for an error at the end would keep the process.
        self.__patience_s = (
            seconds(context, self.__sigterm_timeout),
            seconds(context, self.__sigkill_timeout),
        )
        if "emulate_tty" in context.launch_configurations:
            value = str(context.launch_configurations["emulate_tty"])
            self.__emulate_tty = evaluate_condition_expression(
                context, normalize_to_list_of_substitutions(value)
            )
        name = self.__description.final_name or ""
        output = self.__output
        if not isinstance(output, Mapping):
            output = perform_substitutions(context, output)
        loggers = logging.get_output_loggers(name, output)
        self.__lines = ProcessLines(loggers, self.__format, keep=self.__cached_output)
        self.__must_end = asyncio.Event()
        self.__completed = context.asyncio_loop.create_future()
        self.__handler = _Handler(self, self.__handle)
        context.register_event_handler(self.__handler)
        task = context.asyncio_loop.create_task(self.__run(context))
        task.add_done_callback(lambda task: self.__complete(context, task))
        return None

    def __format(self, line: str) -> str:
        return self.__output_format.format(line=line, this=self)

    def __complete(self, context: LaunchContext, task: "asyncio.Task[None]") -> None:
        if self.__completed is not None and not self.__completed.done():
            if not task.cancelled() and (error := task.exception()) is not None:
                self.__completed.set_exception(error)
            else:
                self.__completed.set_result(None)

    # --- the process

    async def __run(self, context: LaunchContext) -> None:
        assert self.__must_end is not None
        assert self.__details is not None
        logger = logging.get_logger(self.__details["name"])
        while True:
            await self.__run_once(context, logger)
            if self.__must_end.is_set() or not self.__respawn or not self.__respawns_left:
                break
            self.__respawns_left -= 1
            try:
                async with asyncio.timeout(self.__respawn_delay or 0):
                    await self.__must_end.wait()
                break
            except TimeoutError:
                self.__is_ending = False

    async def __run_once(self, context: LaunchContext, logger: Any) -> None:
        details = self.__details
        assert details is not None and self.__lines is not None
        cmd = details["cmd"]
        shown = " ".join(word for word in cmd if word.strip())
        if self.__log_cmd:
            custom = self.__description.has_own_env
            logger.info(f"process details: cmd='{shown}', cwd='{details['cwd']}', custom_env?={custom}")
        try:
            command = " ".join(cmd) if self.__shell else self.__description.command()
            process = Child(command, cwd=details["cwd"], env=details["env"], emulate_tty=self.__emulate_tty)
        except (OSError, ValueError) as error:
            logger.error(f"exception occurred while executing process: {error}")
            return
        self.__child, self.__return_code = process, None
        details["pid"] = process.pid
        logger.info(f"process started with pid [{process.pid}]")
        context.emit_event_sync(ProcessStarted(**details))
        if self.__must_end is not None and self.__must_end.is_set():
            self.__begin_end(context, says_so=True)
        readers = [
            asyncio.create_task(self.__read(context, stream, made))
            for stream, made in ((process.stdout, ProcessStdout), (process.stderr, ProcessStderr))
        ]
        try:
            code = await process.wait()
            await asyncio.wait(readers, timeout=_LAST_OUTPUT_S)
        finally:
            for reader in readers:
                reader.cancel()
            await asyncio.gather(*readers, return_exceptions=True)
            process.close()
            self.__child = None
        self.__lines.flush()
        self.__return_code = code
        if code == 0:
            logger.info(f"process has finished cleanly [pid {process.pid}]")
        else:
            logger.error(f"process has died [pid {process.pid}, exit code {code}, cmd '{shown}'].")
        context.emit_event_sync(ProcessExited(returncode=code, **details))

    async def __read(self, context: LaunchContext, stream: Any, made: type[ProcessIO]) -> None:
        """One chunk at a time: it is read on when what came is printed."""
        assert self.__details is not None
        while text := await stream.read():
            context.emit_event_sync(made(text=text, **self.__details))
            await context._event_queue.join()

    # --- events

    def __handle(self, event: Event, context: LaunchContext) -> SomeEntitiesType | None:
        if isinstance(event, ProcessIO):
            if isinstance(event, ProcessStdin):
                logging.get_logger(event.process_name).warning("a launch writes nothing to a process")
            elif self.__lines is not None:
                self.__lines.feed("stdout" if event.from_stdout else "stderr", event.text)
        elif isinstance(event, ProcessExited):
            if callable(self.__on_exit) and not isinstance(self.__on_exit, LaunchDescriptionEntity):
                return self.__on_exit(event, context)
            return self.__on_exit
        elif isinstance(event, SignalProcess):
            self.__send(event.signal, says_so=True)
        elif isinstance(event, Shutdown):
            # Of a terminal's Ctrl-C the genuine one says nothing: there the terminal tells the processes.
            self.__end(context, says_so=not event.due_to_sigint or context.noninteractive)
        else:
            self.__end(context, says_so=True)
        return None

    def __end(self, context: LaunchContext, *, says_so: bool) -> None:
        assert self.__must_end is not None
        self.__must_end.set()
        if self.__child is not None:
            self.__begin_end(context, says_so=says_so)

    def __begin_end(self, context: LaunchContext, *, says_so: bool) -> None:
        if self.__is_ending:
            return
        self.__is_ending = True
        assert context.asyncio_loop is not None
        self.__send(signal.SIGINT, says_so=says_so)
        ends = context.asyncio_loop.create_task(self.__escalate(self.__child))
        if self.__completed is not None:
            self.__completed.add_done_callback(lambda _: ends.cancel())

    async def __escalate(self, process: Child | None) -> None:
        total = 0.0
        first, second = self.__patience_s
        steps = ((first, signal.SIGINT, signal.SIGTERM), (second, signal.SIGTERM, signal.SIGKILL))
        for timeout, sent, following in steps:
            await asyncio.sleep(timeout)
            total += timeout
            if self.__child is not process or self.__details is None:
                return
            shown = f"{total:g}"
            logging.get_logger(self.__details["name"]).error(
                f"process[{self.__details['name']}] failed to terminate '{shown}' seconds after receiving "
                f"'{sent.name}', escalating to '{following.name}'"
            )
            self.__send(following, says_so=True)

    def __send(self, number: signal.Signals, *, says_so: bool) -> None:
        if self.__child is None or self.__details is None:
            return
        if says_so:
            name = self.__details["name"]
            logging.get_logger(name).info(f"sending signal '{number.name}' to process[{name}]")
        try:
            self.__child.send_signal(number)
        except ProcessLookupError:
            pass


class _Handler(BaseEventHandler):
    """All events that an action's process has to do with."""

    def __init__(
        self,
        action: ExecuteLocal,
        handle: Callable[[Event, LaunchContext], SomeEntitiesType | None],
    ) -> None:
        super().__init__(matcher=self.__takes)
        self.__action = action
        self.__handle = handle

    def __takes(self, event: Event) -> bool:
        if isinstance(event, ProcessIO | ProcessExited):
            return event.action is self.__action
        if isinstance(event, ShutdownProcess | SignalProcess):
            return event.process_matcher(self.__action)
        return isinstance(event, Shutdown)

    def handle(self, event: Event, context: LaunchContext) -> SomeEntitiesType | None:
        super().handle(event, context)
        return self.__handle(event, context)


def _timeout(value: SomeSubstitutionsType | float) -> list[Substitution]:
    return normalize_to_list_of_substitutions(str(value) if isinstance(value, int | float) else value)
