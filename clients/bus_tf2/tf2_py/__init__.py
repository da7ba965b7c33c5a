"""`tf2_py` on the bus: the buffer of transforms that knows no topics, and tf2's exceptions.

`buffer_core.py` turns messages into numbers for the core and back. `exceptions.py` knows neither.

Invariants: classes, exceptions and texts are those of ROS 2's tf2_py; nothing here knows topics, nodes, or
waits.

Read first: `buffer_core.py`. Tests: `tests/unit/bus_tf2/tf2_py/`, `tests/system/test_tf2_judge.py`.
"""

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
