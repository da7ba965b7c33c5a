"""bus_bridge.program: errors in a user's options are reported before the bridge starts anything."""

from importlib.util import find_spec

import pytest

from bus.errors import BusError
from bus_bridge import extras
from bus_bridge.core.rules import TopicRule
from bus_bridge.options import BridgeTable, Ros2Table, TlsTable, ZenohTable
from bus_bridge.program import Plan, node_name
from rows import for_each

needs_zenoh = pytest.mark.skipif(find_spec("zenoh") is None, reason="needs eclipse-zenoh")
needs_rmw_zenoh = pytest.mark.skipif(
    not all(map(find_spec, ("zenoh", "xxhash"))), reason="needs eclipse-zenoh and xxhash"
)
needs_cyclonedds = pytest.mark.skipif(find_spec("cyclonedds") is None, reason="needs cyclonedds")
PLACE = ("tcp/127.0.0.1:7447",)


@needs_zenoh
@for_each(
    ("table", "said"),
    [
        (ZenohTable(listen=PLACE, allow=("topic",)), "allow = 'topic' can never match"),
        (ZenohTable(listen=PLACE, deny=("/a//b",)), "deny = '/a//b' can never match"),
        (
            ZenohTable(listen=PLACE, topics=(TopicRule(pattern="x"),)),
            "bridge.zenoh.topics.pattern = 'x' can never match",
        ),
        (ZenohTable(listen=PLACE, namespace="a b"), "Invalid namespace"),
        (ZenohTable(listen=PLACE, id="a b"), "the id of a bus has letters"),
        (ZenohTable(listen=("7447",)), "must begin with tls/, quic/ or tcp/"),
        (ZenohTable(listen=("tcp/0.0.0.0:7447",)), "is not protected"),
        (
            ZenohTable(connect=("tls/robot:7447",), tls=TlsTable(ca="ca.pem")),
            "--certificate FILE, --key FILE are missing",
        ),
    ],
)
def test_what_can_t_be(table: BridgeTable, said: str) -> None:
    with pytest.raises(BusError) as caught:
        Plan("zenoh", table)
    assert said in str(caught.value)


@needs_cyclonedds
@for_each(
    ("table", "said"),
    [
        (Ros2Table(peers=("10.0.0.7",)), "10.0.0.7 can't be reached over the loopback interface"),
        (Ros2Table(interface="a b"), "'a b' is not the name or address of a network interface"),
    ],
)
def test_what_can_t_be_of_dds(table: BridgeTable, said: str) -> None:
    with pytest.raises(BusError) as caught:
        Plan("ros2", table)
    assert said in str(caught.value)


@needs_rmw_zenoh
@for_each(
    ("table", "said"),
    [
        (Ros2Table(connect=PLACE), "'connect' is an option of ROS 2 on zenoh: --rmw zenoh"),
        (
            Ros2Table(rmw="dds", tls=TlsTable(ca="ca.pem")),
            "'tls' is an option of ROS 2 on zenoh: --rmw zenoh",
        ),
        (Ros2Table(rmw="zenoh", interface="eth0"), "'interface' is an option of ROS 2 on dds: --rmw dds"),
        (Ros2Table(rmw="zenoh", connect=("tcp/10.0.0.2:7447",)), "is not protected"),
        (
            Ros2Table(rmw="zenoh", connect=PLACE, router=PLACE),
            "--router and --connect can't be given together",
        ),
    ],
)
def test_what_can_t_be_of_ros_2_on_zenoh(table: BridgeTable, said: str) -> None:
    with pytest.raises(BusError) as caught:
        Plan("ros2", table)
    assert said in str(caught.value)


def test_packages_that_ros_2_on_zenoh_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    with pytest.raises(
        BusError, match="a bridge to ROS 2 on zenoh needs eclipse-zenoh and xxhash: pip install"
    ):
        Plan("ros2", Ros2Table(rmw="zenoh"))


@needs_zenoh
def test_what_can_be() -> None:
    Plan("zenoh", ZenohTable(listen=PLACE, namespace="bot1", id="robot", allow=("/camera/**",)))
    Plan("zenoh", ZenohTable(connect=("tcp/10.0.0.2:7447",), insecure=True))


@for_each(
    ("engine", "table", "name"),
    [
        ("zenoh", ZenohTable(), "bridge_zenoh"),
        ("ros2", Ros2Table(), "bridge_ros2_7"),
        ("ros2", Ros2Table(domain_id=0), "bridge_ros2"),
        ("ros2", Ros2Table(domain_id=5, rmw="dds"), "bridge_ros2_5"),
        ("ros2", Ros2Table(domain_id=5, rmw="zenoh"), "bridge_rmw_zenoh_5"),
    ],
)
def test_each_domain_and_middleware_of_ros_2_has_its_own_node(
    engine: str, table: BridgeTable, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    assert node_name(engine, table) == name
