"""`tf2_geometry_msgs` on the bus: importing it lets buffers transform points, vectors, poses and wrenches.

One module. Importing it registers the types with `bus_tf2.tf2_ros`; that side effect is the purpose.
Functions and results are those of ROS 2's package.

Read first: `tf2_geometry_msgs.py`. Tests: `tests/unit/bus_tf2/tf2_geometry_msgs/`.
"""

from bus_tf2.tf2_geometry_msgs.tf2_geometry_msgs import (
    __getattr__,
    do_transform_point,
    do_transform_pose,
    do_transform_pose_stamped,
    do_transform_pose_with_covariance_stamped,
    do_transform_vector3,
    do_transform_wrench,
    from_msg_msg,
    to_msg_msg,
    transform_covariance,
)

__all__ = [
    "__getattr__",
    "do_transform_point",
    "do_transform_pose",
    "do_transform_pose_stamped",
    "do_transform_pose_with_covariance_stamped",
    "do_transform_vector3",
    "do_transform_wrench",
    "from_msg_msg",
    "to_msg_msg",
    "transform_covariance",
]
