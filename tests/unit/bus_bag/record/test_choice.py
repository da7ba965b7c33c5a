"""The topics to record."""

from typing import Any

import pytest

from bus.errors import ConfigurationError
from bus.graph import Graph, GraphEndpoint, GraphNode
from bus.qos import QoSProfile
from bus_bag.record.choice import Choice, Found, Wanted
from rows import for_each

OWN = "/recorder"
STRING, INT = ("std_msgs/msg/String", "s"), ("std_msgs/msg/Int32", "i")
EVENT = ("std_srvs/srv/Trigger_Event", "e")


def graph(
    publishers: dict[str, list[tuple[str, str]]], heard: dict[str, tuple[str, tuple[str, str]]] | None = None
) -> Graph:
    """`publishers`: topic -> types; `heard`: topic -> node and type of a subscription."""

    def endpoint(kind: str, node: str, topic: str, type_: tuple[str, str]) -> GraphEndpoint:
        made = GraphNode(id=1, name=node.strip("/"), namespace="/", pid=1)
        return GraphEndpoint(1, kind, made, topic, *type_, gid=b"", qos=QoSProfile())

    return Graph(
        revision=1,
        broker_pid=1,
        nodes=(),
        publishers=tuple(
            endpoint("publisher", "/talker", topic, one)
            for topic, types in publishers.items()
            for one in types
        ),
        subscriptions=tuple(
            endpoint("subscription", node, topic, one) for topic, (node, one) in (heard or {}).items()
        ),
        matches=(),
    )


ROBOT = graph(
    {
        "/camera/image": [STRING],
        "/camera/info": [INT],
        "/imu": [INT],
        "/_hidden": [INT],
        "/ask/_service_event": [EVENT],
        "/ask/_request": [STRING],
    },
    {"/imu": ("/driver", INT), "/wanted": ("/driver", INT), "/camera/info": (OWN, INT)},
)
TOPICS = ["/camera/image", "/camera/info", "/imu"]


def chosen(graph: Graph, **wanted: Any) -> list[str]:
    sets = {key: frozenset(value) if isinstance(value, list) else value for key, value in wanted.items()}
    options: Any = Wanted
    return [one.topic for one in Choice(options(**sets), OWN).choose(graph)[0]]


@for_each(
    ("wanted", "topics"),
    [
        ({}, []),
        ({"all_topics": True}, TOPICS),
        ({"all_topics": True, "all_services": True}, ["/ask/_service_event", *TOPICS]),
        ({"all_services": True}, ["/ask/_service_event"]),
        ({"services": ["/ask"]}, ["/ask/_service_event"]),
        ({"topics": ["/imu", "/nowhere"]}, ["/imu"]),
        ({"topics": ["/_hidden"]}, []),
        ({"topics": ["/_hidden"], "include_hidden_topics": True}, ["/_hidden"]),
        ({"topic_types": ["std_msgs/msg/Int32"]}, ["/camera/info", "/imu"]),
        ({"regex": "camera"}, ["/camera/image", "/camera/info"]),
        ({"regex": "^/imu$", "topics": ["/camera/info"]}, ["/camera/info", "/imu"]),
        ({"regex": "info", "topic_types": ["std_msgs/msg/String"]}, ["/camera/image", "/camera/info"]),
        ({"all_topics": True, "exclude_regex": "ima"}, ["/camera/info", "/imu"]),
        ({"all_topics": True, "exclude_topics": ["/imu"]}, ["/camera/image", "/camera/info"]),
        ({"all_topics": True, "exclude_topic_types": ["std_msgs/msg/Int32"]}, ["/camera/image"]),
        ({"all_services": True, "exclude_services": ["/ask"]}, []),
        ({"all_topics": True, "include_unpublished_topics": True}, [*TOPICS, "/wanted"]),
        ({"all_topics": True, "ignore_leaf_topics": True}, ["/imu"]),
        ({"all_topics": True, "include_hidden_topics": True}, ["/_hidden", *TOPICS]),
    ],
)
def test_what_is_recorded(wanted: dict[str, Any], topics: list[str]) -> None:
    assert chosen(ROBOT, **wanted) == topics


def test_what_is_found_has_its_type() -> None:
    found, _ = Choice(Wanted(topics=frozenset(["/imu"])), OWN).choose(ROBOT)
    assert found == [Found("/imu", *INT)]


def test_why_some_are_not_is_said_once() -> None:
    choice = Choice(Wanted(all_topics=True), OWN)
    two = graph({"/two": [STRING, INT], "/_a": [INT], "/_b": [INT]})
    found, reasons = choice.choose(two)
    assert found == []
    assert reasons == [
        "Hidden topics are not recorded. Enable them with --include-hidden-topics",
        "Topic '/two' has more than one type associated. Only topics with one type are supported",
    ]
    assert choice.choose(two) == ([], [])


@for_each(
    ("wanted", "recorded", "is_complete"),
    [
        (Wanted(topics=frozenset(["/a", "/b"])), ["/a", "/b"], True),
        (Wanted(topics=frozenset(["/a", "/b"])), ["/a"], False),
        (Wanted(services=frozenset(["/s"])), ["/s/_service_event"], True),
        (Wanted(topics=frozenset(["/a"]), regex="b"), ["/a"], False),
        (Wanted(all_topics=True), [], False),
    ],
)
def test_when_nothing_more_can_be_found(wanted: Wanted, recorded: list[str], is_complete: bool) -> None:
    assert Choice(wanted, OWN).is_complete(recorded) is is_complete


def test_no_regular_expression() -> None:
    with pytest.raises(ConfigurationError, match=r"'\[' is not a regular expression: unterminated"):
        Choice(Wanted(regex="["), OWN)
