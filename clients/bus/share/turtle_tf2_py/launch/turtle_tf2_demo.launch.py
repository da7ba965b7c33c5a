"""Two turtles: the second follows the first, or the frame `target_frame`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """Make the description that `bus launch` runs."""
    broadcasters = [
        Node(
            package="turtle_tf2_py",
            executable="turtle_tf2_broadcaster",
            name=f"broadcaster{number}",
            parameters=[{"turtlename": f"turtle{number}"}],
        )
        for number in (1, 2)
    ]
    return LaunchDescription(
        [
            DeclareLaunchArgument("target_frame", default_value="turtle1", description="Target frame name."),
            Node(package="turtlesim", executable="turtlesim_node", name="sim"),
            *broadcasters,
            Node(
                package="turtle_tf2_py",
                executable="turtle_tf2_listener",
                name="listener",
                parameters=[{"target_frame": LaunchConfiguration("target_frame")}],
            ),
        ]
    )
