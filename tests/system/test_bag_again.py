"""A robot is recorded, played and recorded again: both bags have the same messages, types and QoS."""

from pathlib import Path

import pytest

from bus_bag.metadata import TopicMetadata
from bus_bag.schemas import SCHEMA
from bus_bag.storage import open_bag
from cli import bus, script, start
from recording import Bag, end, recording

ROBOT = """
import asyncio, enum, sys, bus
from bus.msg.sensor_msgs import Image, Imu
from bus.msg.std_msgs import String
from bus.types.classes import message_class
TF, Transform = message_class("tf2_msgs/msg/TFMessage"), message_class("geometry_msgs/msg/TransformStamped")
class Mode(enum.Enum):
    IDLE = "idle"
    DRIVEN = "driven"
class Gear(enum.IntEnum):
    LOW = 1
    HIGH = 2
class Wheel(bus.msg.Message, kw_only=True):
    index: int = 0
    names: dict[str, float] = {}
    note: str | None = None
    mode: Mode = Mode.IDLE
    gear: Gear = Gear.LOW
    pair: tuple[int, str] = (0, "")
KEPT = bus.QoSProfile(3, durability="transient_local")
async def main():
    async with bus.Node("robot") as node:
        image = await node.create_publisher(Image, "camera/image", bus.qos.sensor_data)
        imu = await node.create_publisher(Imu, "imu", bus.QoSProfile(50, deadline=2.0))
        wheel = await node.create_publisher(Wheel, "wheel", 10)
        static = await node.create_publisher(TF, "tf_static", KEPT)
        for name in ("base", "arm"):
            static.publish(TF(transforms=[Transform(child_frame_id=name)]))
        print("ready", flush=True)
        sys.stdin.readline()
        await node.graph()  # before its answer, busd has told of all subscriptions that are there
        for number in range(20):
            imu.publish(Imu(angular_velocity_covariance=[float(number)] * 9))
            note, mode = ("x", Mode.DRIVEN) if number % 2 else (None, Mode.IDLE)
            wheel.publish(Wheel(index=number, names={"left": 1.5}, note=note, mode=mode, gear=Gear.HIGH))
            if not number % 5:
                image.publish(Image(height=number, width=1, data=bytes(200_000)))
            await asyncio.sleep(0.01)
        print("done", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""
TOPICS = ("/camera/image", "/imu", "/tf_static", "/wheel")


def content(bag: Bag) -> dict[str, list[tuple[int, bytes]]]:
    """Topic -> publish time and data of each message, in the order of the whole bag."""
    found: dict[str, list[tuple[int, bytes]]] = {topic: [] for topic in TOPICS}
    with open_bag(bag.folder) as reader:
        for message in reader.messages():
            found[message.topic].append((message.publish_time, bytes(message.data)))
        assert reader.problems == []
    return found


def topics(bag: Bag) -> dict[str, tuple[TopicMetadata, str, str]]:
    """Topic -> its metadata, the definition of its type, and busd's schema of the type."""
    with open_bag(bag.folder) as reader:
        return {
            name: (topic, reader.definitions[topic.type], reader.extra[name][SCHEMA])
            for name, topic in reader.topics.items()
        }


@pytest.mark.usefixtures("daemon", "route")
def test_a_robot(tmp_path: Path) -> None:
    """Each file of the first bag begins with the transforms; the player publishes them only once."""
    first, second = Bag(tmp_path / "first"), Bag(tmp_path / "second")
    with script(ROBOT) as robot, recording(first, *TOPICS, "-b", "300000") as recorder:
        robot.write("\n")
        assert robot.line() == "done"
        end(recorder)
    with (
        recording(second, *TOPICS) as recorder,
        start("bag", "play", str(first.folder), "--start-paused") as player,
    ):
        for _ in TOPICS:
            recorder.error_line_with("Subscribed to topic")
        assert bus("service", "call", "/rosbag2_player/resume", "rosbag2_interfaces/srv/Resume").code == 0
        result = player.end()
        assert result.code == 0, result.err
        end(recorder)
    before, after = content(first), content(second)
    assert len(first.files) > 1
    assert len(before["/tf_static"]) == 2 * len(first.files)
    before["/tf_static"] = before["/tf_static"][:2]
    assert after == before
    counts = {topic: len(messages) for topic, messages in after.items()}
    assert counts == {"/camera/image": 4, "/imu": 20, "/tf_static": 2, "/wheel": 20}
    assert topics(second) == topics(first)
    for bag in (first, second):
        losses = bag.losses()
        assert {topic: one.written for topic, one in losses.items()} == counts
        assert not any(one.lost for one in losses.values())
        assert bag.read_by_others() == bag.metadata.message_count
