import pytest

from bus_bridge.dds.options import DdsOptions, parse_server
from bus_bridge.errors import BridgeError
from rows import for_each


@for_each(
    "options, text",
    [
        (DdsOptions(233), "the DDS domain must be from 0 to 232, not 233"),
        (DdsOptions(-1), "not -1"),
        (DdsOptions(interface="eth0'/>"), "'eth0'/>' is not the name or address"),
        (DdsOptions(peers=("10.0.0.1",)), "10.0.0.1 can't be reached over the loopback interface"),
        (DdsOptions(interface="lo", peers=("robot",)), "--interface eth0"),
        (DdsOptions(interface="eth0", peers=("a b",)), "'a b' is not the address of a machine"),
        (DdsOptions(interface="eth0", peers=("robot..local",)), "'robot..local' is not the address"),
        (DdsOptions(interface="eth0", peers=("r" * 64,)), "rrr' is not the address of a machine"),
        (DdsOptions(servers=("10.0.0.1",)), "10.0.0.1 can't be reached over the loopback interface"),
        (
            DdsOptions(servers=("127.0.0.1:65536",)),
            "'127.0.0.1:65536' is not the address of a Discovery Server",
        ),
        (DdsOptions(servers=("127.0.0.1:",)), "'127.0.0.1:' is not"),
        (DdsOptions(servers=(":11811",)), "':11811' is not"),
        (DdsOptions(servers=("robot..local",)), "'robot..local' is not"),
        (DdsOptions(servers=("TCPv4:[127.0.0.1]:42100",)), "over UDP and IPv4, as in '10.0.0.2:11811'"),
        (DdsOptions(servers=("127.0.0.1",), carrier="cyclonedds"), "needs --carrier rtps"),
        (DdsOptions(distro="dashing"), "auto or humble, not 'dashing'"),  # type: ignore[arg-type]
    ],
)
def test_what_can_not_be(options: DdsOptions, text: str) -> None:
    with pytest.raises(BridgeError, match=text):
        options.check()


@for_each(
    "options",
    [
        DdsOptions(),
        DdsOptions(232, "eth0", ("10.0.0.1", "robot.local")),
        DdsOptions(0, "127.0.0.1", ("127.0.0.1", "localhost")),
        DdsOptions(servers=("127.0.0.1", "localhost:11888")),
        DdsOptions(servers=("127.0.0.1",), distro="humble"),
        DdsOptions(distro="humble", carrier="rtps"),
        DdsOptions(interface="eth0", servers=("robot.local:1",)),
        DdsOptions(interface="fd00::2", distro="humble"),
        DdsOptions(interface="eth0", peers=("robot.local.", "r" * 63, "fd00::2", "::ffff:10.0.0.2")),
    ],
)
def test_what_can_be(options: DdsOptions) -> None:
    options.check()


@for_each(
    ("interface", "is_local"),
    [("", True), ("lo", True), ("127.0.0.1", True), ("::1", True), ("eth0", False), ("10.0.0.2", False)],
)
def test_it_is_this_machine_alone_if_no_interface_is_named(interface: str, is_local: bool) -> None:
    assert DdsOptions(interface=interface).is_local == is_local


def test_the_port_of_a_discovery_server() -> None:
    assert parse_server("robot.local") == ("robot.local", 11811)
    assert parse_server("10.0.0.2:11888") == ("10.0.0.2", 11888)
    assert DdsOptions(servers=("127.0.0.1",)).carrier_used == "rtps"


def test_the_domain_is_that_of_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    assert DdsOptions().domain == 42
    assert DdsOptions(7).domain == 7
    monkeypatch.setenv("ROS_DOMAIN_ID", "x")
    with pytest.raises(BridgeError, match="ROS_DOMAIN_ID must be a number from 0 to 232, not 'x'"):
        DdsOptions().check()
    monkeypatch.delenv("ROS_DOMAIN_ID")
    assert DdsOptions().domain == 0
