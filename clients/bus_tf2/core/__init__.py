"""The numeric core of transforms, in C, with a Python twin where that was not built.

Owns: `FrameTree` and what its answers mean. Must not know: rclpy, messages, topics.
"""

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING or os.environ.get("BUS_NATIVE") == "no":
    from bus_tf2.core.twin import FrameTree
else:
    try:
        from bus_tf2.core._core import FrameTree
    except ImportError:
        from bus_tf2.core.twin import FrameTree

__all__ = ["FrameTree"]
