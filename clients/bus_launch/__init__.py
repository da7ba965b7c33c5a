"""Launch files: the packages `launch`, `launch_ros`, `launch_xml`, `launch_yaml` and `launch_testing`.

The modules here have the names of ROS 2's. `bus launch` runs launch files with them, or with the genuine ones
if those can be imported: `bus_ros.import_hook` decides. `inheritance.prepare` is for the program `bus`.

    file --> `launch_xml/`, `launch_yaml/` or Python --> `launch/` (description, events, processes)
                                                            ^-- `launch_ros/` (nodes)
    `launch_testing/` runs tests beside a launch;  `warm.py` forks nodes in Python from one process

Invariants:

- Names, arguments and texts are ROS 2's: launch files run unchanged.
- No process is left behind, however the launch ends, `kill -9` included (`launch/guard.py`).
- A forked node (`warm.py`) behaves exactly like a newly started one. If forking fails, the launch starts
  the node as any other program.

Read first: `launch/core.py`, then `launch/launch_service.py`; docs/launch.md for users' view.

Tests: `tests/unit/bus_launch/`, on `tests/world/launch_world.py`; `tests/system/test_launch.py`,
`tests/system/test_launch_processes.py`, `tests/system/test_launch_warm.py`.
"""
