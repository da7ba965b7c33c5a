"""A component's description as a request to a container: names, rules, parameters, conditions."""

from pathlib import Path
from typing import Any

import pytest

from bus.errors import ConfigurationError
from bus_launch.launch.conditions import IfCondition
from bus_launch.launch.core import LaunchContext
from bus_launch.launch.substitutions import LaunchConfiguration
from bus_launch.launch_ros.actions import PushRosNamespace, SetParameter, SetRemap
from bus_launch.launch_ros.descriptions import ComposableNode, ParameterFile
from bus_launch.launch_ros.load_requests import LoadRequest, make_request


@pytest.fixture
def context() -> LaunchContext:
    made = LaunchContext()
    made.launch_configurations.update({"kind": "Talker", "no": "false"})
    return made


def request(context: LaunchContext, **given: Any) -> LoadRequest:
    made = make_request(ComposableNode(package="parts", plugin="parts:Talker", **given), context)
    assert made is not None
    return made


def test_the_least(context: LaunchContext) -> None:
    assert request(context) == LoadRequest("parts", "parts:Talker", "", "/", [], {}, {})


def test_substitutions_and_values(context: LaunchContext) -> None:
    description = ComposableNode(
        package="parts",
        plugin=["parts::", LaunchConfiguration("kind")],
        name=LaunchConfiguration("kind"),
        namespace="a/b",
        remappings=[("chatter", ["/", LaunchConfiguration("kind")])],
        parameters=[{"n": 1, "deep": {"x": [1.0, 2.0]}}, {"n": 2}],
        extra_arguments=[{"use_intra_process_comms": True}],
    )
    assert make_request(description, context) == LoadRequest(
        "parts",
        "parts::Talker",
        "Talker",
        "/a/b",
        ["chatter:=/Talker"],
        {"n": 2, "deep.x": [1.0, 2.0]},
        {"use_intra_process_comms": True},
    )


def test_settings_for_all_nodes(context: LaunchContext) -> None:
    for setting in (PushRosNamespace("robot"), SetParameter("n", 1), SetRemap("a", "b")):
        setting.execute(context)
    made = request(context, namespace="arm", parameters=[{"m": 2}], remappings=[("c", "d")])
    assert (made.node_namespace, made.remap_rules) == ("/robot/arm", ["a:=b", "c:=d"])
    assert made.parameters == {"n": 1, "m": 2}
    assert request(context, namespace="/arm").node_namespace == "/arm"


def test_a_parameter_of_the_component_is_used_instead_of_the_one_for_all_nodes(
    context: LaunchContext,
) -> None:
    SetParameter("n", 1).execute(context)
    assert request(context, parameters=[{"n": 2}, {"m": 3}]).parameters == {"n": 2, "m": 3}


def test_parameter_files(context: LaunchContext, tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text(
        "/**: {ros__parameters: {every: 1, kind: $(var kind)}}\n"
        "/ns/talker: {ros__parameters: {own: 2}}\n"
        "/other: {ros__parameters: {other: 3}}\n"
    )
    parameters = [ParameterFile(str(file), allow_substs=True), {"every": 4}]
    named = request(context, name="talker", namespace="ns", parameters=parameters)
    assert named.parameters == {"every": 4, "kind": "Talker", "own": 2}
    assert request(context, parameters=[file]).parameters == {"every": 1, "kind": "$(var kind)"}
    assert request(context, parameters=[str(tmp_path / "missing.yaml")]).parameters == {}
    file.write_text("a: [1, b]\n")
    with pytest.raises(ConfigurationError, match=r"a\.yaml"):
        request(context, parameters=[file])


def test_a_condition(context: LaunchContext) -> None:
    description = ComposableNode(package="a", plugin="b", condition=IfCondition(LaunchConfiguration("no")))
    assert make_request(description, context) is None
    context.launch_configurations["no"] = "true"
    assert make_request(description, context) is not None


def test_what_is_no_parameter() -> None:
    with pytest.raises(TypeError, match="parameter 'a'"):
        ComposableNode(package="a", plugin="b", parameters=[{"a": object()}])
    with pytest.raises(TypeError, match="remappings are a list of tuples"):
        ComposableNode(package="a", plugin="b", remappings={"a": "b"})  # type: ignore[dict-item]
