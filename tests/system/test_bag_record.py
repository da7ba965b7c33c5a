"""`bus bag record`, as a process: what is in the bag, and that it says what it lacks."""

import signal
from pathlib import Path

import pytest

from cli import bus, script
from recording import Bag, recording

TALKER = """
import asyncio, sys, bus
from bus.msg.std_msgs import String
async def main():
    async with bus.Node("talker") as node:
        publisher = await node.create_publisher(String, "topic", 100)
        print("ready", flush=True)
        for word in sys.stdin:
            for number in range(int(word)):
                publisher.publish(String(data=str(number)))
            await asyncio.sleep(0)
            print("said", flush=True)
bus.run(main())
"""
pytestmark = pytest.mark.usefixtures("daemon")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_talker_is_recorded(tmp_path: Path, number: int) -> None:
    bag = Bag(tmp_path / "walk")
    with script(TALKER) as talker, recording(bag.folder, "-a", "--custom-data", "site=hall") as recorder:
        talker.write("50\n")
        assert talker.line() == "said"
        result = recorder.end(number)
    assert (result.out, result.code) == ("", 0)
    assert result.err.endswith("[rosbag2_recorder]: Recording stopped\n")
    assert bag.texts() == [str(number) for number in range(50)]
    losses = bag.losses()
    assert (losses["/topic"].expected, losses["/topic"].written) == (50, 50)
    assert all(one.closes and not one.lost and not one.waiting for one in losses.values())
    assert bag.metadata.custom_data == {"site": "hall"}
    assert bag.metadata.relative_file_paths == ("walk_0.mcap",)
    (topic,) = [one.topic_metadata for one in bag.metadata.topics if one.topic_metadata.name == "/topic"]
    assert (topic.type, [qos.depth for qos in topic.offered_qos_profiles]) == ("std_msgs/msg/String", [100])
    (first, *_) = [one for one in bag.messages(bag.files[0]) if one[1].topic == "/topic"]
    _, channel, message = first
    assert message.sequence == 1
    assert 0 < message.log_time - message.publish_time < 10**9
    assert set(channel.metadata) == {
        "offered_qos_profiles",
        "topic_type_hash",
        "busd.type_hash",
        "busd.schema",
    }


def test_nothing_to_record(tmp_path: Path) -> None:
    result = bus("bag", "record", "-o", str(tmp_path / "walk"))
    assert (result.code, result.err) == (
        1,
        "[ERROR] [ros2bag]: Need to specify at least one option out of --all, --all-topics, --all-services, "
        "--services, --topics, --topic-types or --regex\n",
    )
    result = bus("bag", "record", "-a", "-o", str(tmp_path))
    assert (result.code, result.err) == (
        1,
        f"[ERROR] [ros2bag]: Output folder '{tmp_path}' already exists.\n",
    )
