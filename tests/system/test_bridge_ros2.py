"""`bus bridge ros2`: a bus with nodes of ROS 2's rclpy, Jazzy and Kilted, and with plain cyclonedds."""

import asyncio
import contextlib
from collections import defaultdict
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any
from zlib import crc32

import msgspec
import pytest

import bus
import netns
from bridged_world import World, on_one_loop, until
from bus.msg.geometry_msgs import Twist, Vector3
from bus.msg.sensor_msgs import Image
from bus.msg.std_msgs import Header, String
from conftest import WAIT_S
from forks import Forks
from peers import peer
from peers.peer import Peer
from ros2_bridged import ask, join

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed: make setup installs it")

LATCHED = bus.QoSProfile(1, durability="transient_local")
_LATCHED = {"durability": "transient_local", "depth": 1}
DISTROS = [pytest.param("jazzy", id="jazzy"), pytest.param("kilted", id="kilted", marks=pytest.mark.nightly)]
_PIXELS = bytes(number % 251 for number in range(3 * 64 * 48))
MESSAGES: tuple[tuple[Any, dict[str, Any]], ...] = (
    (String(data="häßlich ∞"), {"data": "häßlich ∞"}),
    (
        Twist(linear=Vector3(x=0.1, y=-2.5), angular=Vector3(z=1e300)),
        {"linear": {"x": 0.1, "y": -2.5}, "angular": {"z": 1e300}},
    ),
    (
        Image(header=Header(frame_id="eye"), width=64, height=48, encoding="rgb8", data=_PIXELS),
        {
            "header": {"frame_id": "eye"},
            "width": 64,
            "height": 48,
            "encoding": "rgb8",
            "data": {"size": len(_PIXELS)},
        },
    ),
)
"""Messages as this bus has them, and as the orders to a peer have them."""


def values_of(value: Any) -> Any:
    """A message in the form in which a peer reports it."""
    if isinstance(value, msgspec.Struct):
        return {name: values_of(getattr(value, name)) for name in value.__struct_fields__}
    return {"size": len(value), "crc": crc32(value)} if isinstance(value, bytes) else value


@pytest.fixture(params=["cyclonedds", "rtps"])
def world(
    request: pytest.FixtureRequest, tmp_path: Path, forks: Forks, monkeypatch: pytest.MonkeyPatch
) -> Iterator[World]:
    monkeypatch.setenv("BUSD_AUTOSTART", "0")
    with World(tmp_path, forks, "robot") as world:
        world.carrier = request.param
        yield world


def node_of(world: World, distro: peer.Distro, name: str = "ros_node", namespace: str = "") -> Peer:
    return peer.ros(distro, name, world["robot"].machine, namespace=namespace, domain=world.domain)


async def answers(one: Peer, order: str, fits: Any, **arguments: Any) -> Any:
    """The first answer that fits."""
    return await asyncio.to_thread(one.wait_for, order, fits, **arguments)


# --- the graph


@pytest.mark.parametrize("distro", DISTROS)
@on_one_loop
async def test_each_lists_the_nodes_and_topics_of_the_other(world: World, distro: peer.Distro) -> None:
    side, bridge = join(world)
    with node_of(world, distro, namespace="/ros") as ros:
        async with side.node("busd_node", namespace="/robot") as node:
            publisher = await node.create_publisher(Twist, "cmd_vel", bus.QoSProfile(5))
            await node.create_subscription(String, "/ros/chatter", 10, lambda message: None)
            await ask(ros, "publish", topic="chatter", type_name="std_msgs/msg/String", depth=7)
            await ask(ros, "listen", topic="/robot/cmd_vel", type_name="geometry_msgs/msg/Twist")
            both = ["/robot/busd_node", "/ros/ros_node"]
            assert await answers(ros, "nodes", lambda found: {*both} <= {*found})
            assert not [name for name in await ask(ros, "nodes") if name.startswith("/bridge")]
            topics = await answers(ros, "topics", lambda found: "/robot/cmd_vel" in found)
            assert {*topics["/robot/cmd_vel"]} == {"geometry_msgs/msg/Twist"}
            published, heard = await answers(
                ros, "of_node", lambda found: all(found), name="busd_node", namespace="/robot"
            )
            assert "/robot/cmd_vel" in published and "/ros/chatter" in heard
            found = await answers(ros, "info", lambda found: len(found) == 2, topic="/robot/cmd_vel")
            (shown,) = [one for one in found if one["kind"] == "publisher"]
            assert shown["reliability"] == "reliable" and shown["durability"] == "volatile"
            if distro == "jazzy":  # Kilted can't tell the node of another vendor's endpoint
                assert shown["node"] == "/robot/busd_node"
            await until(lambda: publisher.get_subscription_count() == 1)

            graph = await side.shows(lambda graph: graph.publishers_of("/ros/chatter"))
            (mirror,) = graph.publishers_of("/ros/chatter")
            assert mirror.qos.reliability == "reliable" and "/ros/ros_node" in side.names()
            out = (await asyncio.to_thread(side.bus, "topic", "info", "-v", "/ros/chatter")).out
            assert "ros_node" in out and "std_msgs/msg/String" in out
        await answers(ros, "nodes", lambda found: found == ["/ros/ros_node"])
        bridge.end()
        await until(lambda: not side.names())


