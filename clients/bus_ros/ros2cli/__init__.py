"""`ros2cli` on the bus: the nodes and helpers of ROS 2's command-line tools, for programs that import them.

`node/direct.py` has a node that also initializes the context, `node/strategy.py` a node for questions about
the graph, `helpers.py` functions for waiting and for arguments. `verb.py`, `command.py`, `plugin_system.py`
and `entry_points.py` are for plugins. The program `ros2` itself is missing: `bus` has its verbs.

Invariants:

- Both kinds of nodes are nodes of rclpy, so `rclpy.spin_once(node)` and the like work with them.
- There is no daemon with a view of the graph. busd has it, and each node sees it at once.

Read first: `node/direct.py`. Tests: `tests/unit/bus_ros/ros2cli/`, `tests/system/test_ros2_tools.py`.
"""
