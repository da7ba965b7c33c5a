"""Other rules for a running bridge: excluded topics end, others lose nothing."""

import asyncio
import signal
from pathlib import Path
from typing import Any

import pytest

import bus
import cli
import ros2_bridged
from bridged_world import World, on_one_loop, until
from bridging import KEPT, LATCHED, LOSSLESS, Made, Running, received, world
from bus.msg.std_msgs import Int32, String
from bus.srv.example_interfaces import AddTwoInts
from bus_bridge.core.naming import Naming
from bus_bridge.core.rules import Rules, TopicRule
from conftest import WAIT_S, Daemon
from peers import peer
from ports import free_port
from ros2_bridged import ask, ros
from terminals import OwnTerminal

__all__ = ["ros2_world", "world"]

ros2_world = ros2_bridged.world


def apply(running: Running, **rules: object) -> None:
    made = Rules(**rules)  # type: ignore[arg-type]
    running.bridge.reconfigure(made, Naming("", made.far_names))


@pytest.mark.parametrize("qos", [bus.QoSProfile(1000), LOSSLESS, KEPT], ids=["reliable", "lossless", "kept"])
async def test_topics_that_stay_lose_nothing(world: Made, qos: bus.QoSProfile) -> None:
    """Both ends change their rules while messages flow in both directions."""
    async with world() as made:
        left, right, one, other = await made.pair()
        talker, listener = await left.node("talker"), await right.node("listener")
        ends = [(talker, listener, "/out"), (listener, talker, "/in")]
        pairs = [
            (
                await say.create_publisher(Int32, topic, qos),
                await hear.create_subscription(Int32, topic, 1000),
            )
            for say, hear, topic in ends
        ]
        gone = await talker.create_publisher(Int32, "/gone", qos)
        watched = await listener.create_subscription(Int32, "/gone", 1000)
        for publisher, subscription in [*pairs, (gone, watched)]:
            await publisher.wait_for_subscriptions()
            await subscription.wait_for_publishers()
        said = 0
        denies = {one: False, other: False}
        steps: list[tuple[Running, dict[str, Any]]] = [
            (one, {"deny": ["/gone"]}),
            (other, {"deny": ["/other"]}),
            (one, {"topics": [TopicRule(pattern="/gone", depth=5)]}),
            (other, {"deny": ["/gone"], "topics": [TopicRule(pattern="/x", transit=True)]}),
            (other, {}),
        ]
        for running, rules in steps:
            for turn in range(100):
                said += 1
                for publisher, _ in pairs:
                    publisher.publish(Int32(data=said))
                gone.publish(Int32(data=said))
                if turn == 50:
                    apply(running, **rules)
                await asyncio.sleep(0)
            denies[running] = "/gone" in rules.get("deny", ())
            await until(lambda: (gone.get_subscription_count() == 0) == any(denies.values()))
        for _, subscription in pairs:
            async with asyncio.timeout(WAIT_S):
                assert await received(subscription, said) == [*range(1, said + 1)]
            assert subscription.take() is None
        for running in (one, other):
            for route in running.bridge.status().routes:
                assert route.topic == "/gone" or not route.dropped, route
        await watched.close()


async def test_what_is_excluded_ends_at_once_and_can_come_back(world: Made) -> None:
    async with world() as made:
        left, right, one, other = await made.pair()
        talker, listener = await left.node("talker"), await right.node("listener")
        publisher = await talker.create_publisher(Int32, "/map", LATCHED)
        subscription = await listener.create_subscription(Int32, "/map", LATCHED)
        await publisher.wait_for_subscriptions()
        publisher.publish(Int32(data=1))
        assert await received(subscription, 1) == [1]
        for running in (one, other):  # excluded where the publisher is, then where its mirror is
            apply(running, deny=["/map"])
            graph = await listener.wait_for_graph(lambda graph: not graph.publishers_of("/map"))
            await talker.wait_for_graph(lambda graph: not graph.subscriptions_of("/map"))
            assert any(node.full_name == "/talker" for node in graph.nodes)
            publisher.publish(Int32(data=2))
            apply(running)
            await subscription.wait_for_publishers()
            await publisher.wait_for_subscriptions()
            assert (await received(subscription, 1))[0] == 2
            publisher.publish(Int32(data=3))
            assert await received(subscription, 1) == [3]


