"""Programs written for ROS 2, on busd: `rclpy`, classes made of definitions, and how they are started.

Beside these stand the small libraries that nodes import, a folder each. `import_hook` has the names by which
programs import all of them; nothing is imported from here itself.

    program: import rclpy, std_msgs.msg
        |
    `import_hook.py` --+-- `rclpy/` --> `entity.py`, `engine.py` --> bus.Node and the like
                       +-- `rosidl/` (message classes) --> bus.types
    `bus run` --> `packages.py`, `cmakelists.py` (find the program) --> `running.py` (run it)

Invariants:

- Names that can be imported already stay as they are: a machine with ROS 2 keeps its own modules, unless
  BUS_RCLPY_FORCE is set.
- A program of ROS 2 runs unchanged. Names, errors and texts are those of ROS 2; docs/rclpy.md lists all
  names, and docs/rclpy-differences.md what differs.
- The event loop is used under its guard only (`engine.py`). User code never runs in the loop.
- A package here imports the ones below only; import-linter has the layers.

Read first: `import_hook.py`, then `engine.py`; docs/architecture.md, "rclpy".

Tests: `tests/unit/bus_ros/`, `tests/system/test_rclpy_programs.py`, `tests/system/test_differential.py`.
"""
