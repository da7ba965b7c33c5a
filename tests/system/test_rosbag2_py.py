"""Programs that record and play bags with rosbag2_py, as in ROS 2's tutorials."""

from pathlib import Path

import pytest

from bags import read
from bus_bag.storage import open_bag
from packaged import run_bus
from programs import on_one_loop, running

pytestmark = pytest.mark.usefixtures("daemon")

RECORDER = """\
import rclpy
import rosbag2_py
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.serialization import serialize_message
from std_msgs.msg import String

class Recorder(Node):
    def __init__(self):
        super().__init__('recorder')
        self.writer = rosbag2_py.SequentialWriter()
        self.writer.open(
            rosbag2_py._storage.StorageOptions(uri='{folder}', storage_id='mcap'),
            rosbag2_py._storage.ConverterOptions('', ''))
        self.writer.create_topic(rosbag2_py._storage.TopicMetadata(
            id=0, name='chatter', type='std_msgs/msg/String', serialization_format='cdr'))
        self.create_subscription(String, 'chatter', self.hear, 10)
        print('ready', flush=True)

    def hear(self, message):
        self.writer.write('chatter', serialize_message(message), self.get_clock().now().nanoseconds)
        print('heard', message.data, flush=True)

rclpy.init()
try:
    rclpy.spin(Recorder())
except ExternalShutdownException:
    pass
"""
PLAYER = """\
import rclpy
import rosbag2_py
from rclpy.node import Node
from std_msgs.msg import String

rclpy.init()
node = Node('player')
heard = []
node.create_subscription(String, 'chatter', lambda message: heard.append(message.data), 10)
publisher = node.create_publisher(String, 'chatter', 10)
reader = rosbag2_py.SequentialReader()
reader.open(
    rosbag2_py.StorageOptions(uri='{folder}', storage_id='mcap'),
    rosbag2_py.ConverterOptions(input_serialization_format='cdr', output_serialization_format='cdr'))
print(reader.get_metadata().message_count)
while reader.has_next():
    publisher.publish(reader.read_next()[1])
while len(heard) < 2:
    rclpy.spin_once(node)
print(heard)
"""


@on_one_loop
async def test_record_and_play(tmp_path: Path) -> None:
    bag = tmp_path / "my_bag"
    recorder, player = tmp_path / "recorder.py", tmp_path / "player.py"
    recorder.write_text(RECORDER.format(folder=bag))
    player.write_text(PLAYER.format(folder=bag))
    async with running(tmp_path, "-m", "bus_cli", "run", recorder) as program:
        await program.line("ready")
        for word in ("one", "two"):
            assert (
                run_bus("topic", "pub", "--once", "/chatter", "std_msgs/msg/String", f"data: {word}").code
                == 0
            )
            await program.line(f"heard {word}")
        program.process.terminate()
        assert await program.end() == 0, program.lines
    with open_bag(bag) as reader:
        assert not reader.is_cut
        assert [one.text for one in read(reader)] == ["one", "two"]
    assert run_bus("run", str(player)) == ("2\n['one', 'two']\n", "", 0)
