"""`tf2_ros` on the bus: transforms between frames, sent and heard on `/tf` and `/tf_static`."""

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

__all__ = [
    "Buffer",
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
