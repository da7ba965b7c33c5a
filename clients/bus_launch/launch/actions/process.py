"""The action that runs a process, as it is configured: programs import it from `launch.actions`.

`process_run` has the life of its process from start to end.
"""

import asyncio
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from bus_launch.launch import logging
from bus_launch.launch.action import Action
from bus_launch.launch.actions.basic import seconds
from bus_launch.launch.actions.process_lines import ProcessLines
from bus_launch.launch.actions.process_run import ProcessRun, shown_command
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
    ProcessStdin,
    ShutdownProcess,
    SignalProcess,
)
from bus_launch.launch.substitutions import LaunchConfiguration

__all__ = ["ExecuteLocal"]

_SIGTERM_TIMEOUT: Final = LaunchConfiguration("sigterm_timeout", default=5)
_SIGKILL_TIMEOUT: Final = LaunchConfiguration("sigkill_timeout", default=5)

_OnExit = SomeEntitiesType | Callable[..., SomeEntitiesType | None] | None


class ExecuteLocal(Action):
    """Runs a process and prints its output; starts it again if asked to; ends it at shutdown."""

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
        self.__respawn_max_retries = respawn_max_retries
        self.__details: dict[str, Any] | None = None
        self.__run: ProcessRun | None = None

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
        """The details in events of its process: name, cmd, cwd, env, and pid once it runs."""
        return self.__details

    @property
    def return_code(self) -> int | None:
        """The exit code; None before the end."""
        return None if self.__run is None else self.__run.return_code

    def get_sub_entities(self) -> list[LaunchDescriptionEntity]:
        if callable(self.__on_exit) and not isinstance(self.__on_exit, LaunchDescriptionEntity):
            return []
        return normalize_to_list_of_entities(self.__on_exit)

    def get_stdout(self) -> str:
        """The output so far; raises RuntimeError without cached_output=True."""
        return self.__cached("stdout")

    def get_stderr(self) -> str:
        """As `get_stdout`."""
        return self.__cached("stderr")

    def __cached(self, source: str) -> str:
        if not self.__cached_output:
            name = self.__description.final_name
            raise RuntimeError(f"cached output must be true to be able to get {source}, proc '{name}'")
        return "" if self.__run is None else self.__run.lines.text(source)

    def get_asyncio_future(self) -> "asyncio.Future[None] | None":
        return None if self.__run is None else self.__run.completed

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
        if self.__run is not None:
            name = self.__description.final_name
            raise RuntimeError(f"ExecuteLocal action '{name}': executed more than once: {self.describe()}")
        self.prepare(context)
        if context.is_shutdown:
            return None
        assert self.__details is not None
        # Evaluated now: an error at the end would keep the process running.
        patience_s = seconds(context, self.__sigterm_timeout), seconds(context, self.__sigkill_timeout)
        if "emulate_tty" in context.launch_configurations:
            value = str(context.launch_configurations["emulate_tty"])
            self.__emulate_tty = evaluate_condition_expression(
                context, normalize_to_list_of_substitutions(value)
            )
        output = self.__output
        if not isinstance(output, Mapping):
            output = perform_substitutions(context, output)
        loggers = logging.get_output_loggers(self.__description.final_name or "", output)
        run = self.__run = ProcessRun(
            context,
            self.__details,
            self.__start,
            ProcessLines(loggers, self.__format, keep=self.__cached_output),
            patience_s=patience_s,
            respawns=self.__respawn_max_retries if self.__respawn else 0,
            respawn_delay_s=self.__respawn_delay or 0.0,
        )
        context.register_event_handler(_Handler(self, run, self.__on_exit))
        return None

    def __format(self, line: str) -> str:
        return self.__output_format.format(line=line, this=self)

    def __start(self) -> Child:
        """Raises OSError, ValueError."""
        assert self.__details is not None
        cmd, cwd = self.__details["cmd"], self.__details["cwd"]
        if self.__log_cmd:
            logging.get_logger(self.__details["name"]).info(
                f"process details: cmd='{shown_command(cmd)}', cwd='{cwd}', "
                f"custom_env?={self.__description.has_own_env}"
            )
        command = " ".join(cmd) if self.__shell else self.__description.command()
        return Child(command, cwd=cwd, env=self.__details["env"], emulate_tty=self.__emulate_tty)


class _Handler(BaseEventHandler):
    """Handles all events for the process of `action`."""

    def __init__(self, action: ExecuteLocal, run: ProcessRun, on_exit: _OnExit) -> None:
        super().__init__(matcher=self.__takes)
        self.__action = action
        self.__run = run
        self.__on_exit = on_exit

    def __takes(self, event: Event) -> bool:
        if isinstance(event, ProcessIO | ProcessExited):
            return event.action is self.__action
        if isinstance(event, ShutdownProcess | SignalProcess):
            return event.process_matcher(self.__action)
        return isinstance(event, Shutdown)

    def handle(self, event: Event, context: LaunchContext) -> SomeEntitiesType | None:
        super().handle(event, context)
        match event:
            case ProcessStdin():
                logging.get_logger(event.process_name).warning("a launch writes nothing to a process")
            case ProcessIO():
                self.__run.lines.feed("stdout" if event.from_stdout else "stderr", event.text)
            case ProcessExited():
                if callable(self.__on_exit) and not isinstance(self.__on_exit, LaunchDescriptionEntity):
                    return self.__on_exit(event, context)
                return self.__on_exit
            case SignalProcess():
                self.__run.send(event.signal)
            case Shutdown():
                # On a terminal's Ctrl-C the genuine launch logs nothing: the terminal tells the processes.
                self.__run.end(says_so=not event.due_to_sigint or context.noninteractive)
            case _:
                self.__run.end(says_so=True)
        return None


def _timeout(value: SomeSubstitutionsType | float) -> list[Substitution]:
    return normalize_to_list_of_substitutions(str(value) if isinstance(value, int | float) else value)
