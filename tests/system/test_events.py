"""Events, mistakes and the graph, end to end through a real daemon, on both event loops."""

import asyncio
from typing import Any

import msgspec
import pytest

import bus
from bus.events import DeadlineMissed, IncompatibleQoS, IncompatibleType, LivelinessChanged, MatchedChange
from bus.msg.geometry_msgs import Twist, Vector3
from bus.msg.std_msgs import Int32, String
from conftest import WAIT_S, Daemon
from semantics import LATCHED, Wheel, accounted, node, until

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("route")


class TestEvents:
    async def test_matches_come_and_go(self, node: bus.Node) -> None:
        told: list[MatchedChange] = []
        publisher = await node.create_publisher(
            String, "t", 10, events=bus.PublisherEvents(matched=told.append)
        )
        subscription = await node.create_subscription(String, "t", 10)
        await publisher.wait_for_subscriptions(1)
        assert publisher.get_subscription_count() == 1
        await subscription.close()
        await until(lambda: len(told) == 2)
        assert told == [MatchedChange(1, 1, 1, 1, "/tester"), MatchedChange(0, -1, 1, 0, "/tester")]

    async def test_incompatible_qos_is_said_at_once_to_both(self, node: bus.Node, capfd: Any) -> None:
        told: list[IncompatibleQoS] = []
        publisher = await node.create_publisher(String, "t", bus.qos.sensor_data)
        await node.create_subscription(
            String, "t", 10, events=bus.SubscriptionEvents(incompatible_qos=told.append)
        )
        await until(lambda: told)
        assert told[0].policy == "RELIABILITY"
        assert told[0].text == "ERROR: Best effort publisher and reliable subscription;"
        assert told[0].node == "/tester"
        assert publisher.get_subscription_count() == 0
        warning = (
            "[tester]: New subscription discovered on topic '/t', requesting incompatible QoS. "
            "No messages will be sent to it. Last incompatible policy: RELIABILITY"
        )
        errors = ""
        async with asyncio.timeout(WAIT_S):
            while warning not in errors:
                errors += capfd.readouterr().err
                await asyncio.sleep(0.002)

    async def test_two_types_on_one_topic_do_not_match(self, node: bus.Node, capfd: Any) -> None:
        subscription = await node.create_subscription(String, "t", 10)
        publisher = await node.create_publisher(Int32, "t", 10)
        publisher.publish(Int32(data=1))
        errors = ""
        async with asyncio.timeout(WAIT_S):
            while errors.count("Incompatible type on topic '/t'") < 2:
                errors += capfd.readouterr().err
                await asyncio.sleep(0.002)
        assert "the publisher has std_msgs/msg/Int32, the subscription std_msgs/msg/String" in errors
        assert subscription.get_publisher_count() == 0

    async def test_both_are_told_where_two_types_of_one_name_differ(self, node: bus.Node, capfd: Any) -> None:
        told: list[IncompatibleType] = []
        other = msgspec.defstruct("Wheel", [("speed", str)], namespace={"__type_name__": "demo/msg/Wheel"})
        own = msgspec.defstruct("Wheel", [("speed", float)], namespace={"__type_name__": "demo/msg/Wheel"})
        await node.create_subscription(own, "t", 10)
        await node.create_publisher(other, "t", 10, events=bus.PublisherEvents(incompatible_type=told.append))
        await until(lambda: told)
        text = (
            "both call it demo/msg/Wheel, but field 'speed' is string at the publisher and float64 at the "
            "subscription"
        )
        assert told == [IncompatibleType(1, 1, text, "/tester")]
        errors = ""
        async with asyncio.timeout(WAIT_S):
            while text not in errors:
                errors += capfd.readouterr().err
                await asyncio.sleep(0.002)
        assert "no messages will be received from it. (node /tester: both call it" in errors

    async def test_deadlines_are_watched_on_both_sides(self, node: bus.Node) -> None:
        missed: dict[str, list[DeadlineMissed]] = {"publisher": [], "subscription": []}
        qos = bus.QoSProfile(deadline=0.02)
        subscription = await node.create_subscription(
            String, "t", qos, events=bus.SubscriptionEvents(deadline_missed=missed["subscription"].append)
        )
        publisher = await node.create_publisher(
            String, "t", qos, events=bus.PublisherEvents(deadline_missed=missed["publisher"].append)
        )
        publisher.publish(String())
        await subscription.receive()
        await until(lambda: len(missed["publisher"]) >= 2 and len(missed["subscription"]) >= 2)
        assert missed["publisher"][1] == DeadlineMissed(2, 1)

    async def test_what_outlived_its_lifespan_is_dropped_and_counted(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Int32, "t", 10)
        publisher = await node.create_publisher(Int32, "t", bus.QoSProfile(lifespan=0.05))
        lasting = await node.create_publisher(Int32, "t", 10)
        publisher.publish(Int32(data=1))
        await until(lambda: accounted(subscription) == 1)
        await asyncio.sleep(0.06)  # the lifespan itself
        lasting.publish(Int32(data=2))
        assert (await subscription.receive())[0].data == 2
        assert subscription.statistics().dropped == {"expired": 1}

    async def test_manual_liveliness_is_lost_and_taken_up_again(self, node: bus.Node) -> None:
        told: list[LivelinessChanged] = []
        qos = bus.QoSProfile(liveliness="manual_by_topic", liveliness_lease_duration=0.05)
        await node.create_subscription(
            Int32, "t", qos, events=bus.SubscriptionEvents(liveliness_changed=told.append)
        )
        lost: list[Any] = []
        publisher = await node.create_publisher(
            Int32, "t", qos, events=bus.PublisherEvents(liveliness_lost=lost.append)
        )
        publisher.assert_liveliness()
        await until(lambda: len(told) >= 2 and lost)
        publisher.assert_liveliness()
        await until(lambda: len(told) >= 3)
        assert told[:3] == [
            LivelinessChanged(1, 0, 1, 0),
            LivelinessChanged(0, 1, -1, 1),
            LivelinessChanged(1, 0, 1, -1),
        ]
        await publisher.close()
        await until(lambda: sum(one.alive_count_change + one.not_alive_count_change for one in told) == 0)

    async def test_automatic_liveliness_is_kept_up_by_the_library(self, node: bus.Node) -> None:
        """It stays alive for several leases. On a slow machine it may be lost before, but it must recover."""
        lease_s = 0.15
        told: list[tuple[float, LivelinessChanged]] = []
        loop = asyncio.get_running_loop()
        qos = bus.QoSProfile(liveliness_lease_duration=lease_s)
        await node.create_subscription(
            Int32,
            "t",
            qos,
            events=bus.SubscriptionEvents(liveliness_changed=lambda one: told.append((loop.time(), one))),
        )
        await node.create_publisher(Int32, "t", qos)
        await until(lambda: told)
        assert told[0][1] == LivelinessChanged(1, 0, 1, 0)
        await until(lambda: told[-1][1].alive_count == 1 and loop.time() - told[-1][0] > 3 * lease_s)


