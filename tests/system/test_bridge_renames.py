"""Rules of bridges that give topics other names, or other QoS, on the far side."""

import asyncio
from pathlib import Path
from typing import Any

import pytest

import bus
import ros2_bridged
from bridged_world import World, on_one_loop, until
from bridging import Made, received, world
from bus.msg.std_msgs import Int32, String
from bus.srv.example_interfaces import AddTwoInts
from bus.types.classes import service_class
from bus_bridge.core.qos_rule import QosRule
from bus_bridge.core.rules import TopicRule
from peers import peer
from ros2_bridged import LIST, ask, ros

__all__ = ["ros2_world", "world"]

ros2_world = ros2_bridged.world
ListParameters: Any = service_class(LIST)
BEST = bus.QoSProfile(10, reliability="best_effort")


async def test_a_renamed_topic_has_one_name_on_each_bus(world: Made) -> None:
    async with world() as made:
        left, right = made.site("left"), made.site("right")
        one = await made.bridge(left, topics=[TopicRule(pattern="/scan", far_name="/front/scan")])
        other = await made.bridge(right)
        made.network.join(one.engine, other.engine)
        ours, theirs = await left.node("ours"), await right.node("theirs")
        heard = await ours.create_subscription(Int32, "/scan")
        heard_there = await theirs.create_subscription(Int32, "/front/scan")
        same_name = await theirs.create_subscription(Int32, "/scan")
        out = await ours.create_publisher(Int32, "/scan")
        back = await theirs.create_publisher(Int32, "/front/scan")
        stranger = await theirs.create_publisher(Int32, "/scan")
        blocked = await ours.create_publisher(Int32, "/front/scan")
        after = await theirs.create_publisher(Int32, "/after")
        await out.wait_for_subscriptions(2)
        await back.wait_for_subscriptions(2)
        graph = await ours.wait_for_graph(lambda graph: bool(graph.publishers_of("/after")))
        assert {one.gid for one in graph.publishers_of("/scan")} == {out.gid, back.gid}
        assert {one.gid for one in graph.publishers_of("/front/scan")} == {blocked.gid}
        await until(lambda: any("'/front/scan' does not cross" in text for text in one.bridge._said))
        for number, publisher in enumerate((out, back, stranger, blocked, out, back)):
            publisher.publish(Int32(data=number))
        assert sorted(await received(heard, 4)) == [0, 1, 4, 5]
        assert sorted(await received(heard_there, 4)) == [0, 1, 4, 5]
        assert await received(same_name, 1) == [2]
        assert heard.take() is None and heard_there.take() is None and same_name.take() is None
        assert (one.bridge.status().shown_there.publishers, after.get_subscription_count()) == (1, 0)


async def test_a_renamed_service(world: Made) -> None:
    async with world() as made:
        left, right = made.site("left"), made.site("right")
        one = await made.bridge(left, topics=[TopicRule(pattern="/add", far_name="/sum")])
        other = await made.bridge(right)
        made.network.join(one.engine, other.engine)
        server, caller = await left.node("server"), await right.node("caller")
        await server.create_service(
            AddTwoInts, "/add", lambda request: AddTwoInts.Response(sum=request.a + request.b)
        )
        client = await caller.create_client(AddTwoInts, "/sum")
        await client.wait_for_service()
        assert (await client.call(AddTwoInts.Request(a=2, b=3))).sum == 5
        assert set(await _services(caller)) == {"/sum"}


async def test_endpoints_that_match_only_by_a_rule(world: Made) -> None:
    rule = TopicRule(
        pattern="/scan",
        publisher=QosRule(reliability="reliable"),
        subscription=QosRule(reliability="best_effort", depth=3),
    )
    async with world() as made:
        left, right = made.site("left"), made.site("right")
        one, other = await made.bridge(left, topics=[rule]), await made.bridge(right)
        made.network.join(one.engine, other.engine)
        listener, talker = await left.node("listener"), await right.node("talker")
        subscription = await listener.create_subscription(Int32, "/scan", 10)  # reliable
        publisher = await talker.create_publisher(Int32, "/scan", BEST)
        await publisher.wait_for_subscriptions()
        await subscription.wait_for_publishers()
        publisher.publish(Int32(data=7))
        assert await received(subscription, 1) == [7]
        (shown,) = (await talker.graph()).subscriptions_of("/scan")
        assert (shown.qos.reliability, shown.qos.depth) == ("best_effort", 3)


