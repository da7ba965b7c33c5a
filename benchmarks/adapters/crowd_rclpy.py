"""Many endpoints of rclpy, and a node that counts topics: the side of ROS 2 in bridge.py.

    python -m benchmarks.adapters.crowd_rclpy crowd|watch '{"endpoints": 500, "prefix": "/crowd"}'

`crowd` makes the endpoints from the word `go` on, says `made`, and stays. `watch` says `all` when it sees
topics of all endpoints. It does not use busd.
"""

import json
import sys
from typing import Any

import rclpy
from std_msgs.msg import String

from benchmarks.worker import tell

_EACH = 20
"""Endpoints of each node, as in `adapters.bridging`."""
_LOOK_S = 0.02


def crowd(prefix: str, endpoints: int) -> None:
    """Publishers and subscriptions in turn, each on a topic of its own."""
    tell("ready")
    sys.stdin.readline()
    nodes: list[Any] = []
    for number in range(endpoints):
        if number % _EACH == 0:
            name = f"{prefix.strip('/')}_{number // _EACH}"
            nodes.append(rclpy.create_node(name, enable_rosout=False, start_parameter_services=False))
        topic = f"{prefix}/topic_{number}"
        if number % 2:
            nodes[-1].create_subscription(String, topic, lambda message: None, 10)
        else:
            nodes[-1].create_publisher(String, topic, 10)
    tell("made")
    sys.stdin.readline()


def watch(prefix: str, endpoints: int) -> None:
    """Look at the names of all topics until there are enough."""
    node = rclpy.create_node("watch", enable_rosout=False, start_parameter_services=False)
    tell("ready")
    while sum(name.startswith(prefix) for name, _ in node.get_topic_names_and_types()) < endpoints:
        rclpy.spin_once(node, timeout_sec=_LOOK_S)
    tell("all")
    sys.stdin.readline()


if __name__ == "__main__":
    what = json.loads(sys.argv[2])
    rclpy.init(args=[])
    {"crowd": crowd, "watch": watch}[sys.argv[1]](what["prefix"], what["endpoints"])
    rclpy.shutdown()
