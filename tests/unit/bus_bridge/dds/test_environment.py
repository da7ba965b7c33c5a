"""ROS 2's variables for discovery, and their effect on a bridge."""

import pytest

from bus_bridge.dds.environment import Told, apply, read
from bus_bridge.dds.options import DdsOptions
from bus_bridge.errors import BridgeError
from rows import for_each

LOCAL, ETH = DdsOptions(0), DdsOptions(0, "eth0", ("10.0.0.7",))
_RANGE, _PEERS = "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_STATIC_PEERS"
_SERVERS = "ROS_DISCOVERY_SERVER"


@for_each(
    ("environment", "told"),
    [
        ({}, Told()),
        ({_RANGE: "", _PEERS: ""}, Told()),
        ({_RANGE: "OFF"}, Told("OFF")),
        ({_RANGE: "LOCALHOST"}, Told("LOCALHOST")),
        ({_RANGE: "SUBNET"}, Told("SUBNET")),
        (
            {_RANGE: "SYSTEM_DEFAULT", _PEERS: "10.0.0.2;robot.local;"},
            Told("SYSTEM_DEFAULT", ("10.0.0.2", "robot.local")),
        ),
        ({_SERVERS: ";10.0.0.2:11811;robot.local"}, Told(servers=("10.0.0.2:11811", "robot.local"))),
    ],
)
def test_read(environment: dict[str, str], told: Told) -> None:
    assert read(environment) == told


@for_each(
    ("environment", "text"),
    [
        (
            {_RANGE: "localhost"},
            f"{_RANGE} must be one of OFF, LOCALHOST, SUBNET, SYSTEM_DEFAULT, not 'localhost'",
        ),
        (
            {_PEERS: "10.0.0.2, 10.0.0.3"},
            f"{_PEERS}: '10.0.0.2, 10.0.0.3' is not the address of a machine; addresses are separated by "
            "semicolons, as in '10.0.0.2;robot.local'",
        ),
        (
            {_SERVERS: "10.0.0.2:x"},
            f"{_SERVERS}: '10.0.0.2:x' is not the address of a Discovery Server over UDP and IPv4, as in "
            "'10.0.0.2:11811'; addresses are separated by semicolons, as in '10.0.0.2:11811;10.0.0.3:11811'",
        ),
    ],
)
def test_wrong_values(environment: dict[str, str], text: str) -> None:
    with pytest.raises(BridgeError) as caught:
        read(environment)
    assert str(caught.value) == text


@for_each(
    ("options", "told", "discovery", "peers", "lines"),
    [
        (LOCAL, Told(), "SUBNET", (), []),
        (ETH, Told(), "SUBNET", ("10.0.0.7",), []),
        (ETH, Told("SUBNET", ("10.0.0.2",)), "SUBNET", ("10.0.0.7", "10.0.0.2"), []),
        (LOCAL, Told("SUBNET"), "SUBNET", (), ["without --interface the bridge reaches this machine only"]),
        (LOCAL, Told("LOCALHOST", ("localhost",)), "LOCALHOST", ("localhost",), []),
        (
            LOCAL,
            Told("LOCALHOST", ("10.0.0.2", "127.0.0.1")),
            "LOCALHOST",
            ("127.0.0.1",),
            ["ROS_STATIC_PEERS has 10.0.0.2, which the bridge can't reach without --interface"],
        ),
        (ETH, Told("LOCALHOST", ("10.0.0.7",)), "LOCALHOST", ("10.0.0.7",), ["no multicast"]),
        (
            ETH,
            Told("OFF", ("10.0.0.2",)),
            "OFF",
            ("10.0.0.7",),
            ["finds no node of ROS 2", "is OFF: ROS_STATIC_PEERS has no effect"],
        ),
        (
            ETH,
            Told("SYSTEM_DEFAULT", ("10.0.0.2",)),
            "SYSTEM_DEFAULT",
            ("10.0.0.7",),
            ["is SYSTEM_DEFAULT: ROS_STATIC_PEERS has no effect"],
        ),
    ],
)
def test_effect(
    options: DdsOptions, told: Told, discovery: str, peers: tuple[str, ...], lines: list[str]
) -> None:
    made, said = apply(options, told)
    assert (made.discovery, made.peers) == (discovery, peers)
    assert len(said) == len(lines) and all(part in line for part, line in zip(lines, said, strict=True)), said
    made.check()


@for_each(
    ("options", "told", "servers", "peers", "lines"),
    [
        (LOCAL, Told(servers=("127.0.0.1",)), ("127.0.0.1",), (), ["by Discovery Servers: 127.0.0.1"]),
        (
            DdsOptions(0, "eth0", ("10.0.0.7",), servers=("10.0.0.8",)),
            Told("LOCALHOST", ("10.0.0.2",), ("10.0.0.9:1", "10.0.0.8")),
            ("10.0.0.8", "10.0.0.9:1"),
            (),
            ["10.0.0.8, 10.0.0.9:1", "--peer has no effect", "ROS_STATIC_PEERS has no effect"],
        ),
        (
            ETH,
            Told("OFF", servers=("10.0.0.9",)),
            (),
            ("10.0.0.7",),
            ["finds no node of ROS 2", "is OFF: a Discovery Server has no effect"],
        ),
        (LOCAL, Told("OFF", servers=("10.0.0.9",)), (), (), ["finds no node", "a Discovery Server has no"]),
    ],
)
def test_discovery_servers(
    options: DdsOptions, told: Told, servers: tuple[str, ...], peers: tuple[str, ...], lines: list[str]
) -> None:
    made, said = apply(options, told)
    assert (made.servers, made.peers) == (servers, peers)
    assert len(said) == len(lines) and all(part in line for part, line in zip(lines, said, strict=True)), said
    made.check()


def test_a_discovery_server_out_of_reach() -> None:
    with pytest.raises(BridgeError) as caught:
        apply(LOCAL, Told(servers=("127.0.0.1", "10.0.0.9:11811")))
    assert str(caught.value) == (
        "ROS_DISCOVERY_SERVER has 10.0.0.9, which the bridge can't reach without --interface"
    )
