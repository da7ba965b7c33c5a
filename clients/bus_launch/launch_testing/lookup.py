"""The processes that a test means; programs import this from `launch_testing.util`."""

from collections.abc import Iterable
from typing import Any, Final, Protocol

from bus_launch.launch.actions import ExecuteLocal
from bus_launch.launch.core import LaunchDescriptionEntity

__all__ = ["NO_CMD_ARGS", "NoMatchingProcessException", "matching", "resolveProcesses", "shown"]

NO_CMD_ARGS: Final = object()
"""`cmd_args` of a process without arguments."""


class NoMatchingProcessException(Exception):
    """No process has such a name, or was started by such an action; or more than one is meant."""


class Processes(Protocol):
    """The processes that a handler knows, with their commands."""

    def processes(self) -> list[Any]: ...

    def command_of(self, action: Any) -> tuple[str, list[str]]: ...


def resolveProcesses(
    info_obj: Processes, *, process: Any = None, cmd_args: Any = None, strict_proc_matching: bool = True
) -> list[Any]:
    """The actions of the processes that are meant, at least one; all processes without `process`.

    `process` is an action, or a name or a part of it; `cmd_args` is an argument or several that a process
    with this name must have. Raises NoMatchingProcessException for no process, and also for several if
    `strict_proc_matching`; TypeError for another `process`.
    """
    known = info_obj.processes()
    if process is None:
        if not known:
            raise NoMatchingProcessException("No data recorded for any process")
        return known
    if isinstance(process, LaunchDescriptionEntity):
        if process in known:
            return [process]
        raise NoMatchingProcessException(f"No data recorded for proc {shown(process)}")
    if not isinstance(process, str):
        raise TypeError(f"proc argument must be 'ExecuteProcess' or 'str' not {type(process)}")
    commands = {one: info_obj.command_of(one) for one in known}
    found = [one for one, command in commands.items() if _has(command, process, cmd_args)]
    exact = [one for one in found if commands[one][0] == process]
    if len(found) == 1 or (found and not strict_proc_matching):
        return found
    if len(exact) == 1:
        return exact
    names = ", ".join(sorted(" ".join([name, *words[1:]]) for name, words in commands.values()))
    problem = "Found multiple" if found else "Did not find any"
    raise NoMatchingProcessException(
        f"{problem} processes matching name '{process}' and args '{cmd_args}'. Procs: {names}"
    )


def matching(processes: Processes, process: Any, cmd_args: Any = None) -> Any:
    """The action of the one process that is meant; raises NoMatchingProcessException."""
    return resolveProcesses(processes, process=process, cmd_args=cmd_args)[0]


def shown(one: Any) -> str:
    """The action as errors name it."""
    if not isinstance(one, LaunchDescriptionEntity):
        return str(one)
    details = one.process_details if isinstance(one, ExecuteLocal) else None
    return one.describe() if not details else " ".join([details["name"], *details["cmd"][1:]])


def _has(command: tuple[str, list[str]], name: str, cmd_args: Any) -> bool:
    own, words = command
    if name not in own:
        return False
    if cmd_args is None:
        return True
    if cmd_args is NO_CMD_ARGS:
        return len(words) == 1
    wanted: Iterable[str] = [cmd_args] if isinstance(cmd_args, str) else cmd_args
    return all(one in words[1:] for one in wanted)
