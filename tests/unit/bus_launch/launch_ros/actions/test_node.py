"""The command lines of nodes, from Python, XML and YAML alike."""

import re
import sys
from pathlib import Path
from typing import Any, List  # noqa: UP035 (a launch file's `data_type`)

import pytest
import yaml

from bus.errors import ConfigurationError
from bus_launch.launch.core import LaunchContext, SubstitutionFailure
from bus_launch.launch.launch_description_sources import get_launch_description_from_any_launch_file
from bus_launch.launch.substitutions import LaunchConfiguration
from bus_launch.launch_ros.actions import (
    Node,
    PushRosNamespace,
    SetParameter,
    SetParametersFromFile,
    SetRemap,
    SetUseSimTime,
)
from bus_launch.launch_ros.descriptions import Parameter, ParameterFile
from bus_launch.launch_ros.parameter_values import ParameterValue
from bus_launch.launch_ros.substitutions import ExecutableInPackage, FindPackagePrefix, FindPackageShare
from bus_launch.launch_ros.utilities import evaluate_parameters, normalize_parameters
from launching import perform, write
from rows import for_each

N = LaunchConfiguration("n")


@pytest.fixture
def prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package that colcon has installed."""
    write(
        tmp_path,
        {
            "share/ament_index/resource_index/packages/my_robot": "",
            "share/my_robot/package.xml": "<package/>",
            "share/my_robot/all.yaml": "/**: {ros__parameters: {n: $(var n), d: $(dirname)}}",
            "lib/my_robot/drive": "#!/usr/bin/env python3\n",
            "lib/my_robot/steer.sh": "#!/bin/sh\n",
        },
    )
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def prepared(*actions: Any) -> tuple[list[str], list[str], dict[str, Any]]:
    """The last action is a node. Returns its command as shown, its command as run, and its parameters by
    node.
    """
    context = LaunchContext()
    context.launch_configurations["n"] = "5"
    context.extend_locals({"current_launch_file_directory": "/here"})
    *before, node = actions
    for one in before:
        one.execute(context)
    node.prepare(context)
    shown = node.process_details["cmd"]
    parameters: dict[str, Any] = {}
    for at, word in enumerate(shown):
        if word == "--params-file":
            for name, values in yaml.safe_load(Path(shown[at + 1]).read_text()).items():
                parameters.setdefault(name, {}).update(values["ros__parameters"])
    node._Node__files.remove()
    return shown, node.process_description.command(), parameters


def test_a_node_with_all_that_it_may_have(prefix: Path) -> None:
    shown, executed, parameters = prepared(
        PushRosNamespace("/fleet"),
        PushRosNamespace("one"),
        SetParameter("shared", N),
        SetUseSimTime(True),
        SetRemap("a", "b"),
        Node(
            package="my_robot",
            executable="drive",
            name=["d", N],
            namespace="wheels",
            exec_name="driver",
            parameters=[
                {"speed": {"max": N}, "shared": 6},
                ParameterFile([FindPackageShare("my_robot"), "/all.yaml"], allow_substs=True),
                {"last": "5"},
            ],
            remappings=[("cmd", ["/cmd", N])],
            arguments=["--fast", N],
            ros_arguments=["--log-level", "debug"],
            prefix="nice -n 5",
        ),
    )
    assert re.sub(r"launch_params_\w+", "P", " ".join(shown)) == (
        f"nice -n 5 {prefix}/lib/my_robot/drive --fast 5 --ros-args --log-level debug -r __node:=d5 "
        "-r __ns:=/fleet/one/wheels "
        + "".join(f"--params-file {prefix_of(word)}P " for word in shown if "launch_params_" in word)
        + "-r a:=b -r cmd:=/cmd5"
    )
    start = [sys.executable, "-m", "bus_launch.python_program", f"{prefix}/lib/my_robot/drive", "--"]
    assert executed == ["nice", "-n", "5", *start, *shown[4:]]
    assert parameters == {
        "/fleet/one/wheels/d5": {
            "shared": 6,
            "use_sim_time": True,
            "speed.max": 5,
            "last": "5",
        },
        "/**": {"n": 5, "d": "/here"},
    }
    assert not [word for word in shown if "launch_params_" in word and Path(word).exists()]


def prefix_of(path: str) -> str:
    return path.partition("launch_params_")[0]


def test_a_node_with_nothing(prefix: Path) -> None:
    shown, executed, parameters = prepared(Node(package="my_robot", executable="steer.sh"))
    assert shown == executed == [f"{prefix}/lib/my_robot/steer.sh", "--ros-args"]
    assert parameters == {}


def test_parameters_of_a_node_without_a_name_are_for_any(prefix: Path) -> None:
    (prefix / "shared.yaml").write_text("/**: {ros__parameters: {a: 1, b: 2}}")
    _, _, parameters = prepared(
        SetParametersFromFile(str(prefix / "shared.yaml")),
        SetParameter("a", [1, 2]),
        Node(package="my_robot", executable="drive", parameters=[{"c": ["x", "1e3"]}]),
    )
    assert parameters == {"/**": {"a": [1, 2], "b": 2, "c": ["x", "1e3"]}}


MARKUP = {
    "xml": """
        <launch>
          <group>
            <push_ros_namespace namespace="/fleet"/>
            <set_remap from="a" to="b"/>
            <set_parameter name="shared" value="5"/>
            <node pkg="my_robot" exec="drive" name="d$(var n)" namespace="wheels" args="--fast $(var n) 'a b'"
                  ros_args="--log-level debug" output="screen" respawn="true" respawn_delay="0.5"
                  launch-prefix="nice">
              <param name="speed"><param name="max" value="$(var n)"/></param>
              <param name="text" value="5" type="str"/>
              <param name="list" value="1;2" value-sep=";"/>
              <param from="$(find-pkg-share my_robot)/all.yaml" allow_substs="true"/>
              <remap from="cmd" to="/cmd$(var n)"/>
              <env name="A" value="b"/>
            </node>
          </group>
        </launch>""",
    "yaml": """
        launch:
        - group:
          - push_ros_namespace: {namespace: /fleet}
          - set_remap: {from: a, to: b}
          - set_parameter: {name: shared, value: 5}
          - node:
              pkg: my_robot
              exec: drive
              name: d$(var n)
              namespace: wheels
              args: --fast $(var n) 'a b'
              ros_args: --log-level debug
              output: screen
              respawn: true
              respawn_delay: 0.5
              launch-prefix: nice
              param:
              - {name: speed, param: [{name: max, value: $(var n)}]}
              - {name: text, value: '5', type: str}
              - {name: list, value: [1, 2]}
              - {from: $(find-pkg-share my_robot)/all.yaml, allow_substs: true}
              remap: [{from: cmd, to: /cmd$(var n)}]
              env: [{name: A, value: b}]""",
}


@pytest.mark.parametrize("kind", MARKUP)
def test_in_markup(prefix: Path, kind: str) -> None:
    path = prefix / f"a.launch.{kind}"
    path.write_text(MARKUP[kind])
    group: Any
    (group,) = get_launch_description_from_any_launch_file(str(path)).entities
    actions = group.get_sub_entities()[2:-2]
    shown, _, parameters = prepared(*actions)
    words = [word for word in shown if "launch_params_" not in word and word != "--params-file"]
    assert " ".join(words) == (
        f"nice {prefix}/lib/my_robot/drive --fast 5 a b --ros-args --log-level debug -r __node:=d5 "
        "-r __ns:=/fleet/wheels -r a:=b -r cmd:=/cmd5"
    )
    assert parameters == {
        "/fleet/wheels/d5": {"shared": 5, "speed.max": 5, "text": "5", "list": [1, 2]},
        "/**": {"n": 5, "d": "/here"},
    }
    node = actions[-1]
    assert node.process_details["env"]["A"] == "b"


@for_each(
    ("sub", "value"),
    [
        (FindPackageShare("my_robot"), "{prefix}/share/my_robot"),
        (FindPackageShare("my_robot") / "a", "{prefix}/share/my_robot/a"),
        (FindPackagePrefix("my_robot"), "{prefix}"),
        (ExecutableInPackage(executable="drive", package="my_robot"), "{prefix}/lib/my_robot/drive"),
    ],
)
def test_packages(prefix: Path, sub: Any, value: str) -> None:
    assert perform(sub) == value.format(prefix=prefix)


@for_each(
    ("package", "executable", "text"),
    [
        ("my_robt", "drive", "package 'my_robt' not found, searching: .*; did you mean 'my_robot'"),
        (
            "my_robot",
            "driv",
            "executable 'driv' not found on the libexec directory '.*/lib/my_robot'; did you m",
        ),
        ("my_robot", "xyz", "'my_robot' has: drive, steer.sh"),
        (None, "nosuchprogram", "executable 'nosuchprogram' not found on the PATH"),
    ],
)
def test_programs_that_are_not_there(prefix: Path, package: str | None, executable: str, text: str) -> None:
    with pytest.raises(SubstitutionFailure, match=text):
        prepared(Node(package=package, executable=executable))


def test_parameters_by_themselves() -> None:
    context = LaunchContext()
    context.launch_configurations["n"] = "5"
    some = normalize_parameters(
        [{"a": {"b": N}}, Parameter("c", N, value_type=str), "/a.yaml", Path("/b.yaml")]
    )
    lists = normalize_parameters([{"d": [1, 2], "e": ParameterValue([1, 2], value_type=List[int])}])  # noqa: UP006
    assert evaluate_parameters(context, lists) == ({"d": (1, 2), "e": [1, 2]},)
    assert evaluate_parameters(context, some) == ({"a.b": 5}, {"c": "5"}, Path("/a.yaml"), Path("/b.yaml"))
    for wrong in ("/a.yaml", {"a": 1}):
        with pytest.raises(TypeError, match="Expecting list of parameters, got"):
            Node(executable="a", parameters=wrong)  # type: ignore[arg-type]


def test_no_parameter_file_stays_where_there_is_no_program(
    prefix: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (prefix / "temporary").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(prefix / "temporary"))
    with pytest.raises(SubstitutionFailure):
        Node(package="my_robot", executable="driv", parameters=[{"a": 1}]).execute(LaunchContext())
    assert list((prefix / "temporary").iterdir()) == []


def test_what_is_no_name(prefix: Path) -> None:
    with pytest.raises(ConfigurationError, match="node name must not contain characters other than"):
        prepared(Node(package="my_robot", executable="drive", name="a b"))
    with pytest.raises(ConfigurationError, match="namespace"):
        PushRosNamespace("a-b").execute(LaunchContext())
