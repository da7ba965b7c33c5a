"""The basis of the bridges' tests: machines with cables, and peers other than busd."""

import subprocess
import sys
from collections.abc import Iterator

import pytest

import netns
from netns import Machines
from peers import peer
from peers.peer import Peer

_STRING = {"type_name": "std_msgs/msg/String"}


@pytest.fixture
def machines() -> Iterator[Machines]:
    if reason := netns.why_not():
        pytest.skip(reason)
    with Machines("robot", "laptop") as machines:
        yield machines


@pytest.mark.nightly
def test_what_is_pulled_or_down_lets_nothing_through_and_comes_back(machines: Machines) -> None:
    cable = machines.connect("robot", "laptop")
    endpoint = f"tcp/{cable.address_of('robot')}:7447"
    with peer.zenoh(machines["robot"], "listen", endpoint) as talker:
        talker.ask("publish", topic="chatter")
        with peer.zenoh(machines["laptop"], "connect", endpoint) as listener:
            listener.ask("listen", topic="chatter")
            talker.wait_for("matched", lambda found: found[0] == 1, topic="chatter")
            talker.ask("send", topic="chatter", data="one")
            assert listener.wait("chatter")[0]["data"] == "one"
            with cable.pulled():
                talker.ask("send", topic="chatter", data="two")
                assert _ping(machines, cable) != 0 and len(listener.heard["chatter"]) == 1
            with cable.down():
                assert _ping(machines, cable) != 0
            assert listener.wait("chatter", 2)[1]["data"] == "two"  # TCP sends it again


def _ping(machines: Machines, cable: netns.Cable) -> int:
    code = f"import socket; socket.create_connection(('{cable.address_of('laptop')}', 9), 0.2)"
    done = subprocess.run(
        [*machines["robot"].prefix, sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    return 0 if "refused" in done.stderr else 1


def test_machines_without_a_cable_are_apart(machines: Machines) -> None:
    assert machines["robot"].run("ip", "-brief", "link").split()[0] == "lo"
    with (
        peer.ros("jazzy", "talker", machines["robot"]) as one,
        peer.ros("jazzy", "other", machines["laptop"]),
    ):
        assert one.ask("nodes") == ["/talker"]


def test_jazzy_and_kilted_find_and_hear_each_other(machines: Machines) -> None:
    with (
        peer.ros("jazzy", "talker", machines["robot"], namespace="/one") as talker,
        peer.ros("kilted", "listener", machines["robot"]) as listener,
    ):
        _exchange(talker, listener)
        assert listener.wait_for("nodes", lambda found: len(found) == 2) == ["/listener", "/one/talker"]
        assert listener.ask("topics")["/chatter"] == ["std_msgs/msg/String"]
        found = {one["kind"]: one["node"] for one in talker.ask("info", topic="/chatter")}
        assert found == {"publisher": "/one/talker", "subscription": "/listener"}
        talker.ask("publish", topic="/image", type_name="sensor_msgs/msg/Image")
        listener.ask("listen", topic="/image", type_name="sensor_msgs/msg/Image")
        talker.wait_for("matched", lambda found: found[0] == 1, topic="/image")
        listener.wait_for("matched", lambda found: found[1] == 1, topic="/image")
        talker.ask("send", topic="/image", width=100, header={"frame_id": "eye"}, data={"size": 30_000})
        (image,) = listener.wait("/image")
        assert (
            image["width"] == 100 and image["header"]["frame_id"] == "eye" and image["data"]["size"] == 30_000
        )


@pytest.mark.nightly
@pytest.mark.parametrize("distro", ["jazzy", "kilted"])
def test_cyclonedds_and_ros_hear_each_other(machines: Machines, distro: peer.Distro) -> None:
    with peer.ros(distro, "node", machines["robot"]) as node, peer.cyclone(machines["robot"]) as alone:
        _exchange(node, alone)
        _exchange(alone, node, topic="/back")


def _exchange(talker: Peer, listener: Peer, topic: str = "/chatter") -> None:
    durable = {"durability": "transient_local", "depth": 1}
    talker.ask("publish", topic=topic, **_STRING, **durable)
    talker.ask("send", topic=topic, data="earlier")
    talker.ask("send", topic=topic, data="kept")
    listener.ask("listen", topic=topic, **_STRING, **durable)
    assert [one["data"] for one in listener.wait(topic)] == ["kept"]
    talker.ask("send", topic=topic, data="new")
    assert [one["data"] for one in listener.wait(topic, 2)] == ["kept", "new"]
    assert listener.source_times_ns[topic] == sorted(listener.source_times_ns[topic])


def test_an_order_that_fails_is_shown(machines: Machines) -> None:
    with (
        peer.zenoh(machines["robot"], "listen", "tcp/127.0.0.1:7447") as one,
        pytest.raises(pytest.fail.Exception, match="send: KeyError: 'nowhere'"),
    ):
        one.ask("send", topic="nowhere", data="")
