"""The parts of a robot: links and joints, read from its description (URDF).

One module, which knows no topics: text in, links and joints out, and the place of a joint's child link.

Read first: `urdf.py`. Tests: `tests/unit/bus_tf2/robot/`, `tests/system/test_tf2_robot.py`.
"""
