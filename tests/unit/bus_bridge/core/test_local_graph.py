"""The part of this bus that is shown to others, as the graph changes."""

from typing import Any

import msgspec

from bus.endpoint.matches import Match
from bus.graph import Graph, GraphEndpoint, GraphNode, Origin
from bus.qos import QoSProfile
from bus_bridge.core.local_graph import Changes, LocalGraph
from bus_bridge.core.naming import Naming
from bus_bridge.core.rules import Rules, TopicRule
from bus_bridge.core.status import SERVICE_TYPE

_QOS = QoSProfile(10)


def node(number: int, name: str = "", **more: Any) -> GraphNode:
    return GraphNode(id=number, name=name or f"node{number}", namespace="/", pid=more.pop("pid", 1), **more)


def endpoint(kind: str, gid: int, of: GraphNode, topic: str, number: int = 0) -> GraphEndpoint:
    return GraphEndpoint(
        id=number or gid,
        kind=kind,
        node=of,
        topic=topic,
        type_name="std_msgs/msg/String",
        type_hash="h",
        gid=gid.to_bytes(16, "big"),
        qos=_QOS,
    )


def graph(
    *endpoints: GraphEndpoint, revision: int = 1, pid: int = 9, nodes: tuple[GraphNode, ...] = ()
) -> Graph:
    all_nodes = {one.node.id: one.node for one in endpoints} | {one.id: one for one in nodes}
    return Graph(
        revision=revision,
        broker_pid=pid,
        nodes=tuple(all_nodes.values()),
        publishers=tuple(one for one in endpoints if one.kind == "publisher"),
        subscriptions=tuple(one for one in endpoints if one.kind == "subscription"),
        matches=(),
    )


def local(namespace: str = "", **rules: Any) -> LocalGraph:
    return LocalGraph(Rules(**rules), Naming(namespace))


def told(changes: Changes) -> dict[str, list[str]]:
    return {
        name: [
            one.topic if hasattr(one, "topic") else getattr(one, "name", one)
            for one in getattr(changes, name)
        ]
        for name in changes.__struct_fields__
        if getattr(changes, name)
    }


def test_what_comes_and_goes() -> None:
    one = node(1)
    seen = local()
    publisher, subscription = endpoint("publisher", 1, one, "/a"), endpoint("subscription", 2, one, "/b")
    assert told(seen.update(graph(publisher, subscription))) == {
        "nodes": ["node1"],
        "subscriptions": ["/b"],
        "publishers": ["/a"],
    }
    assert told(seen.update(graph(publisher, subscription, revision=2))) == {}
    assert told(seen.update(graph(subscription, revision=3))) == {"gone": ["/a"]}
    assert told(seen.update(graph(revision=4))) == {"gone": ["/b"], "gone_nodes": ["node1"]}
    assert (seen.endpoints, seen.nodes) == ({}, [])


def test_what_rules_keep_in_is_known_and_not_shown() -> None:
    one = node(1)
    seen = local(deny=["/secret"])
    hidden = [endpoint("publisher", 1, one, "/secret"), endpoint("publisher", 2, one, "/rosout")]
    assert told(seen.update(graph(*hidden))) == {"nodes": ["node1"]}
    assert all(seen.knows(each.gid) for each in hidden)


def test_what_bridges_have_brought_is_not_shown_but_in_transit() -> None:
    far = node(1, origin=Origin("zenoh", "b", ("a",)))
    endpoints = [endpoint("publisher", 1, far, "/a"), endpoint("publisher", 2, far, "/b")]
    assert told(local().update(graph(*endpoints))) == {}
    changes = local(topics=[TopicRule(pattern="/a", transit=True)]).update(graph(*endpoints))
    assert told(changes) == {"nodes": ["node1"], "publishers": ["/a"]}
    assert changes.nodes[0].via == ("a", "b")


def test_what_was_brought_from_the_only_far_bus_does_not_go_back_there_in_transit() -> None:
    own = endpoint("publisher", 1, node(1, origin=Origin("ros2", "dds0")), "/a")
    other = endpoint("publisher", 2, node(2, origin=Origin("ros2", "dds1")), "/b")
    # Another machine may have its own domain 0.
    through = endpoint("publisher", 3, node(3, origin=Origin("zenoh", "b", ("dds0",))), "/c")
    rules = Rules(topics=[TopicRule(pattern="/**", transit=True)])
    changes = LocalGraph(rules, Naming(), "dds0").update(graph(own, other, through))
    assert {one.name for one in changes.nodes} == {"node2", "node3"}
    assert {one.topic for one in changes.publishers} == {"/b", "/c"}


