"""The commands of docs/turtlesim.md run in their order, beside one turtlesim_node, and print such output."""

import re
import signal
from pathlib import Path

import pytest

from pages import ROOT, Program, Shown, Start, check, console, shape

SHOWN = console((ROOT / "docs" / "turtlesim.md").read_text())
NODE = "bus run turtlesim turtlesim_node"

pytestmark = [pytest.mark.landing, pytest.mark.usefixtures("daemon")]


def wait_for(program: Program, shown: Shown) -> None:
    for line in shown.output:
        program.read_until(shape(line).replace(re.escape("..."), r"\S+"))


def test_all_that_is_shown(start: Start, tmp_path: Path) -> None:
    first, *others = SHOWN
    assert first.command == NODE
    simulator = start(first.command)
    wait_for(simulator, first)
    for shown in others:
        folder = tmp_path if "turtlesim.yaml" in shown.command else ROOT
        command, _, file = shown.command.partition(" > ")
        program = start(command, folder)
        if command.startswith(NODE):
            wait_for(program, shown)
            assert program.end(signal.SIGINT) == 0
        elif file:
            assert program.end() == 0
            (tmp_path / file).write_text(program.text)
        elif any(" failed: " in line for line in shown.lines):
            assert program.end() == 1
            assert re.fullmatch("\n".join(map(shape, shown.lines)), program.text.rstrip("\n"))
        else:
            check(program, shown)
            if shown.is_interrupted:
                assert program.end(signal.SIGINT) == -signal.SIGINT
    simulator.read_until(r"\[INFO\] .*Rotation goal canceled")
    assert simulator.end(signal.SIGINT) == 0
    assert "Rotation goal completed successfully" in simulator.text
    assert "Traceback" not in simulator.text
