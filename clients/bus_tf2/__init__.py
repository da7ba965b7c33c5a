"""Transforms: the packages tf2_ros, tf2_py, tf2_geometry_msgs and the like, and their programs.

The numeric core, `bus_tf2.core`, needs none of ROS. The other packages build on `bus_ros`.

    /tf, /tf_static --> `tf2_ros/` (listener) --> `tf2_py/` (BufferCore: messages) --> `core/` (numbers, in C)
    program --> `tf2_ros/` (Buffer: look-ups, waiting) ---------^
    `tf2_geometry_msgs/`, `tf2_sensor_msgs/` register how messages are transformed

`programs/` has tf2's programs, `robot/` reads URDF, `turtle_tf2_py/` has the tutorials' programs.

Invariants:

- Answers, errors and texts are those of ROS 2's tf2.
- The core and its Python twin give the same answers.
- NumPy is imported only by functions that need it.

Read first: `core/twin.py`, then `tf2_py/buffer_core.py`.

Tests: `tests/unit/bus_tf2/`, `tests/property/test_tf2_twin.py`, `tests/system/test_tf2_ros.py`,
`tests/system/test_tf2_judge.py`.
"""
