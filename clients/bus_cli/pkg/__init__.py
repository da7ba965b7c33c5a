"""Verbs of `bus pkg`.

`create.py` writes a new package with the texts of `templates.py`. The other verbs ask `bus_ros.packages`.

Invariants: `templates.py` is pure and touches no file; pip can install a created package, and colcon can
build it; its files have the form that ROS 2's lessons expect.

Read first: `templates.py`. Tests: `tests/unit/bus_cli/pkg/`, `tests/system/test_cli_pkg.py`,
`tests/system/test_cli_pkg_install.py`.
"""
