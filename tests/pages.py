"""Runs the examples of a page: programs as files, commands as processes; compares the shape of the output."""

import os
import re
import shlex
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import chdir
from pathlib import Path
from typing import NamedTuple

import cli
from conftest import TEST_S
from effort import is_nightly
from forks import Fork

ROOT = Path(__file__).parents[1]
INTERRUPTED = "^C"

SCRIPT = re.compile(r"^`(\w+\.py)`:\n\n```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FILE = re.compile(r"^`([\w/]+\.\w+)`:\n\n```\w+\n(.*?)^```$", re.MULTILINE | re.DOTALL)
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_ID = re.compile(r"\b[0-9a-f]{32}\b")
_NUMBER = re.compile(r"\d+(?:\.\d+)?")
_SOCKET = re.compile(r"/\S+\.sock|/\S+/log/\S+")
_BLANKS = re.compile(r" {2,}")


class Shown(NamedTuple):
    """A command on a page, and its output there."""

    command: str
    lines: tuple[str, ...]

    @property
    def is_interrupted(self) -> bool:
        return INTERRUPTED in self.lines

    @property
    def output(self) -> tuple[str, ...]:
        """The output before the command is interrupted."""
        return self.lines[: self.lines.index(INTERRUPTED)] if self.is_interrupted else self.lines

    @property
    def farewell(self) -> tuple[str, ...]:
        """The output after that."""
        return self.lines[len(self.output) + 1 :]


def blocks(language: str, page: str) -> list[str]:
    return [text for found, text in BLOCK.findall(page) if found == language]


def console(page: str) -> list[Shown]:
    found: list[Shown] = []
    for block in blocks("console", page):
        for session in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
            command, *lines = session.rstrip("\n").split("\n")
            found.append(Shown(command, tuple(lines)))
    return found


def shape(text: str) -> str:
    """A pattern for text that differs only in numbers, ids, the width of columns and the socket."""
    marked = _ID.sub("\3", _SOCKET.sub("\1", _BLANKS.sub("\2", text)))
    parts = [re.escape(part) for part in _NUMBER.split(marked)]
    pattern = r"-?\d+(?:\.\d+)?".join(parts)
    pattern = pattern.replace(re.escape("\1"), r"/\S+").replace(re.escape("\2"), " +")
    return pattern.replace(re.escape("\3"), "[0-9a-f]{32}")


PROGRAMS = {"busd": ("-m", "busd"), "bus": ("-m", "bus_cli"), "python": ()}


class Program:
    """A command of a page as a process; its output is kept."""

    def __init__(self, command: str, folder: Path = ROOT) -> None:
        self.text = ""
        output, theirs = os.pipe()
        try:
            self.process = _begin(shlex.split(command), folder, theirs)
        finally:
            os.close(theirs)
        self.output = os.fdopen(output)
        self.patience = threading.Timer(TEST_S, self.process.kill)  # some run as long as their test
        self.patience.start()

    def read_until(self, pattern: str) -> None:
        """Read until `pattern` matches the output, from the beginning of some line."""
        while not re.search(f"^{pattern}", self.text, re.MULTILINE):
            line = self.output.readline()
            assert line, f"{pattern!r} did not come; {self.process.args!r} printed:\n{self.text}"
            self.text += line

    def end(self, number: signal.Signals | None = None) -> int:
        """Send a signal, read the rest; returns the exit status."""
        if number is not None:
            self.process.send_signal(number)
        self.text += self.output.read()
        status = self.process.wait(TEST_S)
        self.patience.cancel()
        return status


def _begin(command: list[str], folder: Path, output: int) -> Fork | subprocess.Popen[bytes]:
    """Begin a program, forked if that can be.

    In `make nightly`, users' own scripts get a new interpreter, without modules that they don't import.
    """
    name, *arguments = command
    words = [*PROGRAMS.get(name, ()), *arguments]
    environment = {**os.environ, "PYTHONASYNCIODEBUG": "", "PYTHONUNBUFFERED": "1"}  # as in a terminal
    environment.pop("PYTEST_ADDOPTS", None)  # meant for this run, not for a page's
    is_fork = name in ("busd", "bus") or (name == "python" and not is_nightly())
    if is_fork and cli.forks and cli.forks.can_run(environment):
        with chdir(folder):
            return cli.forks.run(words, stdout=output, stderr=output, environment=environment)
    return subprocess.Popen(
        [sys.executable if name in PROGRAMS else name, *words],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=output,
        env=environment,
    )


Start = Callable[..., Program]


def check(program: Program, shown: Shown) -> None:
    """Read the shown output; a program that is not interrupted must print exactly that."""
    pattern = "\n".join(shape(line) for line in shown.output)
    if shown.is_interrupted:
        program.read_until(f"{pattern}\n" if pattern else "")
        return
    status = program.end()
    assert re.fullmatch(pattern, program.text.rstrip("\n")), program.text
    assert status == 0
