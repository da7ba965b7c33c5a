"""Verbs of `bus pkg`.

`create.py` writes a new package, whose texts are in `templates.py`; the others ask `bus_ros.packages`.

Invariants: `templates.py` is pure and touches no file; a created package can be installed by pip and built by
colcon; its files have the shape that ROS 2's lessons expect.

Read first: `templates.py`. Tests: `tests/unit/bus_cli/pkg/`, `tests/system/test_cli_pkg.py`,
`tests/system/test_cli_pkg_install.py`.
"""
