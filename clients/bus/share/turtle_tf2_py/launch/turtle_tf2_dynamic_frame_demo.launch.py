"""Two turtles, and a carrot beside the first, which goes round it.

With `target_frame:=carrot1` the second follows the carrot.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """Make the description that `bus launch` runs."""
    return LaunchDescription(
        [
            IncludeLaunchDescription(str(Path(__file__).with_name("turtle_tf2_demo.launch.py"))),
            Node(
                package="turtle_tf2_py",
                executable="dynamic_frame_tf2_broadcaster",
                name="dynamic_broadcaster",
            ),
        ]
    )
