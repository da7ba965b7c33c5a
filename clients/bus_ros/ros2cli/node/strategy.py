"""`ros2cli.node.strategy`: a node for questions about the graph.

In ROS 2 a daemon answers them, if one runs. Each node on busd knows the whole graph at once, so there is no
daemon, and no time to wait.
"""

from argparse import ArgumentParser
from typing import Any

import bus_ros.rclpy as rclpy
from bus_ros.ros2cli.node import direct
from bus_ros.ros2cli.node.direct import DirectNode

__all__ = ["DirectNode", "NodeStrategy", "add_arguments"]


class NodeStrategy(DirectNode):
    """A node of the program's default context; without one it initializes the context, and ends it.

    `args` as for a DirectNode; `spin_time` and `no_daemon` have no effect.
    """

    def __init__(self, args: Any, *, node_name: str | None = None) -> None:
        self._owns_context = not rclpy.ok()
        if self._owns_context:
            rclpy.init(args=getattr(args, "argv", []))
        self._make(args, node_name)

    def __exit__(self, *_: object) -> None:
        self.destroy_node()
        if self._owns_context:
            rclpy.try_shutdown()

    @property
    def direct_node(self) -> DirectNode:
        """The node itself."""
        return self

    @property
    def daemon_node(self) -> None:
        """None: there is no daemon."""


def add_arguments(parser: ArgumentParser) -> None:
    """Add the options of ROS 2's tools to a parser of arguments."""
    direct.add_arguments(parser)
    parser.add_argument(
        "--no-daemon", action="store_true", help="accepted as in ROS 2; busd's tools need no daemon"
    )
