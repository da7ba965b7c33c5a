"""`turtle_tf2_py`, the programs of ROS 2's tutorials on tf2: turtles and their frames."""
