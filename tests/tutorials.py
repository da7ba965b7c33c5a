"""Runs a tutorial: its files are written and its commands typed, in the order of the page, in one folder."""

import re
import signal
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import pages
from conftest import WAIT_S
from pages import Program, Shown, Start

__all__ = ["Tutorial"]

LEFT_OUT: Final = "..."
"""A line of an output: some lines are left out. As the last one: the program runs on."""
END_ALL: Final = "Ctrl-C in all terminals"
"""Words of the text: programs that run on are interrupted."""
ASKS: Final = ("bus topic info ", "bus topic list", "bus node ", "bus param list", "bus service list")
"""Commands that are repeated until their output is as shown: programs report their counters twice a second."""
TYPED_ONLY: Final = ("pip install ", "mkdir ", "cd ", "systemctl ", "loginctl ", "journalctl ", "cp ")
"""Lines of `sh` blocks that are not run."""

_BLOCK: Final = re.compile(r"^(?:`([\w./@-]+)`:\n\n)?```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_TOKEN: Final = re.compile(r"(?<=token=)[\w-]+")


class Block(NamedTuple):
    """A fenced block, with the name of its file, and the text before it."""

    file: str
    language: str
    text: str
    before: str


class Tutorial:
    """The page is `text`; `is_wanted` chooses sections, `exact` are lines whose numbers count, too.

    `typed` replaces the beginning of commands, for ports and for folders of the user. `meanwhile` has commands
    that run before another one, known by its beginning, is interrupted.
    """

    def __init__(
        self,
        text: str,
        folder: Path,
        start: Start,
        *,
        is_wanted: Callable[[str], bool] = lambda section: True,
        exact: Collection[str] = (),
        typed: dict[str, str] | None = None,
        meanwhile: dict[str, str] | None = None,
    ) -> None:
        self._sections = [
            section for section in re.split(r"^(?=## )", text, flags=re.M) if is_wanted(section)
        ]
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
                    self._end_all()
                self._do(block)
        assert not self._running, f"the page ends, and these run on: {[*self._running]}"

    def _do(self, block: Block) -> None:
        if block.language == "console":
            for shown in pages.console(f"```console\n{block.text}```\n"):
                self._type(shown)
        elif block.language == "diff":
            path = self._folder / block.file
            path.write_text(patched(path.read_text(), block.text))
        elif block.language == "text":  # more of what the program prints that was started last
            [*self._running.values()][-1].read_until(self._pattern(block.text.splitlines()))
        elif block.language == "sh":
            assert all(line.startswith(TYPED_ONLY) for line in block.text.splitlines()), block.text
        elif block.language:
            assert block.file, f"a block without a name: {block.text}"
            (self._folder / block.file).write_text(block.text)

    def _type(self, shown: Shown) -> None:
        for command in [one for one in self._running if one.split()[:2] == shown.command.split()[:2]]:
            self._end(command)  # the same program is started again
        program = self._begin(shown)
        if shown.lines[-1:] == (LEFT_OUT,):
            self._wait(program, shown.command, shown.output[:-1])
            self._running[shown.command] = program
        elif shown.is_interrupted:
            self._wait(program, shown.command, shown.output)
            for begin, other in self._meanwhile.items():
                if shown.command.startswith(begin):
                    assert self._start(other, self._folder).end() == 0
            self._interrupt(program, shown)
        else:
            self._read(program, shown)

    def _wait(self, program: Program, command: str, lines: Sequence[str]) -> None:
        """Until it has printed these; processes of a launch print in any order."""
        for part in [[line] for line in lines] if command.startswith("bus launch") else [lines]:
            program.read_until(self._pattern(part))

    def _read(self, program: Program, shown: Shown) -> None:
        """Its whole output, and the status; a question is asked again until its answer is that shown."""
        pattern = self._pattern(shown.output)
        until = time.monotonic() + WAIT_S
        program.end()
        while not re.fullmatch(pattern, _lines(program.text)):
            is_over = time.monotonic() > until or not shown.command.startswith(ASKS)
            assert not is_over, f"{shown.command} printed:\n{program.text}"
            program = self._begin(shown)
            program.end()
        fails = "failed" in program.text
        assert program.process.returncode == (1 if fails else 0), program.text

    def _begin(self, shown: Shown) -> Program:
        command = shown.command
        for begin, other in self._typed.items():
            if command.startswith(begin):
                command = other + command.removeprefix(begin)
        command, _, file = command.partition(" > ")
        program = self._start(command, self._folder)
        if file:
            program.end()
            (self._folder / file).write_text(program.text)
            program.text = ""
        return program

    def _interrupt(self, program: Program, shown: Shown) -> None:
        assert program.end(signal.SIGINT) in (0, -signal.SIGINT)
        assert "Traceback" not in program.text, program.text
        for line in shown.farewell:
            assert re.search(self._pattern([line]), _lines(program.text)), program.text

    def _end(self, command: str) -> None:
        self._interrupt(self._running.pop(command), Shown(command, ()))

    def _end_all(self) -> None:
        for command in [*self._running]:
            self._end(command)

    def _pattern(self, lines: Collection[str]) -> str:
        return "".join(self._line(line) for line in lines)

    def _line(self, line: str) -> str:
        if line == LEFT_OUT:
            return r"(?:.*\n)*?"
        if line.strip() in self._exact:
            return f"{re.escape(line)}\n"
        return _TOKEN.sub(lambda found: r"[\w-]+", pages.shape(_TOKEN.sub("TOKEN", line))) + "\n"


def patched(text: str, change: str) -> str:
    """`text` after a change as `diff` shows it: lines begin with a blank, a minus or a plus."""
    lines = [line if line.strip() else f" {line}" for line in change.splitlines(keepends=True)]
    old = "".join(line[1:] for line in lines if line[0] in " -")
    new = "".join(line[1:] for line in lines if line[0] in " +")
    assert text.count(old) == 1, f"this is not there once:\n{old}"
    return text.replace(old, new)


def _blocks(section: str) -> Iterator[Block]:
    """The blocks of a section; the text after the last one belongs to an empty block."""
    at = 0
    for found in _BLOCK.finditer(section):
        yield Block(found[1] or "", found[2], found[3], section[at : found.start()])
        at = found.end()
    yield Block("", "", "", section[at:])


def _lines(text: str) -> str:
    """Without blanks at the ends of lines, which no page shows, and with an end of the last line."""
    return "".join(f"{line.rstrip()}\n" for line in text.rstrip().splitlines())
