"""The numeric core of transforms, in C, with a Python twin for installations without the C module.

Owns: `FrameTree` and the meaning of its answers. Must not know: rclpy, messages, topics.

`frames.h` has the algorithm, without Python; its binding is `py_frames.c` (`_core.pyi` has the types).
`twin.py` is the same in Python, with `rotation.py`. `texts.py` has tf2's words for both.

Invariants:

- Both implementations return the same answers and the same failures. A change goes into both.
- No module here imports `bus` (import-linter checks this).
- The cache time bounds the memory of a frame.

Read first: `twin.py`, then `frames.h`. Tests: `tests/unit/bus_tf2/core/`, `tests/property/test_tf2_twin.py`;
against the tf2 of ROS 1: `tests/system/test_tf2_judge.py`.
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
