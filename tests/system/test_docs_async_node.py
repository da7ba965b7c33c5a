"""Every program of docs/async-node.md runs as a user would run it, and its output is compared.

A command with `&` runs until the end of the test.
"""

import re
import signal
from pathlib import Path

import pytest

from cli import wait_for_graph
from pages import FILE, ROOT, Program, Shown, Start, blocks, check, console

PAGE = (ROOT / "docs" / "async-node.md").read_text()
SCRIPTS = dict(FILE.findall(PAGE))
SESSIONS = [console(f"```console\n{block}```\n") for block in blocks("console", PAGE)]

pytestmark = pytest.mark.usefixtures("daemon")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the programs of the page."""
    for name, text in SCRIPTS.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def test_every_program_is_run() -> None:
    commands = [shown.command.removesuffix(" &") for session in SESSIONS for shown in session]
    assert {command.split()[-1] for command in commands if command.startswith("bus run ")} == set(SCRIPTS)


@pytest.mark.parametrize("session", SESSIONS, ids=lambda session: session[-1].command)
def test_prints_what_is_shown(session: list[Shown], folder: Path, start: Start) -> None:
    """Programs of the same session run at the same time."""
    running: list[tuple[Program, Shown]] = []
    for shown in session:
        if shown.command.startswith("bus lifecycle "):
            wait_for_graph(lambda graph: "/camera/get_state" in graph.services())
        program = start(shown.command.removesuffix(" &"), folder)
        if shown.command.endswith(" &"):
            continue
        compare(program, shown)
        if shown.is_interrupted:
            running.append((program, shown))
    for program, shown in running:
        status = program.end(signal.SIGINT)
        assert "Traceback" not in program.text
        if shown.farewell:
            assert (status, tuple(program.text.splitlines()[-len(shown.farewell) :])) == (0, shown.farewell)
        else:
            assert status == -signal.SIGINT


def compare(program: Program, shown: Shown) -> None:
    """Numbers may differ in lines of the log, and in numbered messages. Everything else is the same."""
    if re.search(r"\[INFO\]|hello", "".join(shown.output)):
        check(program, shown)
    elif shown.is_interrupted:
        program.read_until("".join(rf"{re.escape(line)}\n" for line in shown.output))
    else:
        assert (program.end(), program.text.splitlines()) == (0, [*shown.output])


def test_the_archive_has_each_message(folder: Path, start: Start) -> None:
    start("bus run talker.py", folder)
    archive = start("bus run archive.py", folder)
    archive.read_until("(?:.*stored .*\n){3}")
    numbers = [int(number) for number in re.findall(r"stored hello (\d+)", archive.text)]
    assert numbers == [*range(numbers[0], numbers[0] + len(numbers))]
    stored = (folder / "archive.txt").read_text().splitlines()
    assert stored[: len(numbers)] == [f"hello {number}" for number in numbers]


@pytest.mark.parametrize(
    ("name", "ready", "status", "last"),
    [
        ("talker.py", "published", -signal.SIGTERM, "published"),
        ("patient.py", "waiting", 0, "goodbye"),
    ],
)
def test_sigterm(name: str, ready: str, status: int, last: str, folder: Path, start: Start) -> None:
    """One program calls `rclpy.init` inside of `asyncio.run`, the other outside, and catches the end."""
    program = start(f"bus run {name}", folder)
    program.read_until(f".*{ready}.*\n")
    assert program.end(signal.SIGTERM) == status
    assert "Traceback" not in program.text
    assert last in program.text.splitlines()[-1]
