"""`tf2_ros` on the bus: transforms between frames, sent and heard on `/tf` and `/tf_static`.

    `transform_broadcaster.py`, `static_transform_broadcaster.py` --> topics --> `transform_listener.py`
                                                                                        |
    program --> `buffer.py` (look-ups, waiting; `buffer_interface.py`) <----------------+
    program --> `buffer_client.py` --> action --> `buffer_server.py` --> another program's buffer

Invariants:

- Modules that fill a buffer do not know look-ups, and look-ups do not know topics.
- The functions that transform a type are registered once for the process (`buffer_interface.py`).
- BufferClient and message classes are imported when they are first used.

Read first: `buffer.py`. Tests: `tests/system/test_tf2_ros.py`, `tests/system/test_tf2_buffer_server.py`,
`tests/unit/bus_tf2/test_bus_tf2_names.py`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from bus_tf2.messages import message_type
from bus_tf2.tf2_py import (
    BufferCore,
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)
from bus_tf2.tf2_ros.buffer import Buffer
from bus_tf2.tf2_ros.buffer_interface import (
    BufferInterface,
    ConvertRegistration,
    NotImplementedException,
    Stamped,
    TransformRegistration,
    TypeException,
    convert,
)
from bus_tf2.tf2_ros.static_transform_broadcaster import StaticTransformBroadcaster
from bus_tf2.tf2_ros.static_transform_listener import StaticTransformListener
from bus_tf2.tf2_ros.transform_broadcaster import TransformBroadcaster
from bus_tf2.tf2_ros.transform_listener import TransformListener

if TYPE_CHECKING:
    from bus_tf2.tf2_ros.buffer_client import BufferClient

__all__ = [
    "Buffer",
    "BufferClient",
    "BufferCore",
    "BufferInterface",
    "ConnectivityException",
    "ConvertRegistration",
    "ExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "NotImplementedException",
    "Stamped",
    "StaticTransformBroadcaster",
    "StaticTransformListener",
    "TimeoutException",
    "TransformBroadcaster",
    "TransformException",
    "TransformListener",
    "TransformRegistration",
    "TypeException",
    "convert",
]


_MESSAGES = {
    "Header": "std_msgs",
    "PointCloud2": "sensor_msgs",
    "PointStamped": "geometry_msgs",
    "PoseStamped": "geometry_msgs",
    "PoseWithCovarianceStamped": "geometry_msgs",
    "TFMessage": "tf2_msgs",
    "TransformStamped": "geometry_msgs",
    "Vector3Stamped": "geometry_msgs",
}
_OF_RCLPY = {"Duration": "duration", "Future": "task", "Node": "node", "QoSProfile": "qos", "Time": "time"}


def __getattr__(name: str) -> Any:
    """Import BufferClient on first use, because few programs need actions.

    Also names that are not tf2's: in ROS 2 programs can take them from tf2_ros because tf2_ros imports them.
    """
    if name == "BufferClient":
        return import_module("bus_tf2.tf2_ros.buffer_client").BufferClient
    if name in _MESSAGES:
        return message_type(f"{_MESSAGES[name]}/msg/{name}")
    if name in _OF_RCLPY:
        return getattr(import_module(f"bus_ros.rclpy.{_OF_RCLPY[name]}"), name)
    raise AttributeError(f"module 'tf2_ros' has no attribute {name!r}")
