"""bus_bridge.rmw_zenoh.graph: news of nodes and endpoints from tokens, which may be hostile."""

from collections.abc import Callable
from typing import Any

import pytest

from bus.names import reply_topic, request_topic
from bus.qos import QoSProfile
from bus_bridge.engine import FarBus, FarEndpoint, FarNode
from bus_bridge.rmw_zenoh import graph as module
from bus_bridge.rmw_zenoh.graph import RosGraph, ServiceKind, announcer_of
from bus_bridge.rmw_zenoh.keys import EndpointToken, Kind, NodeToken, gid_of, write_endpoint, write_node
from bus_bridge.ros2.known_types import TOO_MANY_UNKNOWN, KnownTypes
from bus_bridge.ros2.service_types import KnownServices, ServiceTypes

pytest.importorskip("xxhash", reason="needs the extra rmw-zenoh: make setup installs it")

OWN, ZID = "0123", "ab"
STRING = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
TRIGGER = ServiceTypes.find("std_srvs/srv/Trigger")
TALKER = NodeToken(ZID, "1", "/", "talker", is_of_busd=False)


class Far:
    """What the bridge is told."""

    def __init__(self) -> None:
        self.nodes: dict[str, FarNode] = {}
        self.endpoints: dict[bytes, FarEndpoint] = {}
        self.warnings: list[str] = []

    def bus_added(self, bus: FarBus) -> None: ...
    def bus_removed(self, bus_id: str, reason: str) -> None: ...

    def node_added(self, node: FarNode) -> None:
        assert node.key not in self.nodes
        self.nodes[node.key] = node

    def node_removed(self, key: str) -> None:
        assert not [one for one in self.endpoints.values() if one.node == key]
        del self.nodes[key]

    def endpoint_added(self, endpoint: FarEndpoint) -> None:
        assert endpoint.gid not in self.endpoints
        assert endpoint.node in self.nodes
        self.endpoints[endpoint.gid] = endpoint

    def endpoint_removed(self, gid: bytes, node: str) -> None:
        assert self.endpoints.pop(gid).node == node

    def warn(self, text: str) -> None:
        self.warnings.append(text)


class World:
    def __init__(self) -> None:
        self.far = Far()
        self.came: list[bytes] = []
        self.gone: list[bytes] = []
        self.types = KnownTypes()
        self.graph = RosGraph(
            "rmw_zenoh0", OWN, self.types, KnownServices(), self.far, self.came.append, self.gone.append
        )


@pytest.fixture
def world() -> World:
    return World()


def unmarked(token: str) -> str:
    return token.replace("%busd%x", "%")


def node(said: NodeToken = TALKER) -> str:
    return unmarked(write_node(0, said, "x"))


def endpoint(
    kind: Kind = "MP",
    topic: str = "/chatter",
    type_name: str = "std_msgs/msg/String",
    type_hash: str = STRING,
    number: int = 2,
    said: NodeToken = TALKER,
) -> str:
    token = EndpointToken(said, kind, topic, type_name, type_hash, QoSProfile(5))
    return unmarked(write_endpoint(0, token, number, "x"))


def test_a_publisher_comes_and_goes(world: World) -> None:
    key = endpoint()
    gid = gid_of(key)
    world.graph.came(node())
    world.graph.came(key)
    world.graph.came(key)
    assert world.far.nodes == {
        TALKER.key: FarNode(TALKER.key, "rmw_zenoh0", "talker", "/", announcer=announcer_of(ZID))
    }
    assert world.far.endpoints == {
        gid: FarEndpoint(
            "publisher", gid, TALKER.key, "/chatter", "std_msgs/msg/String", STRING, QoSProfile(5)
        )
    }
    assert world.came == [gid]
    assert gid in world.graph.publishers
    world.graph.gone(node())
    assert world.far.nodes  # an endpoint names it still
    world.graph.gone(key)
    world.graph.gone(key)
    assert (world.far.nodes, world.far.endpoints, world.gone) == ({}, {}, [gid])
    assert not world.graph.publishers
    assert world.graph.sessions == 0


