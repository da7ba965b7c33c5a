"""Runs a tutorial: writes its files and types its commands in one folder, in the order of the page.

Beside the conventions of `pages`, a page says with `...` that lines are left out, and as the last line that
the program runs on. It ends at the next start of the same program, or at the words "Ctrl-C in all terminals".
"""

import re
import signal
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import pages
from conftest import WAIT_S
from pages import Program, Shown, Start

__all__ = ["Tutorial"]

LEFT_OUT: Final = "..."
END_ALL: Final = "Ctrl-C in all terminals"
QUESTIONS: Final = ("bus topic info ", "bus topic list", "bus node list", "bus param get ")
"""Commands that are repeated until they print the shown lines: programs report counters twice a second."""
NOT_RUN: Final = ("pip ", "python3 -m venv ", ". .venv/", "mkdir ", "cd ", "cp ", "systemctl ", "loginctl ")
"""Beginnings of the lines in `sh` blocks."""

_BLOCK: Final = re.compile(r"^(?:`([\w./@-]+)`:\n\n)?```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_TOKEN: Final = re.compile(r"(?<=token=)[\w-]+")


class Block(NamedTuple):
    """A fenced block, the name of its file, and the text before it."""

    file: str
    language: str
    text: str
    before: str


class Tutorial:
    """A page, the folder in which its reader works, and the programs that run.

    `is_wanted` chooses sections. In lines with one of the `exact` texts, numbers are compared, too. `typed`
    replaces beginnings of commands. `meanwhile` maps the beginning of a command to another command, which
    runs before the first is interrupted.
    """

    def __init__(
        self,
        page: str,
        folder: Path,
        start: Start,
        *,
        is_wanted: Callable[[str], bool] = lambda section: True,
        exact: Collection[str] = (),
        typed: Mapping[str, str] | None = None,
        meanwhile: Mapping[str, str] | None = None,
    ) -> None:
        sections = re.split(r"^(?=## )", page, flags=re.MULTILINE)
        self._sections = [section for section in sections if is_wanted(section)]
        self._folder = folder
        self._start = start
        self._exact = exact
        self._typed = typed or {}
        self._meanwhile = meanwhile or {}
        self._running: dict[str, Program] = {}

    def run(self) -> None:
        for section in self._sections:
            for block in _blocks(section):
                if END_ALL in " ".join(block.before.split()):
                    self._end(self._running)
                self._do(block)
        assert not self._running, f"the page ends, but these run on: {[*self._running]}"

    def _do(self, block: Block) -> None:
        if block.language == "console":
            for shown in pages.console(f"```console\n{block.text}```\n"):
                self._type(shown)
        elif block.language == "text":
            newest = [*self._running.values()][-1]
            newest.read_until(self._pattern(block.text.splitlines()))
        elif block.language == "diff":
            path = self._folder / block.file
            path.write_text(patched(path.read_text(), block.text))
        elif block.language == "sh":
            assert all(line.startswith(NOT_RUN) for line in block.text.splitlines()), block.text
        elif block.language:
            assert block.file, f"this block has no file: {block.text}"
            (self._folder / block.file).write_text(block.text)

    def _type(self, shown: Shown) -> None:
        begin = shown.command.split()[:2]
        self._end([command for command in self._running if command.split()[:2] == begin])
        program = self._begin(shown.command)
        if shown.lines[-1:] == (LEFT_OUT,):
            self._wait(program, shown.command, shown.lines[:-1])
            self._running[shown.command] = program
        elif shown.is_interrupted:
            self._wait(program, shown.command, shown.output)
            if other := _by_beginning(self._meanwhile, shown.command):
                assert self._start(other[1], self._folder).end() == 0
            self._interrupt(program)
            for line in shown.farewell:
                assert re.search(self._pattern([line]), _lines(program.text)), program.text
        else:
            self._compare(program, shown)

    def _begin(self, command: str) -> Program:
        if found := _by_beginning(self._typed, command):
            command = found[1] + command.removeprefix(found[0])
        command, _, file = command.partition(" > ")
        program = self._start(command, self._folder)
        if file:
            program.end()
            (self._folder / file).write_text(program.text)
            program.text = ""
        return program

    def _wait(self, program: Program, command: str, lines: Sequence[str]) -> None:
        """Read until it has printed the lines. The processes of a launch print in any order."""
        for part in [[line] for line in lines] if command.startswith("bus launch") else [lines]:
            program.read_until(self._pattern(part))

    def _compare(self, program: Program, shown: Shown) -> None:
        """Compare the whole output, and the exit status."""
        pattern = self._pattern(shown.lines)
        until = time.monotonic() + WAIT_S
        program.end()
        while not re.fullmatch(pattern, _lines(program.text)):
            is_last = time.monotonic() > until or not shown.command.startswith(QUESTIONS)
            assert not is_last, f"{shown.command} printed:\n{program.text}"
            program = self._begin(shown.command)
            program.end()
        assert program.process.returncode == (" failed: " in program.text), program.text

    def _interrupt(self, program: Program) -> None:
        assert program.end(signal.SIGINT) in (0, -signal.SIGINT)
        assert "Traceback" not in program.text, program.text

    def _end(self, commands: Collection[str]) -> None:
        for command in [*commands]:
            self._interrupt(self._running.pop(command))

    def _pattern(self, lines: Sequence[str]) -> str:
        return "".join(self._line_pattern(line) for line in lines)

    def _line_pattern(self, line: str) -> str:
        if line == LEFT_OUT:
            return r"(?:.*\n)*?"
        if any(text in line for text in self._exact):
            return rf"{re.escape(line)}\n"
        return rf"{pages.shape(_TOKEN.sub('TOKEN', line)).replace('TOKEN', '[^ ]+')}\n"


def patched(text: str, change: str) -> str:
    """`text` after a change: lines that begin with a blank stay, those with `-` go, those with `+` come."""
    lines = [line if line.strip() else f" {line}" for line in change.splitlines(keepends=True)]
    old = "".join(line[1:] for line in lines if line[0] in " -")
    new = "".join(line[1:] for line in lines if line[0] in " +")
    assert text.count(old) == 1, f"not there, or more than once:\n{old}"
    return text.replace(old, new)


def _blocks(section: str) -> Iterator[Block]:
    """The blocks of a section. The text after the last one belongs to an empty block."""
    at = 0
    for found in _BLOCK.finditer(section):
        yield Block(found[1] or "", found[2], found[3], section[at : found.start()])
        at = found.end()
    yield Block("", "", "", section[at:])


def _by_beginning(entries: Mapping[str, str], command: str) -> tuple[str, str] | None:
    return next((entry for entry in entries.items() if command.startswith(entry[0])), None)


def _lines(text: str) -> str:
    """Lines as pages have them: without blanks at their ends, and without empty lines at the end."""
    return "".join(f"{line.rstrip()}\n" for line in text.rstrip().splitlines())
