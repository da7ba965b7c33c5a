"""Two simulators, each in a namespace of its own."""

from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """What `bus launch` runs."""
    return LaunchDescription(
        [
            Node(package="turtlesim", executable="turtlesim_node", namespace=f"turtlesim{number}")
            for number in (1, 2)
        ]
    )
