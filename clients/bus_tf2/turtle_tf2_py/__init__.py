"""`turtle_tf2_py`, the programs of ROS 2's tutorials on tf2: turtles and their frames.

A module for each program, `carrots.py` and `spawner.py` for what some share. Names of programs, frames and
parameters are those of the tutorials, so that their text fits.

Read first: `turtle_tf2_broadcaster.py`. Tests: `tests/system/test_turtlesim.py`.
"""
