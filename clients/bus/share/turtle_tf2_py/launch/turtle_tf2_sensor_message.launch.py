"""Two turtles, a third that goes round in circles, and its place as a point on a topic."""

from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """Make the description that `bus launch` runs."""
    turtles = [
        Node(
            package="turtle_tf2_py",
            executable="turtle_tf2_broadcaster",
            name=f"broadcaster{number}",
            parameters=[{"turtlename": f"turtle{number}"}],
        )
        for number in (1, 3)
    ]
    return LaunchDescription(
        [
            Node(package="turtlesim", executable="turtlesim_node", name="sim"),
            *turtles,
            Node(
                package="turtle_tf2_py",
                executable="turtle_tf2_message_broadcaster",
                name="message_broadcaster",
            ),
        ]
    )
