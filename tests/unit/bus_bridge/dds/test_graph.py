from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.qos import QoSProfile
from bus_bridge.dds.graph import Added, DomainGraph, Found, NodeEntities, Removed, decode, encode
from bus_bridge.engine import FarEndpoint, FarNode
from rows import for_each

_GUIDS = st.binary(min_size=16, max_size=16)
_NAMES = st.text("abc_/", max_size=20)
_NODES = st.lists(
    st.builds(NodeEntities, _NAMES, _NAMES, st.lists(_GUIDS).map(tuple), st.lists(_GUIDS).map(tuple))
)


@given(_GUIDS, _NODES, st.sampled_from([16, 24]))
def test_what_is_said_of_nodes_comes_back(participant: bytes, nodes: list[NodeEntities], size: int) -> None:
    assert decode(encode(participant, nodes, size), size) == (participant, nodes)


def test_what_a_participant_says_in_cdr() -> None:
    participant, reader = bytes(range(16)), bytes(range(16, 32))
    text = encode(participant, [NodeEntities("/", "n", (reader,))])
    assert text == (
        b"\0\1\0\0" + participant + b"\1\0\0\0" + b"\2\0\0\0/\0\0\0" + b"\2\0\0\0n\0\0\0"
        + b"\1\0\0\0" + reader + b"\0\0\0\0"
    )  # fmt: skip
    humble = encode(participant, [NodeEntities("/", "n", (reader,))], 24)
    assert humble[4:28] == participant + bytes(8)
    assert len(humble) == len(text) + 16


@for_each(
    "data",
    [
        b"",
        b"\0\1\0\0",
        b"\0\7\0\0" + bytes(20),
        b"\0\1\0\0" + bytes(16) + b"\xff\xff\xff\xff",
        b"\0\1\0\0" + bytes(16) + b"\1\0\0\0" + b"\xff\xff\xff\x7f" + bytes(100),
        b"\0\1\0\0" + bytes(16) + b"\1\0\0\0" + b"\2\0\0\0\xff\0" + bytes(100),
    ],
)
def test_what_is_malformed_is_refused(data: bytes) -> None:
    with pytest.raises(ValueError):
        decode(data)


@for_each(
    ("nodes", "limit"),
    [
        ([NodeEntities("/", f"n{number}") for number in range(4097)], "4,097 nodes"),
        ([NodeEntities("/", "n", (), (bytes(16),) * 70_000)], "1,120,048 bytes"),
    ],
)
def test_a_long_list_of_nodes_is_refused_before_it_is_read(nodes: list[NodeEntities], limit: str) -> None:
    """Reading it would hold up everything else."""
    with pytest.raises(ValueError, match=limit):
        decode(encode(bytes(16), nodes))


@given(st.binary())
def test_random_bytes_are_no_more_than_refused(data: bytes) -> None:
    try:
        decode(b"\0\1\0\0" + data)
    except ValueError:
        pass


_P, _Q = (bytes([letter]) * 12 + b"\0\0\1\xc1" for letter in b"pq")
_GID = _P[:12] + b"\0\0\1\3"
_KEY = f"{_P.hex()}:/robot/talker"
_NODE = NodeEntities("/robot", "talker", (), (_GID,))


def _found(gid: bytes = _GID, participant: bytes = _P, topic: str = "/chatter") -> Found:
    endpoint = FarEndpoint("publisher", gid, "", topic, "std_msgs/msg/String", "", QoSProfile())
    return Found(participant, endpoint)


def _short(news: Any) -> list[str]:
    """News in a short form."""
    found = []
    for one in news:
        match one:
            case Added(FarNode() as node):
                found.append(f"+{node.namespace.rstrip('/')}/{node.name}")
            case Added(FarEndpoint() as endpoint):
                found.append(f"+{endpoint.topic} of {endpoint.node.rpartition(':')[2]}")
            case Removed(node, b""):
                found.append(f"-{node.rpartition(':')[2]}")
            case Removed(node, gid):
                found.append(f"-{gid[12:].hex()} of {node.rpartition(':')[2]}")
    return found


_BARE = f"/_dds_{_P[:12].hex()}"


def test_an_endpoint_is_told_once_its_node_is_known() -> None:
    graph = DomainGraph("dds0")
    assert _short(graph.endpoint_added(_found(), 0.0)) == []
    assert _short(graph.nodes_said(_P, [_NODE])) == ["+/robot/talker", "+/chatter of /robot/talker"]
    assert graph.next_time is None
    assert _short(graph.nodes_said(_P, [_NODE])) == []
    assert _short(graph.endpoint_removed(_GID)) == ["-00000103 of /robot/talker"]
    assert _short(graph.nodes_said(_P, [])) == ["-/robot/talker"]
    assert graph.participants == 0


def test_a_node_may_be_known_before_its_endpoints() -> None:
    graph = DomainGraph("dds0")
    assert _short(graph.nodes_said(_P, [_NODE])) == ["+/robot/talker"]
    assert _short(graph.endpoint_added(_found(), 0.0)) == ["+/chatter of /robot/talker"]
    assert graph.participants == 1


