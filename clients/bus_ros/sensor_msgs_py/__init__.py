"""`sensor_msgs_py` on the bus: point clouds as NumPy arrays; NumPy is imported when it is needed.

`point_cloud2.py` reads and makes PointCloud2 messages, `numpy_compat.py` has the two functions of NumPy that
ROS 2's package exports. Results and errors are the same as in ROS 2's package.

Read first: `point_cloud2.py`. Tests: `tests/unit/bus_ros/sensor_msgs_py/`.
"""