@pytest.mark.parametrize("distro", DISTROS)
@on_one_loop
async def test_a_node_as_ros_starts_it_is_found_on_loopback_whenever_it_comes(
    tmp_path: Path, forks: Forks, distro: peer.Distro
) -> None:
    """The node uses and announces the network of its machine, but not loopback."""
    if netns.why_not():
        pytest.skip(netns.why_not())
    with World(tmp_path, forks, "robot", "laptop") as world:
        world.lay("robot", "laptop")
        side, _ = join(world)
        for name in ("one", "again"):
            with peer.ros(distro, name, side.machine, domain=world.domain, reach="SUBNET"):
                await until(lambda name=name: f"/{name}" in side.names(), lambda: f"{side.names()}")
            await until(lambda name=name: f"/{name}" not in side.names(), lambda: f"{side.names()} left")


# --- messages


@pytest.mark.parametrize("distro", DISTROS)
@on_one_loop
async def test_string_twist_and_image_cross_both_ways(world: World, distro: peer.Distro) -> None:
    side, _ = join(world)
    with node_of(world, distro) as ros:
        async with side.node("busd_node") as node:
            heard: list[Any] = []
            infos: list[bus.MessageInfo] = []

            def hear(message: Any, info: bus.MessageInfo) -> None:
                heard.append(message)
                infos.append(info)

            for message, filled in MESSAGES:
                kind: type[Any] = type(message)
                type_name = f"{kind.__module__.split('.')[-1]}/msg/{kind.__name__}"
                there, back = f"/there_{kind.__name__}", f"/back_{kind.__name__}"
                await ask(ros, "listen", topic=there, type_name=type_name)
                await ask(ros, "publish", topic=back, type_name=type_name)
                publisher = await node.create_publisher(kind, there, 10)
                subscription = await node.create_subscription(kind, back, 10, hear)
                await publisher.wait_for_subscriptions()
                await subscription.wait_for_publishers()
                await answers(ros, "matched", lambda found: found[1] == 1, topic=there)
                await answers(ros, "matched", lambda found: found[0] == 1, topic=back)
                publisher.publish(message)
                (came,) = await asyncio.to_thread(ros.wait, there)
                assert came == values_of(message)
                await ask(ros, "send", topic=back, **filled)
                await until(lambda: heard)
                assert heard.pop() == message
                info = infos.pop()
                assert 0 < info.received_timestamp - info.source_timestamp < WAIT_S * 1e9
                assert info.publisher_gid == subscription.matches[0].gid


@pytest.mark.nightly
@pytest.mark.parametrize("distro", ["jazzy", "kilted"])
@on_one_loop
async def test_no_large_image_is_lost(world: World, distro: peer.Distro) -> None:
    """The socket of a node of ROS 2 has the kernel's default buffer, which is smaller than an image."""
    side, bridge = join(world)
    with node_of(world, distro) as ros:
        async with side.node("busd_node") as node:
            await ask(ros, "listen", topic="/image", type_name="sensor_msgs/msg/Image", depth=30)
            publisher = await node.create_publisher(Image, "/image", 30)
            await publisher.wait_for_subscriptions()
            await until(lambda: bridge.route("/image", "out")["is_flowing"])
            data = bytes(900_000)
            for number in range(90):
                publisher.publish(Image(width=number, data=data))
                # A busy machine may be slower than 30 Hz; the depth keeps all that are under way.
                await until(lambda number=number: len(ros.heard["/image"]) > number - 20)
                await asyncio.sleep(1 / 30)
            heard = await asyncio.to_thread(ros.wait, "/image", 90)
            assert [one["width"] for one in heard] == [*range(90)]


