"""Verbs of `bus ros2`: the program `bus` under the name `ros2`, for Makefiles and other programs.

`script.py` has the text and the place of the file; `install.py` writes it, `uninstall.py` removes it.

Invariant: a `ros2` that `install` did not write is never changed or hidden.

Read first: `script.py`. Tests: `tests/unit/bus_cli/ros2/`, `tests/system/test_cli_ros2.py`.
"""
