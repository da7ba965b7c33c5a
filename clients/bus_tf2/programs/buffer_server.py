"""`bus run tf2_ros buffer_server`: answers look-ups of programs that do not hear transforms themselves."""

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.node import Node
from bus_tf2.programs.shell import begun
from bus_tf2.tf2_ros import Buffer, TransformListener
from bus_tf2.tf2_ros.buffer_server import BufferServer

__all__ = ["main"]


def main() -> int:
    with begun():
        node = Node("tf_buffer")
        size_s = node.declare_parameter("buffer_size", 120.0).value
        buffer = Buffer(Duration(seconds=size_s), node)
        listener = TransformListener(buffer, node)
        BufferServer(buffer, node)
        rclpy.spin(node)
        listener.unregister()
    return 0