@pytest.mark.nightly
@pytest.mark.parametrize("distro", ["jazzy", "kilted"])
@on_one_loop
async def test_late_joiners_get_what_is_kept_both_ways(world: World, distro: peer.Distro) -> None:
    side, _ = join(world)
    with node_of(world, distro) as ros:
        async with side.node("busd_node") as node:
            publisher = await node.create_publisher(String, "/there", LATCHED)
            for text in ("earlier", "kept"):
                publisher.publish(String(data=text))
            await ask(ros, "publish", topic="/back", type_name="std_msgs/msg/String", **_LATCHED)
            for text in ("earlier", "kept"):
                await ask(ros, "send", topic="/back", data=text)
            await side.shows(lambda graph: graph.publishers_of("/back"))
            await answers(ros, "topics", lambda found: "/there" in found)
            await ask(ros, "listen", topic="/there", type_name="std_msgs/msg/String", **_LATCHED)
            assert [one["data"] for one in await asyncio.to_thread(ros.wait, "/there")] == ["kept"]
            heard: list[str] = []
            await node.create_subscription(
                String, "/back", LATCHED, lambda message: heard.append(message.data)
            )
            await until(lambda: heard)
            assert heard == ["kept"]


@pytest.mark.nightly
@on_one_loop
async def test_cyclonedds_alone_hears_and_is_heard(world: World) -> None:
    side, _ = join(world)
    with peer.cyclone(side.machine, domain=world.domain) as alone:
        async with side.node("busd_node") as node:
            heard: list[str] = []
            publisher = await node.create_publisher(String, "/there", LATCHED)
            await node.create_subscription(
                String, "/back", LATCHED, lambda message: heard.append(message.data)
            )
            publisher.publish(String(data="one"))
            await ask(alone, "listen", topic="/there", type_name="", **_LATCHED)
            await ask(alone, "publish", topic="/back", type_name="", **_LATCHED)
            await ask(alone, "send", topic="/back", data="two")
            assert [one["data"] for one in await asyncio.to_thread(alone.wait, "/there")] == ["one"]
            await until(lambda: heard == ["two"])


@on_one_loop
async def test_a_burst_to_the_first_that_matches_comes_whole(world: World) -> None:
    """It may arrive before the bridge has a route: the bridge matches before it shows the publisher."""
    side, bridge = join(world)
    with peer.cyclone(side.machine, domain=world.domain) as alone:
        async with side.node("busd_node") as node:
            heard: list[int] = []
            subscription = await node.create_subscription(
                String,
                "/back",
                bus.QoSProfile(history="keep_all"),
                lambda message: heard.append(int(message.data)),
            )
            await ask(alone, "burst", topic="/back", count=5000)
            await until(lambda: len(heard) >= 5000, lambda: f"{len(heard)} heard")
            assert heard == [*range(5000)]
            assert subscription.statistics().dropped == {}
            (route,) = [one for one in bridge.status()["routes"] if one["topic"] == "/back"]
            assert (route["taken"], route["sent"], route["dropped"]) == (5000, 5000, {})
            assert route["counts_lost"] is (world.carrier == "rtps")  # cyclonedds shows no numbers


@on_one_loop
async def test_in_transit_nothing_goes_back_to_where_it_came_from(world: World, tmp_path: Path) -> None:
    """Otherwise nodes of ROS 2 would receive each message twice: directly and through this bus."""
    config = tmp_path / "transit.toml"
    config.write_text('[[bridge.ros2.topics]]\npattern = "/**"\ntransit = true\n')
    side = world["robot"]
    side.bridge("ros2", "--domain-id", str(world.domain), "--config", str(config))
    with (
        peer.cyclone(side.machine, domain=world.domain) as talker,
        peer.cyclone(side.machine, domain=world.domain) as listener,
    ):
        async with side.node("busd_node") as node:
            await ask(listener, "listen", topic="/chatter", type_name="", **_LATCHED)
            await ask(talker, "publish", topic="/chatter", type_name="", **_LATCHED)
            subscription = await node.create_subscription(String, "/chatter", LATCHED)
            await subscription.wait_for_publishers()
            publisher = await node.create_publisher(String, "/chatter", LATCHED)
            await publisher.wait_for_subscriptions()
            await ask(talker, "send", topic="/chatter", data="one")
            assert (await subscription.receive())[0].data == "one"
            await asyncio.to_thread(listener.wait, "/chatter", 1)  # its depth is 1
            publisher.publish(String(data="two"))  # arrives after a returned "one", if there is one
            heard = await asyncio.to_thread(listener.wait, "/chatter", 2)
            assert [one["data"] for one in heard] == ["one", "two"]
            found = await answers(listener, "matched", lambda found: found[1] >= 2, topic="/chatter")
            assert found[1] == 2


