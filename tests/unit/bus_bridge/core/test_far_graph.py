"""Announcements of far buses, checked against bounds, names and rules."""

from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from bus.qos import QoSProfile
from bus_bridge.core.bounds import Bounds
from bus_bridge.core.far_graph import FarGraph, Wrong
from bus_bridge.core.naming import Naming
from bus_bridge.core.rules import Rules, TopicRule
from bus_bridge.engine import EndpointKind, FarBus, FarEndpoint, FarNode


def far(namespace: str = "", bounds: Bounds | None = None, **rules: Any) -> FarGraph:
    made = FarGraph("here", bounds or Bounds(), Rules(**rules), Naming(namespace))
    assert not made.bus_added(FarBus("there"), 0.0)
    return made


def node(
    key: str, bus: str = "there", namespace: str = "/", via: tuple[str, ...] = (), announcer: str = ""
) -> FarNode:
    return FarNode(key, bus, "node", namespace, via, announcer)


def said(wrong: Wrong | None) -> str:
    return "" if wrong is None else wrong.reason


def endpoint(gid: int, key: str, topic: str = "/t", kind: EndpointKind = "publisher") -> FarEndpoint:
    gid_bytes = gid.to_bytes(16, "big")
    return FarEndpoint(kind, gid_bytes, key, topic, "std_msgs/msg/String", "h", QoSProfile(10))


def topics(graph: FarGraph) -> list[str]:
    return sorted(one.topic for one in graph.endpoints.values())


def test_nodes_and_endpoints_come_and_go() -> None:
    graph = far()
    assert not graph.node_added(node("1"), 0) and not graph.endpoint_added(endpoint(1, "1"), 0)
    assert (list(graph.nodes), topics(graph)) == (["1"], ["/t"])
    assert not graph.endpoint_removed(bytes(15) + b"\1", "1", 0)
    assert (list(graph.nodes), topics(graph)) == (["1"], [])
    graph.endpoint_added(endpoint(1, "1"), 0)
    assert not graph.node_removed("1", 0)
    assert (graph.nodes, graph.endpoints) == ({}, {})


def test_what_is_said_of_unknown_things_is_ignored() -> None:
    graph = far()
    assert not graph.node_added(node("1", "nobody"), 0)
    assert not graph.endpoint_added(endpoint(1, "1"), 0)
    assert not graph.endpoint_removed(bytes(16), "1", 0)
    assert not graph.node_removed("1", 0)
    graph.bus_removed("nobody")
    assert (graph.nodes, graph.endpoints) == ({}, {})


def test_with_a_bus_all_goes_that_it_had() -> None:
    graph = far()
    graph.node_added(node("1"), 0)
    graph.endpoint_added(endpoint(1, "1"), 0)
    graph.bus_removed("there")
    assert (graph.nodes, graph.endpoints, graph.buses) == ({}, {}, [])


def test_what_came_through_this_bus_does_not_come_back() -> None:
    graph = far()
    graph.node_added(node("1", via=("here",)), 0)
    graph.endpoint_added(endpoint(1, "1"), 0)
    assert (graph.nodes, graph.endpoints) == ({}, {})
    assert graph.ways(endpoint(1, "1").gid) == []


def test_names_outside_of_the_namespace_stay_outside() -> None:
    graph = far("/bot1")
    for key, namespace in (("in", "/bot1/ns"), ("out", "/desk"), ("none", "/")):
        graph.node_added(node(key, namespace=namespace), 0)
    graph.endpoint_added(endpoint(1, "in", "/bot1/scan"), 0)
    graph.endpoint_added(endpoint(2, "in", "/scan"), 0)
    graph.endpoint_added(endpoint(3, "out", "/bot1/cmd"), 0)
    assert topics(graph) == ["/cmd", "/scan"]
    assert {key: one.namespace for key, one in graph.nodes.items()} == {"in": "/ns", "out": "/desk"}
    graph.endpoint_removed(endpoint(3, "out").gid, "out", 0)
    assert list(graph.nodes) == ["in"]


def test_rules_say_what_comes_in() -> None:
    graph = far(topics=[TopicRule(pattern="/out", direction="out"), TopicRule(pattern="/in", direction="in")])
    graph.node_added(node("1"), 0)
    for number, topic in enumerate(("/out", "/in")):
        graph.endpoint_added(endpoint(2 * number, "1", topic, "publisher"), 0)
        graph.endpoint_added(endpoint(2 * number + 1, "1", topic, "subscription"), 0)
    kinds = {(one.topic, one.far.kind) for one in graph.endpoints.values()}
    assert kinds == {("/out", "subscription"), ("/in", "publisher")}


