"""Launches without processes and without waiting: a process is a coroutine of the test, and time jumps.

    world = LaunchWorld(monkeypatch)
    talker = ExecuteProcess(cmd=["talker"])

    @world.program("talker")
    async def run(process: ListProcess) -> int:
        process.write(b"hello\n")
        await asyncio.sleep(1000)
        return 0

    assert world.run(talker, RegisterEventHandler(...)) == 0
    assert world.started("talker")[0].signals == [signal.SIGINT]

The actions, the events and the event loop of the launch are the real ones. A command without a program runs
until it gets a signal that it does not ignore.
"""

import asyncio
import signal
from collections.abc import Awaitable, Callable, Mapping, Sequence

import pytest

from bus_launch.launch import LaunchService, logging
from bus_launch.launch.actions import process as process_action
from bus_launch.launch.core import LaunchDescriptionEntity
from bus_launch.launch.launch_description import LaunchDescription
from jumping_loop import play

__all__ = ["LaunchWorld", "ListProcess"]

FIRST_PID = 1001


class ListStream:
    """Output for a reader."""

    def __init__(self) -> None:
        self._chunks: asyncio.Queue[bytes] = asyncio.Queue()

    def write(self, chunk: bytes) -> None:
        self._chunks.put_nowait(chunk)

    async def read(self) -> bytes:
        return await self._chunks.get()


class ListProcess:
    """A process of a `LaunchWorld`; `signals` has all signals sent to it, also ignored ones."""

    def __init__(
        self,
        command: Sequence[str] | str,
        pid: int,
        *,
        env: Mapping[str, str] | None,
        ignores: Sequence[signal.Signals],
        program: "Program | None",
    ) -> None:
        loop = asyncio.get_running_loop()
        self.command = command
        self.pid = pid
        self.env = env
        self.stdout, self.stderr = ListStream(), ListStream()
        self.signals: list[int] = []
        self.is_closed = False
        self.started_s = loop.time()
        self._ignores = ignores
        self._ended: asyncio.Future[int] = loop.create_future()
        self._work = None if program is None else loop.create_task(self._run(program))

    async def _run(self, program: "Program") -> None:
        self.exit(await program(self))

    def write(self, chunk: bytes, source: str = "stdout") -> None:
        stream = self.stdout if source == "stdout" else self.stderr
        stream.write(chunk)

    def exit(self, code: int) -> None:
        """End it, and its pipes."""
        if not self._ended.done():
            self._ended.set_result(code)
            self.write(b"")
            self.write(b"", "stderr")

    # --- as a `bus_launch.launch.actions.process_run.Process`

    async def wait(self) -> int:
        return await self._ended

    def send_signal(self, number: int) -> None:
        if self._ended.done():
            raise ProcessLookupError
        self.signals.append(number)
        if number not in self._ignores:
            if self._work is not None:
                self._work.cancel()
            self.exit(-number)

    def close(self) -> None:
        self.is_closed = True


Program = Callable[[ListProcess], Awaitable[int]]


class LaunchWorld:
    """`processes` has all started processes, in order; `failing` are commands that can't be started."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.processes: list[ListProcess] = []
        self.failing: set[str] = set()
        self.ignored: dict[str, Sequence[signal.Signals]] = {}
        self._programs: dict[str, Program] = {}
        monkeypatch.setattr(process_action, "Child", self._start)

    def program(self, name: str) -> Callable[[Program], Program]:
        """A decorator: processes with the first word `name` run this coroutine; its result is the code."""

        def set_program(program: Program) -> Program:
            self._programs[name] = program
            return program

        return set_program

    def ignore(self, name: str, *numbers: signal.Signals) -> None:
        """Let processes with the first word `name` ignore these signals."""
        self.ignored[name] = numbers

    def started(self, name: str) -> list[ListProcess]:
        """The processes with the first word `name`."""
        return [one for one in self.processes if _first_word(one.command) == name]

    def run(self, *entities: LaunchDescriptionEntity, service: LaunchService | None = None) -> int:
        """Run until nothing is left to do; returns the launch's code."""
        logging.reset()
        service = service or LaunchService()
        service.include_launch_description(LaunchDescription(entities))
        codes: list[int] = []

        async def story() -> None:
            codes.append(await service.run_async())

        try:
            play(story)
        finally:
            logging.reset()
        return codes[0]

    def _start(
        self,
        command: Sequence[str] | str,
        *,
        cwd: str | None,
        env: Mapping[str, str] | None,
        emulate_tty: bool,
    ) -> ListProcess:
        name = _first_word(command)
        if name in self.failing:
            raise FileNotFoundError(2, "No such file or directory", name)
        process = ListProcess(
            command,
            FIRST_PID + len(self.processes),
            env=env,
            ignores=self.ignored.get(name, ()),
            program=self._programs.get(name),
        )
        self.processes.append(process)
        return process


def _first_word(command: Sequence[str] | str) -> str:
    return command.split()[0] if isinstance(command, str) else command[0]
