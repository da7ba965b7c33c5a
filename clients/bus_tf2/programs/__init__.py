"""The programs of tf2: `bus run tf2_ros static_transform_publisher`, and so on; see `bus_ros.packages`.

A module for each program, with robot_state_publisher and joint_state_publisher among them. `shell.py` has
their common parts: arguments, and the end by a signal.

Invariants: options, output and exit codes are those of ROS 2's programs. A new program needs a row in the
table of `bus_ros.packages`, by which `bus run` finds it.

Read first: `shell.py`, then `tf2_echo.py`. Tests: `tests/unit/bus_tf2/programs/`,
`tests/system/test_tf2_programs.py`, `tests/system/test_tf2_robot.py`.
"""
