"""The engine for DDS against ROS 2's rclpy."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from typing import Any

import msgspec
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed: make setup installs it")

from bus.msg.geometry_msgs import Twist
from bus.msg.sensor_msgs import Image
from bus.msg.std_msgs import String
from bus.qos import QoSProfile
from bus.schema import MessageSchema
from bus_bridge.batch import Loose, Sample
from conftest import SOON_S
from peers import peer
from peers.dds import DOMAIN, LATCHED, LOSSLESS, STRING, Bridge, until


@pytest.fixture
async def bridge() -> AsyncIterator[Bridge]:
    made = Bridge()
    await made.open()
    yield made
    await made.engine.close()


@peer.each_distro
async def test_nodes_and_topics(bridge: Bridge, distro: peer.Distro) -> None:
    bridge.publish("/chatter")
    bridge.listen("/back")
    with await _ros(distro, "ros_node", "/far") as ros:
        await _ask(ros, "publish", topic="/up", type_name="std_msgs/msg/String")
        await _ask(ros, "listen", topic="/chatter", type_name="std_msgs/msg/String")
        await until(lambda: bridge.far.find("publisher", "/up"))
        await until(lambda: bridge.far.find("subscription", "/chatter"))
        assert bridge.far.names() == ["/far/ros_node"]
        assert bridge.far.warnings == []
        both = ["/far/ros_node", "/robot/busd_node"]
        await _wait_for(ros, "nodes", lambda found: found == both)
        topics = await _wait_for(ros, "topics", lambda found: {"/chatter", "/back"} <= found.keys())
        assert topics["/chatter"] == topics["/back"] == ["std_msgs/msg/String"]
        of_node = await _wait_for(
            ros, "of_node", lambda found: all(found), name="busd_node", namespace="/robot"
        )
        assert [list(one) for one in of_node] == [["/chatter"], ["/back"]]
        (found,) = await _wait_for(ros, "info", lambda found: len(found) == 1, topic="/back")
        # Cyclone omits the node of an endpoint; Kilted needs it.
        assert found["node"] == ("/robot/busd_node" if distro == "jazzy" else found["node"])
        assert (found["kind"], found["reliability"]) == ("subscription", "reliable")
    await until(lambda: not bridge.far.nodes and not bridge.far.endpoints)


@peer.each_distro
async def test_messages_both_ways(bridge: Bridge, distro: peer.Distro) -> None:
    image = MessageSchema.of(Image)
    twist = MessageSchema.of(Twist)
    got: list[Any] = []
    with await _ros(distro, "ros_node") as ros:
        for topic, schema in (("/text", STRING), ("/move", twist), ("/eye", image)):
            await _ask(ros, "publish", topic=f"{topic}/up", type_name=schema.type_name)
            await _ask(ros, "listen", topic=f"{topic}/down", type_name=schema.type_name)
            bridge.listen(f"{topic}/up", QoSProfile(), schema)
            writer = bridge.publish(f"{topic}/down", QoSProfile(), schema)
            endpoint = await until(lambda topic=topic: bridge.far.find("publisher", f"{topic}/up"))
            decode_one = msgspec.msgpack.Decoder(schema.to_class()).decode
            bridge.engine.read(
                endpoint,
                schema,
                lambda samples, d=decode_one: got.extend(d(one.payload) for one in samples),
            )
            await _wait_for(ros, "matched", lambda found: found[0] == 1, topic=f"{topic}/up")
            values: Any = {"data": "grüß"}
            message: Any = String(data="grüß")
            if schema is twist:
                values = {"linear": {"x": 1.5}, "angular": {"z": -2.0}}
                message = Twist()
                message.linear.x, message.angular.z = 1.5, -2.0
            elif schema is image:
                values = {"width": 100, "header": {"frame_id": "eye"}, "data": {"size": 30_000}}
                message = Image(width=100, data=bytes(number % 251 for number in range(30_000)))
                message.header.frame_id = "eye"
            await _ask(ros, "send", topic=f"{topic}/up", **values)
            await until(lambda: got)
            assert got.pop() == message
            await until(lambda writer=writer: writer.is_wanted)
            sample = Sample(msgspec.msgpack.encode(message), 1, time.time_ns())
            assert writer.write(Loose([sample])) == 1
            (heard,) = await asyncio.to_thread(ros.wait, f"{topic}/down")
            if schema is STRING:
                assert heard == values
            elif schema is twist:
                assert heard["linear"]["x"] == 1.5 and heard["angular"]["z"] == -2.0
            else:
                assert heard["width"] == 100 and heard["header"]["frame_id"] == "eye"
                assert heard["data"]["size"] == 30_000
            assert abs(ros.source_times_ns[f"{topic}/down"][0] - sample.source_time_ns) < 1000


@peer.each_distro
async def test_late_joiners(bridge: Bridge, distro: peer.Distro) -> None:
    durable: dict[str, Any] = {"durability": "transient_local", "depth": 1}
    writer = bridge.publish("/down", LATCHED)
    bridge.send(writer, "old", "kept")
    with await _ros(distro, "ros_node") as ros:
        await _ask(ros, "publish", topic="/up", type_name="std_msgs/msg/String", **durable)
        await _ask(ros, "send", topic="/up", data="latched")
        await _ask(ros, "listen", topic="/down", type_name="std_msgs/msg/String", **durable)
        assert (await asyncio.to_thread(ros.wait, "/down"))[0]["data"] == "kept"
        await until(lambda: bridge.far.find("publisher", "/up"))
        bridge.listen("/up", LATCHED)
        await bridge.read("/up")
        await until(lambda: bridge.heard == ["latched"])


@peer.each_distro
async def test_the_first_message_may_be_long(bridge: Bridge, distro: peer.Distro) -> None:
    """A volatile reader of Cyclone drops it if the writer's first heartbeat comes among its fragments."""
    bridge.listen("/up", LOSSLESS)
    with await _ros(distro, "ros_node") as ros:
        await _ask(ros, "publish", topic="/up", type_name="std_msgs/msg/String")
        await bridge.read("/up")
        await _wait_for(ros, "matched", lambda found: found[0] == 1, topic="/up")
        texts = [f"{number}" * 1_000_000 for number in range(3)]
        for text in texts:
            await _ask(ros, "send", topic="/up", data=text)
        await until(lambda: len(bridge.heard) == len(texts), f"{[len(one) for one in bridge.heard]}")
        assert bridge.heard == texts


