"""BufferClient and the program buffer_server."""

import signal
from pathlib import Path

import pytest

from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.time import Time
from bus_tf2.tf2_ros import (
    Buffer,
    BufferClient,
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
)
from bus_tf2.tf2_ros.buffer_server import BufferServer
from programs import on_one_loop, running
from rclpy_world import World, arguments, in_thread, world
from tf2_world import at, transform

__all__ = ["arguments", "world"]

NOW = Time()


def test_questions_and_answers(world: World) -> None:
    node, asking = world.node("tf_buffer"), world.node("asking")
    buffer = Buffer()
    server = BufferServer(buffer, node)
    client = BufferClient(asking, "tf2_buffer_server", timeout_padding=Duration(seconds=30))
    for second in (1, 2):
        buffer.set_transform(transform("world", "robot", second, (second, 0, 0)), "me")
    buffer.set_transform_static(transform("other", "thing"), "me")
    with world.spinning(node), world.spinning(asking):
        assert client.wait_for_server(30)
        assert client.lookup_transform("world", "robot", at(1.5)).transform.translation.x == 1.5
        found = client.lookup_transform_full("robot", at(2), "robot", at(1), "world")
        assert found.transform.translation.x == -1.0
        assert client.can_transform("world", "robot", NOW)
        assert not client.can_transform_full("robot", at(3), "robot", at(1), "world")
        for target, source, time, error in (
            ("world", "nobody", NOW, LookupException),
            ("world", "thing", NOW, ConnectivityException),
            ("world", "robot", at(9), ExtrapolationException),
            ("", "robot", NOW, InvalidArgumentException),
        ):
            with pytest.raises(error):
                client.lookup_transform(target, source, time, Duration(seconds=0.01))
        waiting = Duration(seconds=30)
        with in_thread(lambda: client.lookup_transform("world", "late", NOW, waiting)):
            buffer.set_transform_static(transform("world", "late"), "me")
    assert not buffer._new_data_callbacks
    client.timeout_padding = Duration(seconds=0.01)
    with pytest.raises(TimeoutException, match="did not answer in time"):
        client.lookup_transform("world", "robot", NOW)
    client.destroy()
    server.destroy()


@pytest.mark.usefixtures("daemon")
@on_one_loop
async def test_the_program(tmp_path: Path) -> None:
    async with running(tmp_path, "-m", "bus_cli", "run", "tf2_ros", "buffer_server") as server:
        async with running(tmp_path, "-c", ASKING) as asking:
            await asking.line("^1.0$")
            assert await asking.end() == 0
        server.process.send_signal(signal.SIGINT)
        assert await server.end() == 0
        assert server.lines == []


ASKING = """
import bus.rclpy_compat, threading, rclpy
from rclpy.duration import Duration
from geometry_msgs.msg import TransformStamped
from tf2_ros import BufferClient, StaticTransformBroadcaster
rclpy.init()
node = rclpy.create_node("asking")
t = TransformStamped()
t.header.frame_id, t.child_frame_id, t.transform.translation.x = "world", "robot", 1.0
StaticTransformBroadcaster(node).sendTransform(t)
threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()
client = BufferClient(node, "tf2_buffer_server")
assert client.wait_for_server(60)
found = client.lookup_transform("world", "robot", rclpy.time.Time(), Duration(seconds=60))
print(found.transform.translation.x)
rclpy.shutdown()
"""