async def _services(node: bus.Node) -> list[str]:
    return [name for name in (await node.graph()).services() if not name.startswith("/bridge")]


@pytest.mark.parametrize("carrier", ["cyclonedds", "rtps"])
@peer.each_distro
@on_one_loop
async def test_ros_2(ros2_world: World, distro: peer.Distro, tmp_path: Path, carrier: str) -> None:
    pytest.importorskip("cyclonedds", reason="cyclonedds is not installed: make setup installs it")
    ros2_world.carrier = carrier
    (tmp_path / "bridge.toml").write_text("""
        [[bridge.ros2.topics]]
        pattern = "/scan"
        far_name = "/front/scan"
        publisher = { reliability = "reliable" }
        subscription = { reliability = "best_effort" }
        [[bridge.ros2.topics]]
        pattern = "/add"
        far_name = "/sum"
        """)
    side, bridge = ros2_bridged.join(ros2_world, "--config", str(tmp_path / "bridge.toml"))
    string = "std_msgs/msg/String"
    async with side.node("ours") as ours:
        heard: list[str] = []
        subscription = await ours.create_subscription(
            String, "/scan", 10, lambda message: heard.append(message.data)
        )
        with await ros(ros2_world, distro) as far:
            best = {"reliability": "best_effort"}
            await ask(far, "publish", topic="/front/scan", type_name=string, **best)
            await ask(far, "publish", topic="/scan", type_name=string)
            await ask(far, "listen", topic="/front/scan", type_name=string)
            await ask(far, "offer", service="/sum", type_name=LIST)
            publisher = await ours.create_publisher(String, "/scan", 10)
            await publisher.wait_for_subscriptions(2)
            await subscription.wait_for_publishers(2)
            await until(lambda: bridge.route("/scan", "in")["is_flowing"])
            await asyncio.to_thread(
                far.wait_for, "matched", lambda found: found == [2, 2], topic="/front/scan"
            )
            await ask(far, "send", topic="/scan", data="a stranger")
            await ask(far, "send", topic="/front/scan", data="from ROS 2")
            await until(lambda: heard == ["from ROS 2"])
            publisher.publish(String(data="from the bus"))
            # ROS 2's own publisher, best effort, does not match its reliable subscription.
            await until(lambda: [one["data"] for one in far.heard["/front/scan"]] == ["from the bus"])
            graph = await ours.wait_for_graph(lambda graph: "/add" in graph.services())
            assert "/sum" not in graph.services() and "/front/scan" not in graph.topics()
            topics = await ask(far, "topics")
            assert "/front/scan" in topics
    assert heard == ["from ROS 2", "from the bus"]


@peer.each_distro
@on_one_loop
async def test_calls_of_renamed_services_of_ros_2(
    ros2_world: World, tmp_path: Path, distro: peer.Distro
) -> None:
    (tmp_path / "bridge.toml").write_text("""
        [[bridge.ros2.topics]]
        pattern = "/ours"
        far_name = "/robot/ours"
        [[bridge.ros2.topics]]
        pattern = "/ros/theirs"
        far_name = "/theirs"
        """)
    side, _ = ros2_bridged.join(ros2_world, "--config", str(tmp_path / "bridge.toml"))

    def answer(request: Any) -> Any:
        response = ListParameters.Response()
        response.result.names = request.prefixes
        return response

    async with side.node("ours") as ours:
        await ours.create_service(ListParameters, "/ours", answer)
        client = await ours.create_client(ListParameters, "/ros/theirs")
        with await ros(ros2_world, distro) as far:
            (found,) = await ask(far, "call", service="/robot/ours", type_name=LIST, prefixes=["a"])
            assert found["result"]["names"] == ["a"]
            await ask(far, "offer", service="/theirs", type_name=LIST, result={"names": ["b"]})
            await client.wait_for_service()
            assert (await client.call(ListParameters.Request())).result.names == ["b"]
            names = await _services(ours)
            assert {"/ours", "/ros/theirs"} <= {*names} and not {"/robot/ours", "/theirs"} & {*names}
