"""The program `bus` and users' programs, run by tests as users run them: their output and their end."""

import os
import queue
import re
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import chdir, contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import IO, NamedTuple, Self

import pytest

from bus.graph import Graph
from bus.process.address import socket_path
from bus_cli.main import COMMANDS, module_of
from bus_cli.query import Query
from conftest import WAIT_S
from forks import Fork, Forks
from neighbours import wait_until

BUS = (sys.executable, "-m", "bus_cli")

IMPORTED = (
    *(module_of(command, verb) for command, (_, verbs) in COMMANDS.items() for verb in verbs),
    *("bus_cli.doctor", "bus_cli.entry", "bus_cli.fields", "bus_cli.metrics", "bus_cli.run"),
    "bus_cli.suggestions",
    *("bus", "bus.link.autostart", "bus.node", "bus.service.server", "bus.service.client", "uvloop", "yaml"),
    *("bus.msg.geometry_msgs", "bus.msg.sensor_msgs", "bus.msg.std_msgs", "bus.srv.example_interfaces"),
    *("bus.msg.rcl_interfaces", "bus.msg._described"),
    *("bus_ros.rclpy", "bus_ros.rclpy.action", "bus_ros.rclpy.lifecycle", "bus_ros.rclpy.parameter_service"),
    *(
        "bus_ros.rosidl",
        "bus_ros.rosidl.support",
        "bus_ros.running",
        "bus.srv._described",
        "bus.srv.std_srvs",
    ),
    *(
        "bus_bag.record.program",
        "bus_bag.play.program",
        "bus_bag.storage.chunk",
        "bus_bag.storage.mcap_reader",
    ),
    *("bus_bag.storage.mcap_writer", "mcap.records", "mcap.writer"),
    *("bus_cli.top.plain", "bus_web.browser", "bus_web.program", "bus.link.graph_mirror"),
)
"""The imports of most programs in these tests."""

forks: Forks | None = None
"""The process that forks programs; None: each starts a new Python. A fixture of system tests sets it."""

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


def begin(
    words: Sequence[str], streams: Sequence[int], *, is_fresh: bool = False, folder: Path | None = None
) -> Fork | subprocess.Popen[bytes]:
    """Begin a Python program with these standard streams: forked, or in a new interpreter if `is_fresh`.

    A fork that ends with status 0 skips the finalization of modules, except in `make nightly`.
    """
    stdin, stdout, stderr = streams
    if is_fresh or forks is None or not forks.can_run():
        command = [sys.executable, *words]
        return subprocess.Popen(command, cwd=folder, stdin=stdin, stdout=stdout, stderr=stderr)
    with chdir(folder or Path.cwd()):
        return forks.run(words, stdin=stdin, stdout=stdout, stderr=stderr)


class Running:
    """A Python program; its lines are read as they come."""

    def __init__(self, words: Sequence[str], *, is_fresh: bool = False, folder: Path | None = None) -> None:
        (their_in, our_in), (our_out, their_out), (our_err, their_err) = os.pipe(), os.pipe(), os.pipe()
        self.process = begin(words, (their_in, their_out, their_err), is_fresh=is_fresh, folder=folder)
        for descriptor in (their_in, their_out, their_err):
            os.close(descriptor)
        self._in = os.fdopen(our_in, "w")
        self._out = self._read(os.fdopen(our_out))
        self._err = self._read(os.fdopen(our_err))

    @staticmethod
    def _read(stream: IO[str]) -> "queue.Queue[str | None]":
        lines: queue.Queue[str | None] = queue.Queue()

        def read() -> None:
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
        self._in.write(text)
        self._in.flush()

    def end(self, number: int | None = None) -> Result:
        """Send a signal, if one is given, and wait; returns the unread output, and the exit code."""
        if number is not None:
            self.process.send_signal(number)
        else:
            self._close_input()
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
        self._close_input()

    def _close_input(self) -> None:
        """Input that the program does not read any more is lost."""
        with suppress(BrokenPipeError):
            self._in.close()

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
    """The result without the hint of `echo` that a slow machine may cause."""
    return result._replace(err=re.sub(r"^no message yet on .*\n", "", result.err, flags=re.MULTILINE))


def bus(*words: str, stdin: str = "", is_fresh: bool = False) -> Result:
    """Run `bus` to its end."""
    with start(*words, is_fresh=is_fresh) as running:
        with suppress(BrokenPipeError):
            running.write(stdin)
        result = running.end()
    assert "Traceback" not in result.err, result.err
    return result


def start(*words: str, is_fresh: bool = False) -> Running:
    """Start a `bus` that keeps running."""
    return Running(("-m", "bus_cli", *words), is_fresh=is_fresh)


def wait_for_graph(fits: Callable[[Graph], object]) -> Graph:
    """Wait for the first graph that fits, with counters. Raises TimeoutError."""
    seen: list[Graph] = []
    with Query(socket_path(), may_start=False) as query:

        def has_come() -> bool:
            seen.append(query.graph(statistics=True))
            return bool(fits(seen[-1]))

        wait_until(has_come)
    return seen[-1]


def messages_on_topic(graph: Graph) -> int:
    """The number of messages that the first publisher of /topic has published, as far as known."""
    counters = graph.publishers_of("/topic")[0].statistics
    return counters.samples if counters is not None else 0


@contextmanager
def script(source: str, *arguments: str) -> Iterator[Running]:
    """Run a user's program until the end of the block; it has printed `ready`."""
    with Running(("-c", source, *arguments)) as running:
        assert running.line() == "ready"
        yield running


def words(line: str) -> list[str]:
    """The words of a command line; in a word that is YAML, colons get the space that YAML needs."""
    return [word.replace(":", ": ") if word.startswith("{") else word for word in line.split()]