def test_a_mirror_that_has_come_another_way_between_two_looks_is_shown_as_such() -> None:
    """Otherwise, the bus behind the new way would take the mirror for its own way."""
    seen = local(topics=[TopicRule(pattern="/a", transit=True)])
    direct = node(1, "far", origin=Origin("bridge", "c"))
    around = node(2, "far", origin=Origin("bridge", "b", ("c",)))
    seen.update(graph(endpoint("publisher", 1, direct, "/a", number=10)))
    changes = seen.update(graph(endpoint("publisher", 1, around, "/a", number=11), revision=2))
    assert [one.local.node.via for one in changes.gone] == [("c",)]
    assert [one.local.node.via for one in changes.publishers] == [("c", "b")]


def test_a_bridge_itself_is_not_shown_in_transit() -> None:
    bridge = node(1, "bridge_zenoh", origin=Origin("zenoh", "b"))
    asked = endpoint("subscription", 1, bridge, "/bridge_zenoh/get_status/_request")
    asked = msgspec.structs.replace(asked, type_name=f"{SERVICE_TYPE}_Request")
    seen = local(topics=[TopicRule(pattern="/**", transit=True)])
    assert told(seen.update(graph(asked, endpoint("publisher", 2, bridge, "/rosout")))) == {}


def test_the_namespace_goes_in_front() -> None:
    changes = local("/bot1").update(graph(endpoint("publisher", 1, node(1), "/a")))
    assert changes.nodes[0].namespace == "/bot1"
    assert (changes.publishers[0].local.topic, changes.publishers[0].topic) == ("/bot1/a", "/a")
    long = "/" + "a" * 245
    changes = local("/bot1").update(graph(endpoint("publisher", 1, node(1), long)))
    assert changes.publishers == []
    assert "has 251 characters" in changes.warnings[0]


def test_a_busd_that_is_back_changes_nothing() -> None:
    seen = local()
    before = [endpoint("publisher", 1, node(5, "talker"), "/a"), endpoint("subscription", 2, node(6), "/b")]
    seen.update(graph(*before, revision=50))
    ids = [one.id for one in seen.nodes]
    first = graph(revision=1)
    assert seen.is_other_busd(first)
    assert told(seen.update(first, keeps=True)) == {}
    half = graph(endpoint("publisher", 1, node(9, "talker"), "/a", number=77), revision=2)
    assert told(seen.update(half, keeps=True)) == {}
    assert told(seen.update(half)) == {"gone": ["/b"], "gone_nodes": ["node6"]}
    assert [one.id for one in seen.nodes] == ids[:1]


def test_a_node_of_another_process_is_another_node() -> None:
    seen = local()
    seen.update(graph(nodes=(node(1, "talker", pid=1),)))
    changes = seen.update(graph(nodes=(node(1, "talker", pid=2),), revision=0, pid=8))
    assert told(changes) == {"nodes": ["talker"], "gone_nodes": ["talker"]}


def test_namesakes_are_kept_apart() -> None:
    seen = local()
    one, other = node(1, "talker"), node(2, "talker")
    changes = seen.update(graph(endpoint("publisher", 1, one, "/a"), endpoint("publisher", 2, other, "/b")))
    ids = {shown.topic: shown.local.node.id for shown in changes.publishers}
    assert len(set(ids.values())) == 2
    gone = seen.update(graph(endpoint("publisher", 2, other, "/b"), revision=2)).gone_nodes
    assert [one.id for one in gone] == [ids["/a"]]


def test_a_publisher_that_no_graph_has_shown() -> None:
    seen = local("/bot1", deny=["/secret"])
    match = Match("/ns/once", bytes(16), _QOS, "shm")
    changes = seen.add_short(match, ("/a", "std_msgs/msg/String", "h"))
    (shown,) = changes.publishers
    assert (shown.local.topic, shown.local.node.namespace, shown.local.node.name) == (
        "/bot1/a",
        "/bot1/ns",
        "once",
    )
    assert told(seen.add_short(match, ("/secret", "t", "h"))) == {}


def test_other_rules_change_only_what_they_concern() -> None:
    one, far = node(1), node(2, origin=Origin("zenoh", "b"))
    ends = [endpoint("publisher", number, one, topic) for number, topic in enumerate(("/a", "/b", "/c"), 1)]
    ends.append(endpoint("publisher", 4, far, "/t"))
    seen = local()
    seen.update(graph(*ends))
    rules = Rules(
        deny=["/a"],
        topics=[TopicRule(pattern="/b", far_name="/front"), TopicRule(pattern="/t", transit=True)],
    )
    seen.reconfigure(rules, Naming("", rules.far_names))
    changes = seen.update(graph(*ends))
    assert told(changes) == {"gone": ["/a", "/b"], "nodes": ["node2"], "publishers": ["/b", "/t"]}
    assert [shown.local.topic for shown in changes.publishers] == ["/front", "/t"]
    assert seen.hides(ends[0].gid) and not seen.hides(ends[1].gid)
    assert told(seen.update(graph(*ends, revision=2))) == {}
    seen.reconfigure(Rules(), Naming())
    assert told(seen.update(graph(*ends, revision=2))) == {
        "gone": ["/b", "/t"],
        "gone_nodes": ["node2"],
        "publishers": ["/a", "/b"],
    }
