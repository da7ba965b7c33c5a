"""bus_cli.launch.completers: the shell's completions after `bus launch` and `bus run`."""

import os
from argparse import Namespace
from pathlib import Path

import pytest

from bus_cli.completion import packages
from bus_cli.launch.completers import complete_file_or_package, complete_launch_words, complete_run_words


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("up.launch.xml").write_text('<launch><arg name="speed"/><arg name="name"/></launch>')
    Path("broken.launch.py").write_text("raise SystemError")
    Path("talker.py").touch()
    Path("launch").mkdir()
    Path("launch/down.launch.yaml").touch()


def launch_words(first: str, *words: str, prefix: str = "") -> list[str]:
    return complete_launch_words(prefix, Namespace(package_or_file=first, words=[*words]))


def run_words(*words: str, prefix: str = "") -> list[str]:
    return complete_run_words(prefix, Namespace(words=[*words]))


def test_packages_that_come_with_busd_are_among_all() -> None:
    assert {"tf2_ros", "turtle_tf2_py", "turtlesim"} <= set(packages(""))


def test_packages_and_launch_files_come_first() -> None:
    offered = complete_file_or_package("")
    assert {"turtlesim", "up.launch.xml", f"launch{os.sep}"} <= set(offered)
    assert "talker.py" not in offered
    assert "launch/down.launch.yaml" in complete_file_or_package("launch/do")
    assert complete_file_or_package("nowhere/a") == complete_file_or_package("elsewhere/b")


def test_after_a_package_come_its_launch_files() -> None:
    assert launch_words("turtlesim") == ["multisim.launch.py"]
    assert launch_words("turtlesim", "mu", prefix="mu") == ["multisim.launch.py"]
    assert launch_words("no_such_package") == []


def test_after_a_file_come_its_arguments() -> None:
    assert launch_words("up.launch.xml") == ["speed:=", "name:="]
    assert launch_words("up.launch.xml", "name:=x", "s", prefix="s") == ["speed:="]
    assert launch_words("turtlesim", "multisim.launch.py") == []
    assert launch_words("broken.launch.py") == []


def test_a_package_then_its_programs_then_nothing() -> None:
    offered = run_words()
    assert {"turtlesim", "talker.py"} <= set(offered)
    assert "up.launch.xml" not in offered
    assert "mimic" in run_words("turtlesim")
    assert "mimic" in run_words("turtlesim", "mi", prefix="mi")
    assert run_words("turtlesim", "mimic") == []
    assert run_words("talker.py") == []
    assert run_words("no_such_package") == []
