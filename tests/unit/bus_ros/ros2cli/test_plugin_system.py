"""Plugins of `ros2`: classes found by entry points, versions, commands with verbs."""

import logging
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path
from typing import Any

import pytest

from bus_ros.ros2cli.command import CommandExtension, add_subparsers_on_demand, get_command_extensions
from bus_ros.ros2cli.entry_points import get_entry_points, get_first_line_doc, load_entry_points
from bus_ros.ros2cli.plugin_system import (
    PluginException,
    instantiate_extensions,
    order_extensions_by_name,
    satisfies_version,
)
from bus_ros.ros2cli.verb import VerbExtension, add_task_arguments, get_verb_extensions

PLUGIN = """
from ros2cli.command import CommandExtension, add_subparsers_on_demand
from ros2cli.verb import VerbExtension

class Robot(CommandExtension):
    "Commands of the robot."

    def add_arguments(self, parser, cli_name, *, argv=None):
        add_subparsers_on_demand(parser, cli_name, "_verb", "robot.verb", required=False, argv=argv)

    def main(self, *, parser, args):
        return args._verb.main(args=args)

class Arm(VerbExtension):
    '''
    Move the arm.

    More.
    '''

    def add_arguments(self, parser, cli_name):
        self.cli_name = cli_name
        parser.add_argument("angle", type=int)

    def add_task_arguments(self, group):
        group.add_argument("--task")

    def main(self, *, args):
        return args.angle

class Old(VerbExtension):
    EXTENSION_POINT_VERSION = "0.2"

class Bad(VerbExtension):
    def __init__(self):
        raise RuntimeError("no motor")
"""
POINTS = """
[robot.command]
robot = ros2_robot_plugin:Robot

[robot.verb]
arm = ros2_robot_plugin:Arm
leg = ros2_robot_plugin:Arm

[robot.odd]
bad = ros2_robot_plugin:Bad
missing = no_such_robot_module:Any
old = ros2_robot_plugin:Old

[task]
arm = ros2_robot_plugin:Arm
"""


@pytest.fixture(autouse=True)
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import bus_ros.import_hook  # noqa: F401

    (tmp_path / "ros2_robot_plugin.py").write_text(PLUGIN)
    metadata = tmp_path / "ros2_robot_plugin-1.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: ros2_robot_plugin\nVersion: 1\n")
    (metadata / "entry_points.txt").write_text(POINTS)
    monkeypatch.syspath_prepend(str(tmp_path))


def test_entry_points() -> None:
    assert sorted(get_entry_points("robot.verb")) == ["arm", "leg"]
    assert get_entry_points("robot.nothing") == {}
    loaded = load_entry_points("robot.verb", exclude_names=["leg"])
    assert [(name, one.__name__) for name, one in loaded.items()] == [("arm", "Arm")]
    assert get_first_line_doc(loaded["arm"]) == "Move the arm"
    assert get_first_line_doc(type("NoDoc", (), {})) == ""


def test_objects_of_extensions(caplog: pytest.LogCaptureFixture) -> None:
    first = get_verb_extensions("robot.verb")
    assert isinstance(first["arm"], VerbExtension)
    assert first["arm"] is first["leg"] is get_verb_extensions("robot.verb")["arm"]
    assert instantiate_extensions("robot.verb", unique_instance=True)["arm"] is not first["arm"]
    assert list(order_extensions_by_name({"b": 1, "a": 2})) == ["a", "b"]
    with caplog.at_level(logging.WARNING):
        assert instantiate_extensions("robot.odd") == {}
    said = sorted(one.getMessage() for one in caplog.records)
    assert said == [
        "Failed to instantiate 'robot.odd' extension 'bad': no motor",
        "Failed to instantiate 'robot.odd' extension 'old': Extension point is too old (0.1), the extension "
        "requires '0.2'",
        "Failed to load entry point 'missing': No module named 'no_such_robot_module'",
    ]


@pytest.mark.parametrize(
    ("version", "wanted", "problem"),
    [
        ("0.1", "^0.1", None),
        ("0.1.5", "^0.1", None),
        ("1.9", "^1.4", None),
        ("0.1", "^0.2", "too old"),
        ("0.2", "^0.1", "newer"),
        ("2.0", "^1.4", "newer"),
    ],
)
def test_versions(version: str, wanted: str, problem: str | None) -> None:
    if problem is None:
        satisfies_version(version, wanted)
        return
    with pytest.raises(PluginException, match=problem):
        satisfies_version(version, wanted)
    with pytest.raises(ValueError, match="is not a range"):
        satisfies_version(version, wanted[1:])


def parsed(*words: str) -> Any:
    parser = ArgumentParser(prog="ros2", formatter_class=RawDescriptionHelpFormatter)
    add_subparsers_on_demand(parser, "ros2", "_command", "robot.command", argv=words)
    return parser, parser.parse_args(words)


def test_a_command_with_verbs() -> None:
    parser, args = parsed("robot", "arm", "7")
    assert isinstance(args._command, CommandExtension)
    assert (args._command.NAME, args._verb.cli_name) == ("robot", "ros2 robot arm")
    assert args._command.main(parser=parser, args=args) == 7
    assert get_command_extensions("robot.command")["robot"] is args._command


def test_help_and_mistakes(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (("--help",), ("robot", "--help"), ("robot", "--nonsense"), ()):
        with pytest.raises(SystemExit):
            parsed(*words)
    out, err = capsys.readouterr()
    assert "robot  Commands of the robot\n" in out
    assert "Call `ros2 robot <command> -h` for more detailed usage." in out
    assert "arm  Move the arm" in out
    assert "the following arguments are required:" in err


def test_a_base_command_does_nothing() -> None:
    base = CommandExtension()
    base.add_arguments(ArgumentParser(), "ros2")
    with pytest.raises(NotImplementedError):
        base.main(parser=ArgumentParser(), args=None)


def test_arguments_of_tasks() -> None:
    parser = ArgumentParser()
    add_task_arguments(parser, "task")
    assert parser.parse_args(["--task", "a"]).task == "a"
    assert "Arguments for 'arm' packages" in parser.format_help()