def test_of_two_ways_the_first_is_used_and_then_the_other() -> None:
    graph = far()
    graph.bus_added(FarBus("other"), 0)
    graph.node_added(node("1"), 0)
    graph.node_added(node("2", "other", via=("there",)), 0)
    one, other = endpoint(1, "1"), endpoint(1, "2")
    graph.endpoint_added(one, 0)
    first = graph.endpoints[one.gid]
    graph.endpoint_added(other, 0)
    assert graph.endpoints[one.gid] is first
    assert graph.ways(one.gid) == ["there", "other"]
    graph.endpoint_removed(one.gid, "1", 0)
    assert graph.endpoints[one.gid].node.key == "2"
    graph.bus_removed("other")
    assert graph.endpoints == {}


def test_one_that_went_and_came_is_another() -> None:
    graph = far()
    graph.node_added(node("1"), 0)
    graph.endpoint_added(endpoint(1, "1"), 0)
    before = graph.endpoints[endpoint(1, "1").gid]
    graph.endpoint_added(endpoint(1, "1"), 0)
    assert graph.endpoints[before.far.gid] is before
    graph.endpoint_removed(before.far.gid, "1", 0)
    graph.endpoint_added(endpoint(1, "1"), 0)
    assert graph.endpoints[before.far.gid] is not before


def test_bounds() -> None:
    graph = far(bounds=Bounds(nodes=1, endpoints=2, types=1, buses=1))
    assert "there are 1 far buses" in said(graph.bus_added(FarBus("other"), 0))
    assert not graph.node_added(node("1"), 0)
    assert graph.node_added(node("2"), 0) == Wrong("there", "", "it has more than 1 nodes")
    graph.node_removed("2", 0)
    assert not graph.endpoint_added(endpoint(1, "1"), 0) and not graph.endpoint_added(endpoint(2, "1"), 0)
    assert "more than 2 endpoints" in said(graph.endpoint_added(endpoint(3, "1"), 0))
    other = FarEndpoint("publisher", bytes(16), "1", "/t", "std_msgs/msg/Other", "h", QoSProfile(10))
    assert "more than 1 types" in said(graph.endpoint_added(other, 0))


def test_of_many_tellers_the_one_with_most_is_refused() -> None:
    graph = far(bounds=Bounds(nodes=5, endpoints=5))
    for number in range(4):
        assert not graph.node_added(node(f"many{number}", announcer="many"), 0)
        assert not graph.endpoint_added(endpoint(number, f"many{number}"), 0)
    assert not graph.node_added(node("one", announcer="one"), 0)
    wrong = graph.node_added(node("other", announcer="other"), 0)
    most = "it has 4 of them, more than any other"
    assert wrong == Wrong("there", "many", f"its bus has more than 5 nodes, and {most}")
    graph.forget(wrong)
    assert list(graph.nodes) == ["one", "other"] and not graph.endpoints
    for number in range(5):
        assert not graph.endpoint_added(endpoint(number, "other"), 0)
    wrong = graph.endpoint_added(endpoint(9, "one"), 0)
    assert wrong is not None and wrong.announcer == "other"
    graph.forget(wrong)
    assert list(graph.nodes) == ["one"] and topics(graph) == ["/t"]
    wrong = graph.node_added(node("bad name!", announcer="one"), 0) or graph.wrong("one", "it lies")
    assert wrong == Wrong("there", "one", "it lies")
    graph.forget(wrong)
    assert not graph.nodes and graph.wrong("one", "it lies") is None
    assert graph.buses == ["there"]


def test_of_tellers_with_few_each_the_newest_is_refused() -> None:
    graph = far(bounds=Bounds(nodes=30, endpoints=30))
    for number in range(2):
        assert not graph.node_added(node(f"old{number}", announcer="old"), 0)
        assert not graph.endpoint_added(endpoint(number, f"old{number}"), 0)
    for number in range(28):
        assert not graph.node_added(node(f"{number}", announcer=f"name {number}"), 0)
    wrong = graph.node_added(node("last", announcer="last"), 0)
    assert wrong == Wrong("there", "last", "its bus has more than 30 nodes, and it came last")
    graph.forget(wrong)
    for number in range(2, 30):
        assert not graph.endpoint_added(endpoint(number, f"{number - 2}"), 0)
    wrong = graph.endpoint_added(endpoint(30, "0"), 0)
    assert wrong == Wrong("there", "name 27", "its bus has more than 30 endpoints, and it came last")
    assert {"old0", "old1"} <= graph.nodes.keys()


def test_who_tells_too_much_alone_is_refused() -> None:
    graph = far(bounds=Bounds(nodes=2, endpoints=1, news_per_s=10))
    assert not graph.node_added(node("quiet", announcer="quiet"), 0)
    for _ in range(10):
        wrong = graph.node_added(node("1", announcer="loud"), 0.0) or graph.node_removed("1", 0.0)
    assert wrong is not None and wrong.announcer == "loud"
    graph.forget(wrong)
    assert list(graph.nodes) == ["quiet"]


def test_news_are_bounded_in_time() -> None:
    graph = far(bounds=Bounds(nodes=1, endpoints=1, news_per_s=10))
    wrong = [graph.node_added(node("1"), 0.0) or graph.node_removed("1", 0.0) for _ in range(10)]
    assert any("more than 10 times in a second" in said(one) for one in wrong)
    graph = far(bounds=Bounds(nodes=1, endpoints=1, news_per_s=10))
    assert not any(
        graph.node_added(node("1"), at / 5) or graph.node_removed("1", at / 5) for at in range(100)
    )


