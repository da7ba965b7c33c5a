"""Key expressions of tokens and routes: each can be read again, and the bridge ignores hostile ones."""

from hypothesis import given
from hypothesis import strategies as st

from bus.qos import QoSProfile
from bus_bridge.engine import FarEndpoint, FarNode, LocalEndpoint, LocalNode
from bus_bridge.zenoh import keys
from bus_bridge.zenoh.keys import Broken, BusToken, EndpointToken, InterestToken, NodeToken, OtherVersion
from rows import for_each

GID = bytes(range(16))
_ids = st.text(st.characters(categories=["L", "N", "P", "S"]), min_size=1, max_size=20)


@given(_ids, _ids, st.lists(_ids, max_size=3).map(tuple))
def test_a_node_is_read_as_it_was_shown(bus: str, name: str, via: tuple[str, ...]) -> None:
    key = keys.node_token(bus, "17", LocalNode(4, name, "/deep/er", via))
    assert not set("*$?#") & set(key)
    assert "" not in key.split("/")
    node = FarNode(keys.node_key(bus, "17", "4"), bus, name, "/deep/er", via)
    assert keys.parse_token(key) == NodeToken(bus, "17", node)


def test_an_endpoint_is_read_as_it_was_shown() -> None:
    qos = QoSProfile(3, durability="transient_local")
    for kind in ("publisher", "subscription"):
        local = LocalEndpoint(kind, GID, LocalNode(4, "n", "/"), "/a/b", "p/msg/T", "RIHS01_ab", qos)  # type: ignore[arg-type]
        token = keys.parse_token(keys.endpoint_token("robot", "17", local))
        far = FarEndpoint(kind, GID, keys.node_key("robot", "17", "4"), "/a/b", "p/msg/T", "RIHS01_ab", qos)  # type: ignore[arg-type]
        assert token == EndpointToken("robot", "17", far)


def test_a_bus_and_an_interest_are_read_as_they_were_shown() -> None:
    assert keys.parse_token(keys.bus_token("a/b", "17", "f00")) == BusToken("a/b", "17", "f00")
    token = keys.interest_token("laptop", "18", "ro*bot", GID)
    assert keys.parse_token(token) == InterestToken("laptop", "18", "ro*bot", GID)
    assert keys.token_bus(token) == "laptop"


def test_another_version_is_named() -> None:
    assert keys.parse_token("@busd/1/robot/B/1/2") == OtherVersion("robot", "1")


@for_each(
    ("key", "why"),
    [
        ("@busd/3/robot", "is too short"),
        ("x/1/robot/B/1/2", "is too short"),
        ("@busd/3/robot/B/1", "wrong number of parts"),
        ("@busd/3/robot/Z/1/2", "wrong number of parts"),
        ("@busd/3/robot/I/1/x/abc", "gid of 3 digits"),
        (f"@busd/3/robot/I/1/x/{'g' * 32}", "non-hexadecimal"),
        ("@busd/3/robot/N/1/4/na%00me/%2F/,", "can't be printed"),
        ("@busd/3/robot/N/1/4/na%FFme/%2F/,", "invalid start byte"),
        (f"@busd/3/robot/I/1/x/{GID.hex().upper()}", "a gid with wrong digits"),
        (f"@busd/3/robot/I/1/x/{'00 ' * 10}00", "a gid with wrong digits"),
        (f"@busd/3/robot/I/1/%78/{GID.hex()}", "a part with a wrong encoding"),
        ("@busd/3/%72obot/B/1/z", "a part with a wrong encoding"),
        ("@busd/3/robot/N/1/4/name/%2F/x", "invalid list of buses on the way"),
        ("@busd/3/robot/N/1/4/name/%2F/" + ",x" * 65, "invalid list of buses on the way"),
        (f"@busd/3/robot/P/1/4/{GID.hex()}/%2Fa/T/h/rk0v", "QoS"),
        ("@busd/3/robot/N/1/4/" + "x" * 3000 + "/%2F/,", "longer than"),
    ],
)
def test_what_can_t_be_read_names_its_bus(key: str, why: str) -> None:
    found = keys.parse_token(key)
    assert isinstance(found, Broken)
    assert why in found.reason
    assert found.bus == ("robot" if key.count("/") > 2 else "")
    assert len(found.reason) < 300


@given(st.text(max_size=60).map(lambda text: "@busd/3/" + text))
def test_nothing_hostile_raises(key: str) -> None:
    keys.parse_token(key)
    keys.parse_importer(key)
    keys.parse_type(key)


def test_routes_have_one_key_for_each_publisher() -> None:
    key = keys.data_key("/a/b", "p/msg/T", "RIHS01_ab", "ro/bot", GID)
    assert key == f"busd/3/data/a/b/p/msg/T/RIHS01_ab/ro%2Fbot/{GID.hex()}"
    assert keys.parse_importer(keys.kept_key("robot", GID, "lap/top")) == (GID, "lap/top")
    assert keys.parse_importer(keys.ack_key("robot", GID, "laptop")) == (GID, "laptop")
    for one, those in ((keys.kept_key, keys.kept_keys), (keys.ack_key, keys.ack_keys)):
        assert one("robot", GID, "laptop").startswith(those("robot").removesuffix("*/*"))
    assert keys.parse_importer("busd/3/ack/robot/xy/laptop") is None
    assert keys.parse_type(keys.type_key("robot", "p/msg/T", "RIHS01_ab")) == ("p/msg/T", "RIHS01_ab")