def test_a_server_has_two_endpoints(world: World) -> None:
    kind = ServiceKind("/trigger", TRIGGER.type_name, TRIGGER.type_hash)
    key = endpoint("SS", *kind)
    world.graph.came(key)
    found = {one.kind: one for one in world.far.endpoints.values()}
    assert (found["publisher"].topic, found["publisher"].gid) == (reply_topic("/trigger"), gid_of(key))
    assert found["subscription"].topic == request_topic("/trigger")
    assert found["subscription"].type_hash == TRIGGER.requests.type_hash
    assert world.graph.servers_of(kind) == {gid_of(key): ZID}
    world.graph.gone(key)
    assert not world.graph.servers_of(kind)
    assert world.gone == [gid_of(key)]
    assert not world.far.nodes


def test_a_client_s_subscription_is_reported_first_and_removed_last(world: World) -> None:
    order: list[tuple[str, str]] = []
    far: Any = world.far
    for name in ("endpoint_added", "endpoint_removed"):
        _note(far, name, order, world.far.endpoints)
    key = endpoint("SC", "/trigger", TRIGGER.type_name, TRIGGER.type_hash)
    world.graph.came(key)
    world.graph.gone(key)
    assert order == [
        ("endpoint_added", reply_topic("/trigger")),
        ("endpoint_added", request_topic("/trigger")),
        ("endpoint_removed", request_topic("/trigger")),
        ("endpoint_removed", reply_topic("/trigger")),
    ]


def _note(far: Any, name: str, order: list[tuple[str, str]], known: dict[bytes, FarEndpoint]) -> None:
    original: Callable[..., None] = getattr(far, name)

    def call(first: Any, *rest: Any) -> None:
        order.append((name, first.topic if name == "endpoint_added" else known[first].topic))
        original(first, *rest)

    setattr(far, name, call)


def test_our_tokens_and_those_of_other_busds_are_ignored(world: World) -> None:
    world.graph.came(node(TALKER._replace(session=OWN)))
    world.graph.came(write_node(0, TALKER, "other"))
    assert not world.far.nodes


