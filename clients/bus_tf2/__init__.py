"""Transforms: what programs import as tf2_ros, tf2_py, tf2_geometry_msgs and the like, and their programs.

The numeric core, `bus_tf2.core`, needs none of ROS; all else builds on `bus_ros`.
"""