async def test_a_topic_gets_another_name_and_other_limits(world: Made) -> None:
    async with world() as made:
        left, right, one, _ = await made.pair()
        talker, listener = await left.node("talker"), await right.node("listener")
        publisher = await talker.create_publisher(Int32, "/scan", 1000)
        first = await listener.create_subscription(Int32, "/scan", 1000)
        second = await listener.create_subscription(Int32, "/front", 1000)
        await publisher.wait_for_subscriptions()
        apply(one, topics=[TopicRule(pattern="/scan", far_name="/front", depth=7, max_rate_hz=1e-3)])
        await second.wait_for_publishers()
        await until(lambda: first.get_publisher_count() == 0)
        await publisher.wait_for_subscriptions()
        await until(lambda: any(route.is_flowing for route in one.bridge.status().routes))
        for number in range(3):
            publisher.publish(Int32(data=number))
        assert await received(second, 1) == [0]
        await until(
            lambda: sum(dict(r.dropped).get("rate_limit", 0) for r in one.bridge.status().routes) == 2
        )


def flowing(one: Running) -> list[bool]:
    """Of each route of a bridge, whether messages are on their way by it: before, one may be lost."""
    return [route.is_flowing for route in one.bridge.status().routes]


async def test_transit_by_other_rules(world: Made) -> None:
    async with world() as made:
        sites = [made.site(name) for name in ("a", "b", "c")]
        bridges = [await made.bridge(site) for site in sites]
        made.network.join(bridges[0].engine, bridges[1].engine)
        made.network.join(bridges[1].engine, bridges[2].engine)
        talker, listener = await sites[0].node("talker"), await sites[2].node("listener")
        publisher = await talker.create_publisher(Int32, "/t", 100)
        subscription = await listener.create_subscription(Int32, "/t", 100)
        for _ in range(2):
            apply(bridges[1], topics=[TopicRule(pattern="/t", transit=True)])
            await subscription.wait_for_publishers()
            await publisher.wait_for_subscriptions()
            await until(lambda: [flowing(one) for one in bridges] == [[True], [True, True], [True]])
            publisher.publish(Int32(data=7))
            assert await received(subscription, 1) == [7]
            apply(bridges[1])
            await listener.wait_for_graph(
                lambda graph: not any(node.full_name == "/talker" for node in graph.nodes)
            )
            await until(lambda: publisher.get_subscription_count() == 0)


@pytest.mark.parametrize("at", ["client", "server"])
async def test_a_call_under_way_of_an_excluded_service_ends_with_an_error(world: Made, at: str) -> None:
    async with world() as made:
        left, right, one, other = await made.pair()
        asked, never = asyncio.Event(), asyncio.Event()

        async def answer(request: AddTwoInts.Request) -> AddTwoInts.Response:
            asked.set()
            await never.wait()
            return AddTwoInts.Response()

        server, caller = await right.node("server"), await left.node("caller")
        await server.create_service(AddTwoInts, "/add", answer)
        client = await caller.create_client(AddTwoInts, "/add")
        await client.wait_for_service()
        call = asyncio.ensure_future(client.call(AddTwoInts.Request()))
        await asked.wait()
        apply(one if at == "client" else other, deny=["/add"])
        async with asyncio.timeout(WAIT_S):
            with pytest.raises(bus.BusError):
                await call
        assert not client.service_is_ready()


RULES = '[[bridge.ros2.topics]]\npattern = "{}"\ndirection = "none"\n'