class TestMistakes:
    async def test_a_wrong_field_is_named_with_its_path(self, node: bus.Node) -> None:
        publisher = await node.create_publisher(Twist, "cmd", 10)
        wrong = Twist(linear=Vector3(x="fast"))  # type: ignore[arg-type]
        with pytest.raises(bus.MessageTypeError, match=r"geometry_msgs/msg/Twist.*\$\.linear\.x"):
            publisher.publish(wrong)
        assert publisher.statistics().published == 0

    async def test_another_class_is_refused(self, node: bus.Node) -> None:
        publisher = await node.create_publisher(String, "t", 10)
        with pytest.raises(bus.MessageTypeError, match="std_msgs/msg/String"):
            publisher.publish(Int32(data=1))  # type: ignore[arg-type]

    async def test_bytes_that_do_not_decode_are_counted_and_the_stream_goes_on(
        self, node: bus.Node, capfd: Any
    ) -> None:
        subscription = await node.create_subscription(String, "t", 10)
        publisher = await node.create_publisher(String, "t", 10)
        publisher.publish_encoded(b"\xc1 no message")
        publisher.publish(String(data="after"))
        assert (await subscription.receive())[0].data == "after"
        assert subscription.statistics().dropped == {"undecodable": 1}
        assert "is no std_msgs/msg/String" in capfd.readouterr().err

    @pytest.mark.parametrize("name", ["", "a//b", "1st", "a b", "trailing/", "{unknown}"])
    async def test_bad_topic_names(self, node: bus.Node, name: str) -> None:
        with pytest.raises(bus.ConfigurationError):
            await node.create_publisher(String, name, 10)

    async def test_no_struct_is_no_message_type(self, node: bus.Node) -> None:
        with pytest.raises(bus.MessageTypeError, match="int"):
            await node.create_publisher(int, "t", 10)  # type: ignore[type-var]

    async def test_closed_endpoints_say_so(self, node: bus.Node) -> None:
        publisher = await node.create_publisher(String, "t", 10)
        await publisher.close()
        await publisher.close()
        with pytest.raises(bus.ConnectionClosed, match="'/t'"):
            publisher.publish(String())

    async def test_iteration_ends_when_the_subscription_is_closed(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(String, "t", 10)
        asyncio.get_running_loop().call_soon(asyncio.ensure_future, subscription.close())
        assert [message async for message in subscription] == []

    async def test_an_exception_in_a_callback_ends_the_body(self, daemon: Daemon) -> None:
        def fail(message: String) -> None:
            raise ValueError("broken callback")

        with pytest.raises(ValueError, match="broken callback"):
            async with asyncio.timeout(WAIT_S), bus.Node("failing", arguments=[]) as node:
                await node.create_subscription(String, "t", 10, fail)
                (await node.create_publisher(String, "t", 10)).publish(String())
                await asyncio.Event().wait()


class TestNames:
    async def test_remapping_by_argument(self, daemon: Daemon) -> None:
        arguments = ["--ros-args", "-r", "topic:=other", "-r", "__node:=renamed", "-r", "__ns:=/fleet"]
        async with asyncio.timeout(WAIT_S), bus.Node("original", arguments=arguments) as node:
            publisher = await node.create_publisher(String, "topic", 10)
            assert publisher.topic_name == "/fleet/other"
            assert node.full_name == "/fleet/renamed"
            graph = await node.graph()
            assert [one.full_name for one in graph.nodes] == ["/fleet/renamed"]
            private = await node.create_publisher(String, "~/state", 10)
            assert private.topic_name == "/fleet/renamed/state"

    async def test_the_graph_shows_endpoints_matches_and_counters(self, node: bus.Node, route: str) -> None:
        subscription = await node.create_subscription(String, "t", 10)
        publisher = await node.create_publisher(String, "t", 10)
        publisher.publish(String(data="x"))
        await subscription.receive()
        graph = await node.graph(statistics=True)
        assert graph.topics()["/t"] == ["std_msgs/msg/String"]
        (mine,) = graph.publishers_of("/t")
        assert (mine.gid, mine.node.full_name, mine.qos) == (publisher.gid, "/tester", publisher.qos)
        assert [(match.publisher, match.route) for match in graph.matches] == [(mine.id, route)]
        while mine.statistics is None or mine.statistics.samples == 0:  # until it is reported
            (mine,) = (await node.graph(statistics=True)).publishers_of("/t")
        assert mine.statistics.samples == 1

    async def test_a_type_can_be_had_from_the_bus(self, node: bus.Node) -> None:
        publisher = await node.create_publisher(Wheel, "wheel", 10)
        foreign = await node.get_type(publisher._core.support.name, publisher._core.support.hash)
        data = publisher._core.support.encode(Wheel("front", [0.5]))
        rebuilt = msgspec.msgpack.decode(data, type=foreign)
        assert (rebuilt.name, rebuilt.speeds) == ("front", [0.5])  # type: ignore[attr-defined]

    async def test_logs_go_to_rosout(self, node: bus.Node) -> None:
        from bus.msg.rcl_interfaces import Log

        rosout = await node.create_subscription(Log, "/rosout", LATCHED)
        node.get_logger().info("hello log")
        message, _ = await rosout.receive()
        assert (message.msg, message.name, message.level) == ("hello log", "tester", 20)

    async def test_waiting_for_the_graph(self, node: bus.Node) -> None:
        waiting = asyncio.create_task(node.wait_for_graph(lambda graph: "/late" in graph.topics()))
        await node.graph()
        assert not waiting.done()
        await node.create_publisher(String, "late", 10)
        assert "/late" in (await waiting).topics()

    async def test_spin_lasts_until_a_callback_fails(self, daemon: Daemon) -> None:
        def fail() -> None:
            raise ValueError("broken timer")

        with pytest.raises(ValueError, match="broken timer"):
            async with asyncio.timeout(WAIT_S), bus.Node("spinner", arguments=[]) as node:
                node.create_timer(0.001, fail)
                await node.spin()
