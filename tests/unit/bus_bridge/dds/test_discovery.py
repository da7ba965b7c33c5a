"""bus_bridge.dds.discovery: endpoints that can't be shown yet, refused participants, and ends."""

import itertools
from unittest.mock import Mock

import pytest

from bus_bridge.dds import discovery as module
from bus_bridge.dds.carrier import Discovered
from bus_bridge.dds.discovery import Discovery
from bus_bridge.dds.graph import Added, DomainGraph, announcer_of
from bus_bridge.dds.names import MARK
from bus_bridge.engine import FarNode
from bus_bridge.errors import BridgeError
from bus_bridge.ros2.known_types import KnownTypes
from bus_bridge.rtps.policies import Policies

_numbers = itertools.count(1)


def endpoint(topic: str = "rt/topic", **user_data: str) -> Discovered:
    """A discovered endpoint of an unknown type."""
    number = next(_numbers)
    gid = number.to_bytes(16, "big")
    return Discovered(
        number, bytes(16), "publisher", gid, topic, "no::msg::dds_::Such_", Policies(), user_data
    )


async def test_endpoints_of_unknown_types_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_UNKNOWN", 5)
    types, far = Mock(), Mock()
    types.find.side_effect = BridgeError("no definition")
    discovery = Discovery(Mock(), types, Mock(), far, lambda: None)
    monkeypatch.setattr(discovery, "_report", lambda news: None)
    came = [endpoint() for _ in range(8)]
    for one in came:
        discovery.endpoint_added(one)
    assert [*discovery._unknown] == [one.gid for one in came[:5]]
    assert any(
        "endpoints of ROS 2 have types that are not known" in call.args[0] for call in far.warn.call_args_list
    )
    discovery.types_changed()
    assert len(discovery._unknown) == 5
    for one in came:
        discovery.endpoint_removed(one.gid, one.handle)
    assert not discovery._unknown


def empty_graph() -> Mock:
    graph = Mock(next_time=None)
    graph.endpoints_of.return_value = graph.participant_removed.return_value = ()
    return graph


def silent(monkeypatch: pytest.MonkeyPatch) -> Discovery:
    """Reports nothing, and knows each type."""
    discovery = Discovery(empty_graph(), Mock(), Mock(), Mock(), lambda: None)
    monkeypatch.setattr(discovery, "_report", lambda news: None)
    monkeypatch.setattr(module, "_found", Mock())
    return discovery


async def test_the_publishers_of_a_topic_end_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    discovery = silent(monkeypatch)
    monkeypatch.setattr(module, "_found", lambda found, topic, *_: Mock(endpoint=Mock(topic=topic)))
    first, second = endpoint(), endpoint()
    for one in (first, second):
        discovery.endpoint_added(one)
    assert [*discovery.publishers["/topic"]] == [first.gid, second.gid]
    assert discovery.is_mirrored(first.gid) and discovery.is_far(first.handle)
    discovery.endpoint_removed(first.gid, first.handle)
    assert [*discovery.publishers["/topic"]] == [second.gid]
    assert not discovery.is_mirrored(first.gid) and not discovery.is_far(first.handle)
    discovery.endpoint_removed(second.gid, second.handle)
    assert discovery.publishers == {}


async def test_the_endpoint_of_another_busd_is_not_read_until_it_ends(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    discovery = silent(monkeypatch)
    marked = endpoint(**{MARK: "1"})
    discovery.endpoint_added(marked)
    assert discovery.is_marked(marked.handle) and not discovery.is_far(marked.handle)
    discovery.endpoint_removed(marked.gid, marked.handle)
    assert not discovery.is_marked(marked.handle)  # another endpoint may get the handle


async def test_a_participant_is_refused_until_it_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    discovery = silent(monkeypatch)
    participant = bytes(16)
    discovery.refuse(announcer_of(participant))
    refused, later = endpoint(), endpoint()
    discovery.endpoint_added(refused)
    assert discovery.is_marked(refused.handle) and not discovery.is_far(refused.handle)
    discovery.participant_removed(participant)
    discovery.endpoint_added(later)
    assert discovery.is_far(later.handle)


async def test_nodes_of_a_refused_participant_are_not_reported() -> None:
    far = Mock()
    discovery = Discovery(empty_graph(), Mock(), Mock(), far, lambda: None)
    refused, other = announcer_of(bytes(16)), announcer_of(b"o" * 16)
    nodes = [FarNode(name, "bus", name, "/", announcer=one) for name, one in (("a", refused), ("b", other))]
    discovery._report(Added(node) for node in nodes)
    discovery.refuse(refused)
    discovery._report(Added(node) for node in nodes)
    assert [call.args[0].name for call in far.node_added.call_args_list] == ["a", "b", "b"]


async def test_waiting_endpoints_are_looked_at_once() -> None:
    """A look for each of thousands of endpoints would hold up everything else."""
    looks = []

    class Graph(DomainGraph):
        @property
        def next_time(self) -> float | None:
            looks.append(self)
            return super().next_time

    discovery = Discovery(Graph("dds0"), KnownTypes(), Mock(), Mock(), lambda: None)
    for _ in range(100):
        discovery.endpoint_added(endpoint()._replace(type_name="std_msgs::msg::dds_::String_"))
    assert len(looks) == 1
    discovery.close()