@pytest.mark.nightly
@peer.each_distro
async def test_either_may_come_again(bridge: Bridge, distro: peer.Distro) -> None:
    bridge.listen("/up")
    for text in ("one", "two"):
        with await _ros(distro, "ros_node") as ros:
            await _ask(ros, "publish", topic="/up", type_name="std_msgs/msg/String")
            reader = await bridge.read("/up")
            await _wait_for(ros, "matched", lambda found: found[0] == 1, topic="/up")
            await _ask(ros, "send", topic="/up", data=text)
            await until(lambda text=text: bridge.heard[-1:] == [text])
        reader.close()
        await until(lambda: not bridge.far.endpoints)
    with await _ros(distro, "ros_node") as ros:
        await _ask(ros, "publish", topic="/up", type_name="std_msgs/msg/String")
        await _wait_for(ros, "nodes", lambda found: "/robot/busd_node" in found)
        begun = time.monotonic()
        await bridge.engine.close()
        await _wait_for(ros, "nodes", lambda found: found == ["/ros_node"])
        assert time.monotonic() - begun < SOON_S  # it has signed off: its lease would take 10 s
        again = Bridge()
        await again.open()
        try:
            again.listen("/up")
            await again.read("/up")
            await _wait_for(ros, "matched", lambda found: found[0] == 1, topic="/up")
            await _ask(ros, "send", topic="/up", data="three")
            await until(lambda: again.heard == ["three"])
        finally:
            await again.engine.close()
    assert bridge.heard == ["one", "two"]


async def _ros(distro: peer.Distro, name: str, namespace: str = "") -> peer.Peer:
    return await asyncio.to_thread(peer.ros, distro, name, None, namespace=namespace, domain=DOMAIN)


async def _ask(ros: peer.Peer, order: str, **arguments: Any) -> Any:
    return await asyncio.to_thread(ros.ask, order, **arguments)


async def _wait_for(ros: peer.Peer, order: str, fits: Callable[[Any], Any], **arguments: Any) -> Any:
    return await asyncio.to_thread(ros.wait_for, order, fits, **arguments)
