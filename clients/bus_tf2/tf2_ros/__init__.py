"""`tf2_ros` on the bus: transforms between frames, sent and heard on `/tf` and `/tf_static`."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

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


def __getattr__(name: str) -> Any:
    """Few programs need actions, which take time to import."""
    if name == "BufferClient":
        return import_module("bus_tf2.tf2_ros.buffer_client").BufferClient
    raise AttributeError(f"module 'tf2_ros' has no attribute {name!r}")