# --- what goes wrong


@on_one_loop
async def test_messages_that_a_killed_bridge_missed_are_counted_if_they_have_numbers(world: World) -> None:
    """cyclonedds shows no numbers."""
    side, bridge = join(world)
    heard: list[int] = []
    numbers = count(1)
    with peer.cyclone(side.machine, domain=world.domain) as alone:

        async def send() -> int:
            number = next(numbers)
            await ask(alone, "send", topic="/back", data=str(number))
            return number

        async with side.node("busd_node") as node:
            await node.create_subscription(
                String, "/back", 1000, lambda message: heard.append(int(message.data))
            )
            await ask(alone, "publish", topic="/back", type_name="")
            while not heard:
                last = await send()
            # The bridge notes a message first and then hands it over: a kill in between would leave it in no
            # count.
            await until(lambda: heard[-1] == last)
            bridge.kill()
            for _ in range(20):
                last = await send()
            before = [*heard]
            bridge.restart()
            while heard == before:
                last = await send()
            await until(lambda: heard[-1] == last)
            missing = last - before[-1] - (len(heard) - len(before))
            wanted = missing if world.carrier == "rtps" else None
            await until(
                lambda: bridge.route("/back", "in")["dropped"].get("lost_on_the_way") == wanted,
                lambda: f"{missing}: {bridge.route('/back', 'in')}",
            )
    assert missing >= 20


@pytest.mark.nightly
@pytest.mark.parametrize("victim", ["bridge", "bridge stopped", "busd", "ros"])
@pytest.mark.parametrize("distro", ["jazzy", "kilted"])
@on_one_loop
async def test_whoever_is_killed_and_comes_back_all_flows_again(
    world: World, distro: peer.Distro, victim: str
) -> None:
    side, bridge = join(world)
    with contextlib.ExitStack() as stack:
        ros = stack.enter_context(node_of(world, distro))
        async with side.node("busd_node") as node:
            heard: list[int] = []
            by_publisher: defaultdict[bytes, list[int]] = defaultdict(list)

            def hear(message: String, info: bus.MessageInfo) -> None:
                heard.append(int(message.data))
                by_publisher[info.publisher_gid].append(heard[-1])

            await node.create_subscription(String, "/back", 1000, hear)
            publisher = await node.create_publisher(String, "/there", 1000)
            sent = 0

            async def talk() -> None:
                nonlocal sent
                while True:
                    sent += 1
                    publisher.publish(String(data=str(sent)))
                    await asyncio.sleep(0.02)

            talking = asyncio.create_task(talk())
            await _ends(ros)
            await until(lambda: heard and ros.heard["/there"])
            if victim == "bridge stopped":
                with bridge.stopped():
                    await asyncio.sleep(4)
            elif victim == "ros":
                ros.kill()
                ros = stack.enter_context(node_of(world, distro))
                await _ends(ros)
                await until(lambda: len(by_publisher) == 2)
            else:
                killed = bridge if victim == "bridge" else side.daemon
                killed.kill()
                await asyncio.sleep(0.5)
                killed.restart()
            now, count = sent, len(heard)
            await until(lambda: len(heard) > count + 5, "it is heard again")
            await until(lambda: _last(ros) > now, "it hears again")
            talking.cancel()
            await ask(ros, "stop", topic="/back")
            numbers = [int(one["data"]) for one in ros.heard["/there"]]
            for found in (*by_publisher.values(), numbers):
                assert found == sorted({*found}), "nothing twice, nothing out of order"
            await side.shows(lambda graph: len(graph.publishers_of("/back")) == 1)


async def _ends(ros: Peer) -> None:
    """A listener on /there, and a talker on /back."""
    deep = {"type_name": "std_msgs/msg/String", "depth": 1000}
    await ask(ros, "listen", topic="/there", **deep)
    await ask(ros, "publish", topic="/back", **deep)
    await ask(ros, "stream", topic="/back", hz=50)


def _last(ros: Peer) -> int:
    heard = ros.heard["/there"]
    return int(heard[-1]["data"]) if heard else 0
