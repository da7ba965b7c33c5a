"""turtlesim, ROS 2's first robot, and the programs of its package."""