def test_a_type_that_becomes_known(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    key = endpoint(type_name="nowhere_msgs/msg/Thing", type_hash="RIHS01_00")
    world.graph.came(key)
    assert list(world.far.nodes) == [TALKER.key]
    assert not world.far.endpoints
    (text,) = world.far.warnings
    assert text.startswith("topic '/chatter' of ROS 2 is left out: ")
    monkeypatch.setattr(world.types, "find", lambda *_: world.types.learn(TRIGGER.requests))
    world.graph.types_changed()
    assert [one.topic for one in world.far.endpoints.values()] == ["/chatter"]
    world.graph.gone(key)
    assert not world.far.nodes


def test_other_definitions_are_left_out(world: World) -> None:
    world.graph.came(endpoint(type_hash="RIHS01_00"))
    world.graph.came(endpoint("SS", "/trigger", TRIGGER.type_name, "RIHS01_00", number=3))
    assert not world.far.endpoints
    assert [text.partition(": ")[2].partition(" (")[0] for text in world.far.warnings] == [
        "std_msgs/msg/String is another type in ROS 2",
        "std_srvs/srv/Trigger is another type in ROS 2",
    ]


def test_false_names_and_tokens_are_left_out(world: World) -> None:
    world.graph.came(node(TALKER._replace(name="a b")))
    world.graph.came(endpoint(topic="/no//topic"))
    world.graph.came("@ros2_lv/0/nonsense")
    assert [text.partition(" of ROS 2 is left out")[0] for text in world.far.warnings] == [
        "node '/a b'",
        "topic '/no//topic'",
        "a token",
    ]
    assert list(world.far.nodes) == [TALKER.key]


def test_a_refused_session_is_forgotten_and_stays_away(world: World) -> None:
    other = TALKER._replace(session="cd")
    for said in (TALKER, other):
        world.graph.came(node(said))
        world.graph.came(endpoint(said=said))
    world.graph.refuse(announcer_of(ZID))
    world.graph.forget_refused()
    world.graph.came(endpoint(topic="/late", number=9))
    assert list(world.far.nodes) == [other.key]
    assert {one.node for one in world.far.endpoints.values()} == {other.key}


def test_too_many_tokens_cost_the_session_with_most(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_TOKENS", 10)
    monkeypatch.setattr(module, "_FEW_TOKENS", 3)
    calm = TALKER._replace(session="cd", name="calm")
    world.graph.came(node(calm))
    for number in range(30):
        world.graph.came(endpoint(topic=f"/t{number}", number=number))
    world.graph.came(endpoint(topic="/fine", said=calm))
    assert list(world.graph.refused) == [ZID]
    assert [one.topic for one in world.far.endpoints.values()] == ["/fine"]
    assert world.far.warnings == [f"session {ZID} is refused: of 10 tokens it has announced 9"]


def test_tokens_of_many_sessions_don_t_cost_one_that_was_there(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sessions are names in tokens: one program can announce any number of them."""
    monkeypatch.setattr(module, "MOST_TOKENS", 10)
    world.graph.came(node())
    world.graph.came(endpoint())
    others = [node(TALKER._replace(session=f"{number:x}", name="x")) for number in range(1, 30)]
    for one in others:
        world.graph.came(one)
    assert (world.graph.sessions, len(world.far.nodes), [*world.graph.refused]) == (9, 9, [])
    assert TALKER.key in world.far.nodes
    assert world.far.warnings == [
        "10 tokens of 9 sessions of ROS 2 are there, which is the limit: nodes and endpoints that come now "
        "are left out until they are created again"
    ]
    for one in others[:7]:
        world.graph.gone(one)
    monkeypatch.setattr(module, "_FEW_TOKENS", 8)
    for number in range(10, 20):
        world.graph.came(endpoint(number=number))
    assert [*world.graph.refused] == [ZID]  # with room, its share has grown


def test_tokens_that_are_forgotten_may_come_again(world: World) -> None:
    kind = ServiceKind("/trigger", TRIGGER.type_name, TRIGGER.type_hash)
    keys = [
        node(),
        endpoint(),
        endpoint("SS", *kind, number=3),
        endpoint(type_name="no_msgs/msg/No", number=4),
    ]
    for key in keys:
        world.graph.came(key)
    before = {**world.far.nodes}, {**world.far.endpoints}
    world.graph.clear()
    assert (world.far.nodes, world.far.endpoints, world.graph.sessions) == ({}, {}, 0)
    assert not world.graph.servers_of(kind)
    for key in keys:
        world.graph.came(key)
    assert (world.far.nodes, world.far.endpoints) == before


def test_endpoints_of_unknown_types_are_limited(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_UNKNOWN", 2)
    keys = [
        endpoint(topic=f"/t{number}", type_name="nowhere_msgs/msg/Thing", number=number)
        for number in range(4)
    ]
    for key in keys:
        world.graph.came(key)
    assert [*world.graph._unknown] == keys[:2]
    assert world.far.warnings[2:] == 2 * [TOO_MANY_UNKNOWN]
    for key in keys:
        world.graph.gone(key)
    assert not world.graph._unknown
    assert not world.far.nodes


def test_no_token_has_the_gid_of_another_one_s_subscription(world: World) -> None:
    key = endpoint("SS", "/trigger", TRIGGER.type_name, TRIGGER.type_hash)
    for end in ("", "/in", "/in/in"):
        world.graph.came(key + end)
    world.graph.came(f"{key}//in")
    assert len(world.far.endpoints) == 6


def test_servers_with_the_same_gid(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    """The hash is no secret, so a hostile program can find such tokens."""
    far: Any = Anything()
    world.graph._far = far
    monkeypatch.setattr(module, "gid_of", lambda key: bytes(16))
    kind = ServiceKind("/trigger", TRIGGER.type_name, TRIGGER.type_hash)
    keys = [endpoint("SS", *kind, number=number) for number in range(2)]
    for key in keys:
        world.graph.came(key)
    for key in keys:
        world.graph.gone(key)
    assert world.graph.sessions == 0
    assert not world.graph.servers_of(kind)


class Anything(Far):
    """As the bridge, which ignores news about gids that it does not know."""

    def endpoint_added(self, endpoint: FarEndpoint) -> None: ...
    def endpoint_removed(self, gid: bytes, node: str) -> None: ...


def test_only_some_refusals_are_remembered(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MOST_REFUSED", 2)
    for session in ("a1", "a2", "a3"):
        world.graph.refuse(announcer_of(session))
    assert list(world.graph.refused) == ["a2", "a3"]