@pytest.mark.parametrize("carrier", ["cyclonedds", "rtps"])
@peer.each_distro
@on_one_loop
async def test_sighup_with_ros_2(
    ros2_world: World, distro: peer.Distro, tmp_path: Path, carrier: str
) -> None:
    pytest.importorskip("cyclonedds", reason="cyclonedds is not installed: make setup installs it")
    ros2_world.carrier = carrier
    file = tmp_path / "bridge.toml"
    file.write_text(RULES.format("/nothing"))
    side, bridge = ros2_bridged.join(ros2_world, "--config", str(file), "--deny", "/always")
    string = "std_msgs/msg/String"

    async def reload(text: str, said: str) -> None:
        file.write_text(text)
        before = len(bridge.log.read_text())
        bridge.process.send_signal(signal.SIGHUP)
        await until(lambda: said in bridge.log.read_text()[before:], lambda: bridge.log.read_text())

    async with side.node("ours") as ours:
        heard: list[int] = []
        await ours.create_subscription(String, "/in", 1000, lambda message: heard.append(int(message.data)))
        await ours.create_subscription(String, "/gone", 1000)
        with await ros(ros2_world, distro) as far:
            for topic in ("/in", "/gone"):
                await ask(far, "publish", topic=topic, type_name=string, depth=1000)
            await ask(far, "listen", topic="/out", type_name=string, depth=1000)
            publisher = await ours.create_publisher(String, "/out", 1000)
            await publisher.wait_for_subscriptions()
            await until(lambda: bridge.route("/out", "out")["is_flowing"])
            await asyncio.to_thread(far.wait_for, "matched", lambda found: found[0] == 1, topic="/in")
            await until(lambda: bridge.route("/in", "in")["is_flowing"])
            await ask(far, "stream", topic="/in", hz=100)
            said = 0
            for text, line, is_gone in [
                (RULES.format("/gone"), "changed: topics", True),
                (RULES.format("gone"), "the rules stay as they were: ", True),
                ("", "changed: topics", False),
                (RULES.format("/gone") + "[bridge.ros2]\nid = 'other'\n", "; changes of id apply when", True),
            ]:
                await reload(text, line)
                await side.shows(lambda graph, is_gone=is_gone: bool(graph.publishers_of("/gone")) != is_gone)
                for _ in range(50):
                    said += 1
                    publisher.publish(String(data=str(said)))
                    await asyncio.sleep(0)
            await until(lambda: len(far.heard["/out"]) >= said)
            assert [int(one["data"]) for one in far.heard["/out"]] == [*range(1, said + 1)]
            await ask(far, "stop", topic="/in")
            await ask(far, "send", topic="/in", data="-1")
            await until(lambda: heard[-1:] == [-1])
            assert heard[:-1] == [*range(1, len(heard))]
    lines = bridge.log.read_text().splitlines()
    (mistake,) = [line for line in lines if "stay as they were" in line]
    assert "'gone' can never match" in mistake and str(file) in mistake


@pytest.mark.parametrize("carrier", ["cyclonedds", "rtps"])
@peer.each_distro
@on_one_loop
async def test_the_history_of_a_mirror_that_is_made_again(
    ros2_world: World, distro: peer.Distro, tmp_path: Path, carrier: str
) -> None:
    pytest.importorskip("cyclonedds", reason="cyclonedds is not installed: make setup installs it")
    ros2_world.carrier = carrier
    file = tmp_path / "bridge.toml"
    file.write_text("")
    side, bridge = ros2_bridged.join(ros2_world, "--config", str(file))
    latched = bus.QoSProfile(5, durability="transient_local")
    async with side.node("ours") as ours:
        heard: list[str] = []
        late: list[str] = []
        await ours.create_subscription(String, "/map", latched, lambda message: heard.append(message.data))
        with await ros(ros2_world, distro) as far:
            kind = {"type_name": "std_msgs/msg/String", "durability": "transient_local", "depth": 5}
            await ask(far, "publish", topic="/map", **kind)
            for text in "ab":
                await ask(far, "send", topic="/map", data=text)
            await until(lambda: heard == ["a", "b"])
            file.write_text('[[bridge.ros2.topics]]\npattern = "/map"\ndepth = 7\n')
            bridge.process.send_signal(signal.SIGHUP)
            await until(lambda: heard == ["a", "b"] * 2, lambda: f"{heard}\n{bridge.log.read_text()}")
            await ours.create_subscription(String, "/map", latched, lambda message: late.append(message.data))
            await until(lambda: late == ["a", "b"])
            await ask(far, "send", topic="/map", data="c")
            await until(lambda: late == ["a", "b", "c"])
            assert heard == ["a", "b", "a", "b", "c"]


def test_sighup_without_a_file(daemon: Daemon) -> None:
    pytest.importorskip("zenoh", reason="needs eclipse-zenoh")
    with cli.start(
        "bridge", "zenoh", "--listen", f"tcp/127.0.0.1:{free_port()}", "--socket", str(daemon.path)
    ) as one:
        one.error_line_with("listening on")
        one.process.send_signal(signal.SIGHUP)
        one.error_line_with("SIGHUP has no effect: the bridge has no file, only options. Give --config FILE")
        assert one.end(signal.SIGINT).code == -signal.SIGINT


def test_the_end_of_its_terminal_ends_it(daemon: Daemon) -> None:
    pytest.importorskip("zenoh", reason="needs eclipse-zenoh")
    words = ("bridge", "zenoh", "--listen", f"tcp/127.0.0.1:{free_port()}", "--socket", str(daemon.path))
    with OwnTerminal("-m", "bus_cli", *words) as one:
        one.read_until("listening on")
        one.send_signal(signal.SIGHUP)
        one.read_until("SIGHUP has no effect")
        one.close()
        assert one.wait() == -signal.SIGTERM
