"""Hostile tokens and attachments of ROS 2 on zenoh: nothing raises, and the graph stays consistent."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus_bridge.engine import FarBus, FarEndpoint, FarNode
from bus_bridge.rmw_zenoh import attachment, qos_text
from bus_bridge.rmw_zenoh.graph import RosGraph
from bus_bridge.rmw_zenoh.keys import EndpointToken, parse_token
from bus_bridge.ros2.known_types import KnownTypes
from bus_bridge.ros2.service_types import KnownServices

pytest.importorskip("xxhash", reason="needs the extra rmw-zenoh: make setup installs it")

STRING = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
TRIGGER = "RIHS01_00"
PART = st.sampled_from(["%", "%a", "a", "talker", "a b", "", "%chatter", "%a%%b", "é", "0", "-1", "99" * 20])
TYPE = st.sampled_from(
    [
        "std_msgs::msg::dds_::String_",
        "std_srvs::srv::dds_::Trigger_",
        "a::b::dds_::C_",
        "x",
        "o::msg::dds_::O_",
    ]
)
QOS = st.one_of(st.sampled_from(["::,10:,:,:,,", "2:1:,1:,:,:,,"]), st.text("0123456789:,", max_size=40))
TOKENS = st.builds(
    "/".join,
    st.tuples(
        st.sampled_from(["@ros2_lv", "@ros2_lv", "@x"]),
        st.just("0"),
        st.sampled_from(["ab", "cd", "own", "0f", "ZZ"]),
        st.sampled_from(["0", "1", "x"]),
        st.sampled_from(["0", "1", "2", "3"]),
        st.sampled_from(["NN", "MP", "MS", "SS", "SC", "XX"]),
        st.sampled_from(["%", "%", "%busd%x"]),
        PART,
        PART,
        PART,
        TYPE,
        st.sampled_from([STRING, TRIGGER, "%"]),
        QOS,
    ).flatmap(lambda parts: st.sampled_from([parts, parts[:9], parts[:11]])),
)


class Far:
    """Checks what the bridge is told."""

    def __init__(self) -> None:
        self.nodes: set[str] = set()
        self.endpoints: dict[bytes, str] = {}

    def bus_added(self, bus: FarBus) -> None: ...
    def bus_removed(self, bus_id: str, reason: str) -> None: ...
    def warn(self, text: str) -> None:
        assert len(text) < 2000

    def node_added(self, node: FarNode) -> None:
        assert node.key not in self.nodes
        self.nodes.add(node.key)

    def node_removed(self, key: str) -> None:
        assert key not in self.endpoints.values()
        self.nodes.remove(key)

    def endpoint_added(self, endpoint: FarEndpoint) -> None:
        assert endpoint.node in self.nodes
        assert endpoint.gid not in self.endpoints
        self.endpoints[endpoint.gid] = endpoint.node

    def endpoint_removed(self, gid: bytes, node: str) -> None:
        assert self.endpoints.pop(gid) == node


@given(st.lists(st.tuples(TOKENS, st.booleans()), max_size=40), st.sampled_from(["ab", "cd"]))
def test_a_graph_of_hostile_tokens(news: list[tuple[str, bool]], refused: str) -> None:
    far = Far()
    graph = RosGraph(
        "rmw_zenoh0", "own", KnownTypes(), KnownServices(), far, lambda gid: None, lambda gid: None
    )
    for key, is_there in news:
        (graph.came if is_there else graph.gone)(key)
        assert {*graph.publishers} <= {*far.endpoints}
    graph.types_changed()
    graph.refuse(f"session {refused}")
    graph.forget_refused()
    assert not [key for key in far.nodes if key.startswith(f"{refused}/")]
    for key, _ in news:
        graph.gone(key)
    assert (far.nodes, far.endpoints, graph.sessions) == (set(), {}, 0)


@given(st.text(max_size=300))
def test_texts_are_no_tokens(text: str) -> None:
    for key in (text, f"@ros2_lv/0/ab/0/0/{text}"):
        found: Any = parse_token(key)
        assert found is None or isinstance(found, tuple)
        if isinstance(found, EndpointToken):
            assert found.kind in ("MP", "MS", "SS", "SC")
    qos_text.read(text)


@given(st.binary(max_size=80))
def test_attachments(data: bytes) -> None:
    found = attachment.read(data)
    assert (found is None) is (len(data) not in (32, 33) or (len(data) == 33 and data[16] != 16))
    if found is not None:
        assert attachment.read(attachment.write(*found)) == found
