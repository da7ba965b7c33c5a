"""Names of nodes."""

from typing import Any

import pytest

from bus_ros.ros2node import api
from rows import for_each


class Graph:
    """A node that answers questions about names."""

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        return [("talker", "/"), ("camera", "/robot"), ("_tool", "/")]


def test_all_nodes() -> None:
    node: Any = Graph()
    names = api.get_node_names(node=node)
    assert names == [("talker", "/", "/talker"), ("camera", "/robot", "/robot/camera")]
    assert names[1].full_name == "/robot/camera" and names[1].namespace == "/robot"
    assert [one.name for one in api.get_node_names(node=node, include_hidden_nodes=True)][2:] == ["_tool"]


@for_each(
    ("name", "parts"),
    [
        ("talker", ("talker", "/", "/talker")),
        ("/robot/talker", ("talker", "/robot", "/robot/talker")),
        ("a/b/c", ("c", "/a/b", "/a/b/c")),
    ],
)
def test_parts_of_a_name(name: str, parts: tuple[str, str, str]) -> None:
    assert api.parse_node_name(name) == parts


def test_full_names() -> None:
    assert api.get_absolute_node_name("talker") == api.get_absolute_node_name("/talker") == "/talker"
    assert api.get_absolute_node_name("") is None


def test_endpoints_of_a_node() -> None:
    asked = []

    def find(name: str, namespace: str) -> list[tuple[str, list[str]]]:
        asked.append((name, namespace))
        return [("/chatter", ["std_msgs/msg/String"]), ("/a/_b/c", ["x"])]

    (found,) = api.get_topics("robot/talker", find)
    assert (found.name, found.types) == ("/chatter", ["std_msgs/msg/String"])
    assert len(api.get_topics("/talker", find, include_hidden_topics=True)) == 2
    assert asked == [("talker", "/robot"), ("talker", "/")]


def test_duplicates() -> None:
    assert api.has_duplicates(["a", "b", "a"]) and not api.has_duplicates(["a", "b"])
    warned = api.INFO_NONUNIQUE_WARNING_TEMPLATE.format(num_nodes=2, node_name="/talker")
    assert warned.startswith('There are 2 nodes in the graph with the exact name "/talker".')


def test_waiting_for_a_node(monkeypatch: pytest.MonkeyPatch) -> None:
    node: Any = Graph()
    assert api.wait_for_node(node, "/talker")
    monkeypatch.setattr("bus_ros.ros2cli.helpers.sleep", lambda _: None)
    assert not api.wait_for_node(node, "/_tool", timeout=0.0)
    assert api.wait_for_node(node, "/_tool", include_hidden_nodes=True, timeout=0.0)
