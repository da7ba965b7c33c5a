"""`tf2_sensor_msgs` on the bus: importing it lets buffers transform point clouds.

One module. Importing it registers PointCloud2 with `bus_tf2.tf2_ros`; NumPy is imported with the first cloud.

Read first: `tf2_sensor_msgs.py`. Tests: `tests/unit/bus_tf2/tf2_sensor_msgs/`.
"""

from bus_tf2.tf2_sensor_msgs.tf2_sensor_msgs import (
    do_transform_cloud,
    from_msg_msg,
    to_msg_msg,
    transform_points,
)

__all__ = ["do_transform_cloud", "from_msg_msg", "to_msg_msg", "transform_points"]
