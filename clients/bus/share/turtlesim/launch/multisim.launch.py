"""Two simulators, each in a separate namespace."""

from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """Make the description that `bus launch` runs."""
    return LaunchDescription(
        [
            Node(package="turtlesim", executable="turtlesim_node", namespace=f"turtlesim{number}")
            for number in (1, 2)
        ]
    )
