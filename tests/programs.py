"""Programs run as users run them: as processes. Tests read their output."""

import asyncio
import os
import re
import signal
import subprocess
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import Any, TypeAlias
from uuid import uuid4

import pytest

import cli
from forks import Fork

LIMIT_S = 120.0 * float(os.environ.get("BUSD_TESTS_TIMEOUT_FACTOR", "1"))
EXAMPLES = Path(__file__).parents[1] / "examples"

on_one_loop = pytest.mark.asyncio(loop_factories=["uvloop"])
"""For tests of programs that choose their event loop themselves."""


class Program:
    """A running program; its lines, stdout and stderr together, are kept as they come."""

    def __init__(self, process: Fork | subprocess.Popen[bytes], output: int, mark: str) -> None:
        self.process = process
        self._output = output
        self._mark = f"PROGRAM={mark}".encode()
        self.lines: list[str] = []
        self._news = asyncio.Condition()
        self._reader = asyncio.create_task(self._read())

    async def line(self, pattern: str) -> re.Match[str]:
        """The first line with a match of `pattern`."""
        async with self._news:
            while True:
                for line in self.lines:
                    if found := re.search(pattern, line):
                        return found
                assert not self._reader.done(), f"ended without {pattern!r}: {self.lines}"
                await self._news.wait()

    async def end(self) -> int:
        """Its exit status, once it has ended and `lines` has its whole output."""
        await self._reader
        return await asyncio.to_thread(self.process.wait, LIMIT_S)

    def family(self, command: str = "") -> list[int]:
        """Pids of the program and its children with `command` in their command line."""
        found = []
        for entry in Path("/proc").glob("[0-9]*"):
            try:
                is_ours = self._mark in (entry / "environ").read_bytes().split(b"\0")
                line = (entry / "cmdline").read_bytes().replace(b"\0", b" ")
            except OSError:
                continue  # it has ended, or is another user's
            if is_ours and command.encode() in line:
                found.append(int(entry.name))
        return found

    async def _read(self) -> None:
        lines = asyncio.StreamReader()
        transport, _ = await asyncio.get_running_loop().connect_read_pipe(
            lambda: asyncio.StreamReaderProtocol(lines), os.fdopen(self._output, "rb")
        )
        async for line in lines:
            async with self._news:
                self.lines.append(line.decode().rstrip("\n"))
                self._news.notify_all()
        transport.close()
        await asyncio.sleep(0)  # uvloop releases it in its next turn
        async with self._news:
            self._news.notify_all()


@asynccontextmanager
async def running(folder: Path, *command: str | Path, **variables: str) -> AsyncIterator[Program]:
    """A Python program with its temporary files in `folder`; killed if it still runs after the test."""
    async with _watched(folder, [*map(str, command)], _begin, variables) as program:
        yield program


@asynccontextmanager
async def running_command(folder: Path, *command: str | Path, **variables: str) -> AsyncIterator[Program]:
    """As `running`, for any program."""
    async with _watched(folder, [*map(str, command)], _begin_command, variables) as program:
        yield program


Begin: TypeAlias = Callable[[list[str], int, dict[str, str]], Fork | subprocess.Popen[bytes]]


@asynccontextmanager
async def _watched(
    folder: Path, words: list[str], begin: Begin, variables: dict[str, str]
) -> AsyncIterator[Program]:
    mark = str(uuid4())  # in the environment of its children, too
    # For asyncio, any text except an empty one means yes.
    given = {"PYTHONASYNCIODEBUG": "", "TMPDIR": str(folder), **variables, "PROGRAM": mark}
    output, theirs = os.pipe()
    try:
        process = begin(words, theirs, {**os.environ, **given})
    finally:
        os.close(theirs)
    program = Program(process, output, mark)
    try:
        async with asyncio.timeout(LIMIT_S):
            yield program
    finally:
        for pid in program.family():
            with suppress(ProcessLookupError):  # it was about to end
                os.kill(pid, signal.SIGKILL)
        await program.end()


def _begin(words: list[str], output: int, environment: dict[str, str]) -> Fork | subprocess.Popen[bytes]:
    """Begin a program in a separate session; finalized as by `cli.begin`."""
    if cli.forks is not None and cli.forks.can_run(environment):
        return cli.forks.run(
            words,
            stdout=output,
            stderr=output,
            environment=environment,
            leads_session=True,
        )
    return _begin_command([sys.executable, *words], output, environment)


def _begin_command(words: list[str], output: int, environment: dict[str, str]) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        words,
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=output,
        env=environment,
        start_new_session=True,
    )


def assert_nothing_is_left(program: Program, folder: Path) -> None:
    assert program.family() == []
    assert list(folder.iterdir()) == []


def example(name: str) -> Any:
    """A module of the examples, imported by the name that the examples use."""
    for folder in (EXAMPLES, EXAMPLES / "robot"):
        if str(folder) not in sys.path:
            sys.path.append(str(folder))
    return import_module(name)
