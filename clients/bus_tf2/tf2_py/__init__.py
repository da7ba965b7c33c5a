"""`tf2_py` on the bus: the buffer of transforms that knows no topics, and tf2's exceptions."""

from bus_tf2.tf2_py.buffer_core import BufferCore
from bus_tf2.tf2_py.exceptions import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)

__all__ = [
    "BufferCore",
    "ConnectivityException",
    "ExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "TimeoutException",
    "TransformException",
]