def test_an_endpoint_that_nobody_names_belongs_to_its_participant() -> None:
    graph = DomainGraph("dds0", patience_s=1.0)
    assert _short(graph.endpoint_added(_found(), 10.0)) == []
    assert graph.next_time == 11.0
    assert _short(graph.pass_time(10.9)) == []
    assert _short(graph.pass_time(11.0)) == [f"+{_BARE}", f"+/chatter of {_P.hex()}"]
    assert _short(graph.nodes_said(_P, [_NODE])) == [
        "+/robot/talker",
        f"-00000103 of {_P.hex()}",
        f"-{_P.hex()}",
        "+/chatter of /robot/talker",
    ]


def test_nobody_waits_for_the_nodes_of_a_participant_that_speaks_dds_alone() -> None:
    graph = DomainGraph("dds0")
    graph.participant_added(_P, speaks_ros=False)
    graph.participant_added(_Q, speaks_ros=True)
    assert _short(graph.endpoint_added(_found(), 0.0)) == [f"+{_BARE}", f"+/chatter of {_P.hex()}"]
    assert _short(graph.endpoint_added(_found(_Q[:12] + b"\0\0\1\3", _Q), 0.0)) == []
    _short(graph.participant_removed(_P))
    # It counts as a new participant, of which nothing is known.
    assert _short(graph.endpoint_added(_found(), 0.0)) == []


def test_a_participant_takes_all_with_it() -> None:
    graph = DomainGraph("dds0")
    other = _Q[:12] + b"\0\0\1\3"
    _short(graph.nodes_said(_P, [_NODE]))
    _short(graph.endpoint_added(_found(), 0.0))
    _short(graph.endpoint_added(_found(_P[:12] + b"\0\0\2\3"), 0.0))
    _short(graph.endpoint_added(_found(other, _Q), 0.0))
    _short(graph.pass_time(5.0))
    assert _short(graph.participant_removed(_P)) == [
        "-00000103 of /robot/talker",
        f"-00000203 of {_P.hex()}",
        f"-{_P.hex()}",
        "-/robot/talker",
    ]
    assert graph.participants == 1


def test_nodes_of_one_name_are_two() -> None:
    graph = DomainGraph("dds0")
    twins = [_NODE, NodeEntities("/robot", "talker")]
    assert _short(graph.nodes_said(_P, twins)) == ["+/robot/talker"] * 2
    assert _short(graph.nodes_said(_P, twins[:1])) == ["-/robot/talker#2"]


def test_nobody_speaks_of_the_endpoints_of_another() -> None:
    graph = DomainGraph("dds0")
    _short(graph.endpoint_added(_found(), 0.0))
    assert _short(graph.nodes_said(_Q, [NodeEntities("/", "thief", (), (_GID,))])) == ["+/thief"]
    assert _short(graph.nodes_said(_P, [_NODE])) == ["+/robot/talker", "+/chatter of /robot/talker"]


def test_an_endpoint_may_change_its_node() -> None:
    graph = DomainGraph("dds0")
    _short(graph.endpoint_added(_found(), 0.0))
    _short(graph.nodes_said(_P, [_NODE]))
    other = NodeEntities("/", "other", (), (_GID,))
    assert _short(graph.nodes_said(_P, [other])) == [
        "-00000103 of /robot/talker",
        "-/robot/talker",
        "+/other",
        "+/chatter of /other",
    ]


def test_an_endpoint_that_is_found_again_is_told_anew() -> None:
    graph = DomainGraph("dds0")
    _short(graph.nodes_said(_P, [_NODE]))
    _short(graph.endpoint_added(_found(), 0.0))
    assert _short(graph.endpoint_added(_found(topic="/other"), 0.0)) == [
        "-00000103 of /robot/talker",
        "+/other of /robot/talker",
    ]


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["node", "no node", "came", "went", "gone", "time", "dds alone", "ros"]),
            st.integers(0, 2),
        )
    )
)
def test_what_is_told_fits_together(story: list[tuple[str, int]]) -> None:
    graph = DomainGraph("dds0")
    nodes: set[str] = set()
    endpoints: dict[bytes, str] = {}
    for now, (what, number) in enumerate(story):
        gid = _P[:12] + bytes([0, 0, number, 3])
        named = NodeEntities("/", f"n{number % 2}", (), (gid,))
        news = {
            "node": lambda named=named: graph.nodes_said(_P, [named]),
            "no node": lambda: graph.nodes_said(_P, []),
            "came": lambda gid=gid, now=now: graph.endpoint_added(_found(gid), now),
            "went": lambda gid=gid: graph.endpoint_removed(gid),
            "gone": lambda: graph.participant_removed(_P),
            "time": lambda now=now: graph.pass_time(now),
            "dds alone": lambda: graph.participant_added(_P, speaks_ros=False) or iter(()),
            "ros": lambda: graph.participant_added(_P, speaks_ros=True) or iter(()),
        }[what]()
        for one in news:
            match one:
                case Added(FarNode() as node):
                    assert node.key not in nodes
                    nodes.add(node.key)
                case Added(FarEndpoint() as endpoint):
                    assert endpoint.node in nodes and endpoint.gid not in endpoints
                    endpoints[endpoint.gid] = endpoint.node
                case Removed(key, b""):
                    nodes.remove(key)
                    assert key not in endpoints.values()
                case Removed(key, gid):
                    assert endpoints.pop(gid) == key
    list(graph.participant_removed(_P))
    assert graph.participants == 0 and graph.next_time is None
