"""Events of processes; programs import them as `launch.events.process`."""

import signal
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from bus_launch.launch.core import Event, LaunchDescriptionEntity

__all__ = [
    "ProcessExited",
    "ProcessIO",
    "ProcessStarted",
    "ProcessStderr",
    "ProcessStdin",
    "ProcessStdout",
    "ProcessTargetedEvent",
    "RunningProcessEvent",
    "ShutdownProcess",
    "SignalProcess",
]

__path__: list[str] = []  # there may be modules in it: a file for each class, as in ROS 2


class RunningProcessEvent(Event):
    """Something of a process that was started."""

    name = "launch.events.process.RunningProcessEvent"

    def __init__(
        self,
        *,
        action: LaunchDescriptionEntity,
        name: str,
        cmd: Sequence[str],
        cwd: str | None,
        env: Mapping[str, str] | None,
        pid: int = 0,
    ) -> None:
        self.__action = action
        self.__process_name = name
        self.__cmd = list(cmd)
        self.__cwd = cwd
        self.__env = env
        self.__pid = pid

    @property
    def action(self) -> LaunchDescriptionEntity:
        return self.__action

    @property
    def execute_process_action(self) -> LaunchDescriptionEntity:
        return self.__action

    @property
    def process_name(self) -> str:
        return self.__process_name

    @property
    def cmd(self) -> list[str]:
        return self.__cmd

    @property
    def cwd(self) -> str | None:
        return self.__cwd

    @property
    def env(self) -> Mapping[str, str] | None:
        return self.__env

    @property
    def pid(self) -> int:
        return self.__pid


class ProcessStarted(RunningProcessEvent):
    """A process runs."""

    name = "launch.events.process.ProcessStarted"


class ProcessExited(RunningProcessEvent):
    """A process has ended; `returncode` below zero: minus the number of the signal that ended it."""

    name = "launch.events.process.ProcessExited"

    def __init__(self, *, returncode: int, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__returncode = returncode

    @property
    def returncode(self) -> int:
        return self.__returncode


class ProcessIO(RunningProcessEvent):
    """Bytes that a process wrote, or is to read."""

    name = "launch.events.process.ProcessIO"

    def __init__(self, *, text: bytes, fd: int, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__text = text
        self.__fd = fd

    @property
    def text(self) -> bytes:
        return self.__text

    @property
    def from_stdin(self) -> bool:
        return self.__fd == 0

    @property
    def from_stdout(self) -> bool:
        return self.__fd == 1

    @property
    def from_stderr(self) -> bool:
        return self.__fd == 2


class ProcessStdin(ProcessIO):
    """Bytes for a process."""

    name = "launch.events.process.ProcessStdin"

    def __init__(self, *, text: bytes, **kwargs: Any) -> None:
        super().__init__(text=text, fd=0, **kwargs)


class ProcessStdout(ProcessIO):
    """Bytes that came by stdout."""

    name = "launch.events.process.ProcessStdout"

    def __init__(self, *, text: bytes, **kwargs: Any) -> None:
        super().__init__(text=text, fd=1, **kwargs)


class ProcessStderr(ProcessIO):
    """Bytes that came by stderr."""

    name = "launch.events.process.ProcessStderr"

    def __init__(self, *, text: bytes, **kwargs: Any) -> None:
        super().__init__(text=text, fd=2, **kwargs)


class ProcessTargetedEvent(Event):
    """For the processes of actions that the matcher accepts."""

    name = "launch.events.process.ProcessTargetedEvent"

    def __init__(self, *, process_matcher: Callable[[Any], bool]) -> None:
        self.__process_matcher = process_matcher

    @property
    def process_matcher(self) -> Callable[[Any], bool]:
        return self.__process_matcher


class ShutdownProcess(ProcessTargetedEvent):
    """A request to end a process: SIGINT, after a while SIGTERM, then SIGKILL."""

    name = "launch.events.process.ShutdownProcess"


class SignalProcess(ProcessTargetedEvent):
    """A process gets a signal, given by its number or its name."""

    name = "launch.events.process.SignalProcess"

    def __init__(self, *, signal_number: str | int | signal.Signals, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        if isinstance(signal_number, str):
            try:
                signal_number = signal.Signals[signal_number]
            except KeyError:
                raise ValueError(f"there is no signal '{signal_number}'") from None
        self.__signal = signal.Signals(signal_number)

    @property
    def signal(self) -> signal.Signals:
        return self.__signal

    @property
    def signal_name(self) -> str:
        return self.__signal.name
