"""Programs written for ROS 2, on busd: `rclpy`, message classes made from definitions, starting programs.

Each of the other folders is a small library that nodes import. `import_hook` has the names by which programs
import all of these modules. This package itself exports nothing.

    program: import rclpy, std_msgs.msg
        |
    `import_hook.py` --+-- `rclpy/` --> `entity.py`, `engine.py` --> bus.Node and the like
                       +-- `rosidl/` (message classes) --> bus.types
    `bus run` --> `packages.py`, `cmakelists.py` (find the program) --> `running.py` (run it)

Invariants:

- Names that can be imported already stay as they are: a machine with ROS 2 keeps its own modules, unless
  BUS_RCLPY_FORCE is set.
- A program of ROS 2 runs unchanged. Names, errors and texts are the same as in ROS 2. docs/rclpy.md lists all
  names, docs/rclpy-differences.md the differences.
- The event loop is used only under its guard (`engine.py`). User code never runs in the loop.
- A package here imports only the packages below it; import-linter has the layers.

Read first: `import_hook.py`, then `engine.py`; docs/architecture.md, "rclpy".

Tests: `tests/unit/bus_ros/`, `tests/system/test_rclpy_programs.py`, `tests/system/test_differential.py`.
"""
