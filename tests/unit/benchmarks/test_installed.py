"""benchmarks/installed.py: busd as its users install it."""

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import facade
from benchmarks.installed import installed
from benchmarks.systems import BUS, RCLPY, ROS


def test_what_is_no_tree_is_told() -> None:
    with installed(Path("/nowhere")) as found:
        assert found.python == sys.executable
        assert "No such file" in found.why_not


def test_what_cannot_be_installed_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(command: tuple[str, ...], **ways: object) -> None:
        raise subprocess.CalledProcessError(1, command, stderr="much\nERROR: no network\n")

    monkeypatch.setattr(subprocess, "run", fail)
    with installed() as found:
        assert found == (sys.executable, "ERROR: no network")


def test_programs_of_busd_are_run_by_the_python_that_has_it() -> None:
    assert facade.run_by(BUS, "/there/python").runner == ("/there/python",)
    assert facade.run_by(RCLPY, "/there/python").runner == ("/there/python", *RCLPY.runner[1:])
    assert facade.run_by(ROS, "/there/python") == ROS
