"""nav2_common.launch: parameter files with other values, robots and their poses."""

import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from bus_launch.launch import LaunchContext, LaunchDescription, LaunchService
from bus_launch.launch.actions import DeclareLaunchArgument, LogInfo
from bus_launch.launch.conditions import IfCondition
from bus_launch.launch.core import SubstitutionFailure
from bus_launch.launch.substitutions import LaunchConfiguration, TextSubstitution
from bus_launch.nav2_common.launch import (
    HasNodeParams,
    LaunchConfigAsBool,
    ParseMultiRobotPose,
    ReplaceString,
    RewrittenYaml,
)
from rows import for_each

PARAMETERS = """
amcl:
  ros__parameters:
    use_sim_time: false
    speed: 1.5
    frames: [odom, map]
    map_file: "a.yaml"
server:
  ros__parameters:
    use_sim_time: false
"""
AMCL = {"use_sim_time": False, "speed": 1.5, "frames": ["odom", "map"], "map_file": "a.yaml"}


@pytest.fixture
def file(tmp_path: Path) -> str:
    path = tmp_path / "nav2.yaml"
    path.write_text(PARAMETERS)
    return str(path)


@pytest.fixture
def context() -> LaunchContext:
    return LaunchContext()


def rewritten(context: LaunchContext, *arguments: Any, **options: Any) -> Any:
    path = Path(RewrittenYaml(*arguments, **options).perform(context))
    return yaml.safe_load(path.read_text())


@for_each(
    ("rewrites", "options", "amcl", "server"),
    [
        ({}, {}, {}, {}),
        ({"use_sim_time": "True"}, {}, {"use_sim_time": True}, {"use_sim_time": True}),
        ({"amcl.ros__parameters.use_sim_time": "true"}, {}, {"use_sim_time": True}, {}),
        (
            {"use_sim_time": "x", "amcl.ros__parameters.use_sim_time": "y"},
            {},
            {"use_sim_time": "y"},
            {"use_sim_time": "x"},
        ),
        ({"speed": "2.5"}, {}, {"speed": "2.5"}, {}),
        ({"speed": "2.5", "map_file": "3"}, {"convert_types": True}, {"speed": 2.5, "map_file": 3}, {}),
        ({"map_file": "nan"}, {"convert_types": True}, {"map_file": "nan"}, {}),
        ({"amcl.ros__parameters.frames.1": "base"}, {}, {"frames": ["odom", "base"]}, {}),
        ({"server.ros__parameters.more.rate": "5"}, {"convert_types": True}, {}, {"more": {"rate": 5}}),
        ({"no_such_key": "5", "no.such.path": "5"}, {}, {}, {}),
    ],
)
def test_values(
    context: LaunchContext,
    file: str,
    rewrites: dict[str, str],
    options: Any,
    amcl: dict[str, Any],
    server: dict[str, Any],
) -> None:
    found = rewritten(context, file, rewrites, **options)
    assert found["amcl"]["ros__parameters"] == {**AMCL, **amcl}
    assert found["server"]["ros__parameters"] == {"use_sim_time": False, **server}


def test_keys(context: LaunchContext, file: str) -> None:
    context.launch_configurations["ns"] = "robot1"
    found = rewritten(context, file, {}, LaunchConfiguration("ns"), {"amcl": "where", "speed": "pace"})
    assert list(found) == ["robot1"]
    assert set(found["robot1"]) == {"where", "server"}
    assert found["robot1"]["where"]["ros__parameters"]["pace"] == 1.5
    assert list(rewritten(context, file, {}, "")) == ["amcl", "server"]


def test_what_can_not_be_rewritten(context: LaunchContext, tmp_path: Path, file: str) -> None:
    with pytest.raises(SubstitutionFailure, match=r"can't read '/nowhere/a\.yaml'"):
        rewritten(context, "/nowhere/a.yaml", {})
    (tmp_path / "no.yaml").write_text("{")
    with pytest.raises(SubstitutionFailure, match="is no YAML"):
        rewritten(context, str(tmp_path / "no.yaml"), {})
    with pytest.raises(SubstitutionFailure, match=r"no place for 'amcl\.ros__parameters\.speed\.x'"):
        rewritten(context, file, {"amcl.ros__parameters.speed.x": "1"})


def test_texts_are_replaced(context: LaunchContext, tmp_path: Path) -> None:
    path = tmp_path / "it.rviz"
    path.write_text("Topic: <robot_namespace>/scan\nFrame: <robot_namespace>/odom\n")
    context.launch_configurations["ns"] = "/one"
    made = ReplaceString(str(path), {"<robot_namespace>": ("/", "all", LaunchConfiguration("ns"))})
    assert Path(made.perform(context)).read_text() == "Topic: /all/one/scan\nFrame: /all/one/odom\n"
    unchanged = ReplaceString(str(path), {"Topic": "x"}, IfCondition("false"))
    assert unchanged.perform(context) == str(path)


def test_nothing_is_left_when_the_launch_has_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: str
) -> None:
    import tempfile

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    service = LaunchService()
    argument = DeclareLaunchArgument("file", default_value=RewrittenYaml(file, {"speed": "2"}))
    said = LogInfo(msg=LaunchConfiguration("file"))
    service.include_launch_description(LaunchDescription([argument, said]))
    assert service.run() == 0
    assert "launch_nav2_" in service.context.launch_configurations["file"]
    assert not Path(service.context.launch_configurations["file"]).exists()


def test_nodes_of_a_file(context: LaunchContext, file: str) -> None:
    assert HasNodeParams(file, "amcl").perform(context) == "True"
    assert HasNodeParams(file, "speed").perform(context) == "False"


@for_each(("given", "value"), [("1", "True"), ("Yes", "True"), ("off", "False"), ("maybe", "False")])
def test_truth(context: LaunchContext, given: str, value: str) -> None:
    context.launch_configurations["slam"] = given
    assert LaunchConfigAsBool("slam").perform(context) == value


def test_robots(context: LaunchContext, monkeypatch: pytest.MonkeyPatch) -> None:
    text = "one={x: 1.0, yaw: 1.5}; two={y: -2.0};"
    zero = dict.fromkeys(("x", "y", "z", "roll", "pitch", "yaw"), 0.0)
    both = {"one": {**zero, "x": 1.0, "yaw": 1.5}, "two": {**zero, "y": -2.0}}
    assert ParseMultiRobotPose(TextSubstitution(text=text)).perform(context) == both
    monkeypatch.setattr(sys, "argv", ["bus", "launch", "a.launch.py", f"robots:={text}"])
    assert ParseMultiRobotPose("robots").value() == both
    assert ParseMultiRobotPose("others").value() == {}
    with pytest.raises(SubstitutionFailure, match="'three' is no robot"):
        ParseMultiRobotPose(TextSubstitution(text="three")).perform(context)