def test_a_bus_that_comes_and_goes_has_the_rate_of_one_that_stays() -> None:
    graph = far(bounds=Bounds(buses=4, nodes=1, endpoints=1, news_per_s=10))
    for _ in range(20):
        graph.bus_removed("there")
        wrong = graph.bus_added(FarBus("there"), 0.0)
    assert "more than 10 times in a second" in said(wrong)
    assert not graph.bus_added(FarBus("there"), 3.0)
    for number in range(1000):  # the memory of buses that have gone is bounded
        graph.bus_added(FarBus(f"bus{number}"), 3.0)
        graph.bus_removed(f"bus{number}")
    assert len(graph._news) <= 10 and ("there", "") in graph._news


def test_a_node_of_another_bus_can_not_be_claimed() -> None:
    graph = far()
    graph.bus_added(FarBus("other"), 0)
    graph.node_added(node("1"), 0)
    assert "names a node of 'there' as its own" in said(graph.node_added(node("1", "other"), 0))


def test_its_own_id_is_no_far_bus() -> None:
    assert "choose another with --id" in said(far().bus_added(FarBus("here"), 0))


_steps = st.lists(
    st.tuples(
        st.sampled_from(["node", "no node", "endpoint", "no endpoint", "bus", "no bus"]),
        st.sampled_from(["there", "other"]),
        st.integers(0, 3),
        st.integers(0, 3),
    ),
    max_size=60,
)


@given(_steps)
def test_whatever_is_said_the_rest_is_what_is_there(steps: list[tuple[str, str, int, int]]) -> None:
    graph = far("/bot1")
    nodes: dict[str, str] = {}
    endpoints: set[tuple[int, str]] = set()
    buses = {"there"}
    for act, bus, number, gid in steps:
        key = f"{bus}/{number}"
        match act:
            case "bus":
                graph.bus_added(FarBus(bus), 0)
                buses.add(bus)
            case "no bus":
                graph.bus_removed(bus)
                buses.discard(bus)
            case "node" if bus in buses:
                graph.node_added(node(key, bus, "/bot1" if number else "/"), 0)
                nodes[key] = bus
            case "no node":
                graph.node_removed(key, 0)
                nodes.pop(key, None)
            case "endpoint" if key in nodes:
                graph.endpoint_added(endpoint(gid, key, "/bot1/t"), 0)
                endpoints.add((gid, key))
            case "no endpoint":
                graph.endpoint_removed(gid.to_bytes(16, "big"), key, 0)
                endpoints.discard((gid, key))
        nodes = {key: bus for key, bus in nodes.items() if bus in buses}
        endpoints = {(gid, key) for gid, key in endpoints if key in nodes}
        assert {int.from_bytes(one) for one in graph.endpoints} == {gid for gid, _ in endpoints}
        used = {one.node.key for one in graph.endpoints.values()}
        assert set(graph.nodes) == {key for key in nodes if not key.endswith("/0") or key in used}


def test_other_rules_change_only_what_they_concern() -> None:
    graph = far()
    graph.node_added(node("1"), 0)
    for number, topic in enumerate(("/a", "/b", "/c"), 1):
        graph.endpoint_added(endpoint(number, "1", topic), 0)
    before = dict(graph.endpoints)
    gids = {one.topic: gid for gid, one in before.items()}
    rules = Rules(deny=["/a"], topics=[TopicRule(pattern="/b", max_rate_hz=5.0)])
    graph.reconfigure(rules, Naming("", rules.far_names))
    assert topics(graph) == ["/b", "/c"]
    assert graph.endpoints[gids["/c"]] is before[gids["/c"]]
    assert graph.endpoints[gids["/b"]].rule.max_rate_hz == 5.0
    assert graph.knows(gids["/a"]) and not graph.knows(bytes(16))
    rules = Rules(topics=[TopicRule(pattern="/d", far_name="/c")])
    graph.reconfigure(rules, Naming("", rules.far_names))
    assert topics(graph) == ["/a", "/b", "/d"]
    assert list(graph.nodes) == ["1"]


def test_other_rules_for_a_node_outside_of_the_namespace() -> None:
    graph = far("/bot1")
    graph.node_added(node("1", namespace="/other"), 0)
    graph.endpoint_added(endpoint(1, "1", "/bot1/t"), 0)
    assert (list(graph.nodes), topics(graph)) == (["1"], ["/t"])
    for _ in range(2):
        graph.reconfigure(Rules(deny=["/t"]), Naming("/bot1"))
        assert (list(graph.nodes), topics(graph)) == ([], [])
        graph.reconfigure(Rules(), Naming("/bot1"))
        assert (list(graph.nodes), topics(graph)) == (["1"], ["/t"])
