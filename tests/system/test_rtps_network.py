"""Our own RTPS between two machines: with ROS 2's rclpy by multicast, and while a cable is out."""

import sys
import threading
from collections.abc import Iterator

import pytest

import netns
from netns import Cable, Machines
from peers import peer
from peers.peer import PROGRAMS, Peer

LIST = "rcl_interfaces/srv/ListParameters"
REQUEST = (b"\0\1\0\0" + bytes(16)).hex()
DOMAIN = 3


@pytest.fixture
def machines() -> Iterator[Machines]:
    if reason := netns.why_not():
        pytest.skip(reason)
    with Machines("robot", "laptop") as machines:
        yield machines


def services(machines: Machines, cable: Cable, name: str) -> Peer:
    command = (sys.executable, str(PROGRAMS / "services.py"), str(DOMAIN), cable.address_of(name))
    return Peer(command, None, machines[name])


@peer.each_distro
def test_rclpy_on_another_machine(machines: Machines, distro: peer.Distro) -> None:
    cable = machines.connect("robot", "laptop")
    with (
        services(machines, cable, "laptop") as ours,
        peer.ros(distro, "ros_node", machines["robot"], domain=DOMAIN, reach="SUBNET") as ros,
    ):
        theirs = "/ros_node/list_parameters"
        ours.wait_for("ready", lambda found: found, service=theirs, type_name=LIST)
        (answer,) = ours.ask("call", service=theirs, request=REQUEST)
        assert b"use_sim_time" in bytes.fromhex(answer)
        ours.ask("offer", service="/ours", type_name=LIST)
        # An answer of 16 zero bytes: two empty lists.
        empty: dict[str, dict[str, list[str]]] = {"result": {"names": [], "prefixes": []}}
        assert ros.ask("call", service="/ours", type_name=LIST) == [empty]
        assert ours.ask("warnings") == []


def test_calls_while_the_cable_is_out(machines: Machines) -> None:
    cable = machines.connect("robot", "laptop")
    with services(machines, cable, "laptop") as server, services(machines, cable, "robot") as client:
        server.ask("offer", service="/s", type_name=LIST)
        client.wait_for("ready", lambda found: found, service="/s", type_name=LIST)
        long = (b"\0\1\0\0" + bytes(20_000)).hex()
        found: list[str] = []
        with cable.pulled():
            thread = threading.Thread(
                target=lambda: found.extend(client.ask("call", service="/s", request=long, count=30))
            )
            thread.start()
            thread.join(0.5)  # long enough for requests to be lost, and sent again
            assert thread.is_alive()
        thread.join()
        assert found == 30 * [long]
        assert client.ask("call", service="/s", request=REQUEST) == [REQUEST]
