"""The program `bus` and programs of users, run by tests as users run them: what they say, how they end."""

import queue
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import IO, Any, NamedTuple, Self

import pytest

from conftest import WAIT_S

BUS = (sys.executable, "-m", "bus_cli")

TALKER = """
import asyncio, sys, bus
from bus.msg.std_msgs import String
async def main():
    async with bus.Node("minimal_publisher") as node:
        publisher = await node.create_publisher(String, "topic", 10)
        print("ready", flush=True)
        for number in range(1, 1_000_000):
            publisher.publish(String(data=f"Hello World: {number}"))
            await asyncio.sleep(float(sys.argv[1]))
bus.run(main())
"""
LISTENER = """
import asyncio, bus
from bus.msg.std_msgs import String
async def main():
    async with bus.Node("minimal_subscriber") as node:
        await node.create_subscription(String, "topic", 10, lambda message: None)
        print("ready", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""


class Result(NamedTuple):
    out: str
    err: str
    code: int


class Running:
    """A process whose lines are read as they come."""

    def __init__(self, command: tuple[str, ...], **options: Any) -> None:
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            **options,
        )
        self._out = self._read(self.process.stdout)
        self._err = self._read(self.process.stderr)

    @staticmethod
    def _read(stream: IO[str] | None) -> "queue.Queue[str | None]":
        lines: queue.Queue[str | None] = queue.Queue()

        def read() -> None:
            assert stream is not None
            with stream:
                for line in stream:
                    lines.put(line)
            lines.put(None)

        threading.Thread(target=read, daemon=True).start()
        return lines

    def line(self) -> str:
        """The next line of the standard output."""
        return self._next(self._out, "stdout")

    def error_line(self) -> str:
        return self._next(self._err, "stderr")

    def lines(self, count: int) -> str:
        """The next lines, as one text."""
        return "".join(f"{self.line()}\n" for _ in range(count))

    def error_line_with(self, pattern: str) -> str:
        """The next line of the standard error in which `pattern` is found."""
        while not re.search(pattern, line := self.error_line()):
            pass
        return line

    def line_with(self, pattern: str) -> str:
        while not re.search(pattern, line := self.line()):
            pass
        return line

    def write(self, text: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(text)
        self.process.stdin.flush()

    def end(self, number: int | None = None) -> Result:
        """Send a signal, if one is given, and wait; returns what was not read yet, and the exit code."""
        if number is not None:
            self.process.send_signal(number)
        elif self.process.stdin is not None:
            self.process.stdin.close()
        code = self.process.wait(WAIT_S)
        return Result(self._rest(self._out), self._rest(self._err), code)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(WAIT_S)
        if self.process.stdin is not None and not self.process.stdin.closed:
            try:
                self.process.stdin.close()
            except BrokenPipeError:
                pass

    def _next(self, lines: "queue.Queue[str | None]", name: str) -> str:
        try:
            line = lines.get(timeout=WAIT_S)
        except queue.Empty:
            raise TimeoutError(f"no line on {name} of {self.process.args!r}") from None
        if line is None:
            lines.put(None)
            pytest.fail(f"{name} ended (code {self.process.poll()}); stderr: {self._rest(self._err)}")
        return line.removesuffix("\n")

    @staticmethod
    def _rest(lines: "queue.Queue[str | None]") -> str:
        text = ""
        while (line := lines.get(timeout=WAIT_S)) is not None:
            text += line
        lines.put(None)
        return text


def without_hint(result: Result) -> Result:
    """Where the machine is slow, `echo` may say what it waits for."""
    return result._replace(err=re.sub(r"^no message yet on .*\n", "", result.err, flags=re.MULTILINE))


def bus(*words: str, stdin: str = "") -> Result:
    """Run `bus` to its end."""
    done = subprocess.run((*BUS, *words), input=stdin, capture_output=True, text=True, timeout=WAIT_S)
    assert "Traceback" not in done.stderr, done.stderr
    return Result(done.stdout, done.stderr, done.returncode)


def start(*words: str, **options: Any) -> Running:
    """Start a `bus` that stays."""
    return Running((*BUS, *words), **options)


@contextmanager
def script(source: str, *arguments: str) -> Iterator[Running]:
    """Run a program of a user's until the end of the block; it has said `ready`."""
    with Running((sys.executable, "-c", source, *arguments)) as running:
        assert running.line() == "ready"
        yield running
