"""`turtle_tf2_py`, the programs of ROS 2's tutorials on tf2: turtles and their frames.

A module for each program; `carrots.py` and `spawner.py` have code that some of them share. Names of
programs, frames and parameters are the same as in the tutorials, so the tutorials' text fits.

Read first: `turtle_tf2_broadcaster.py`. Tests: `tests/system/test_turtlesim.py`.
"""
