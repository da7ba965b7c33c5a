"""Answers questions with the tf2 of ROS 1, whose C++ core has the same rules; for Debian's own Python.

Reads commands as JSON: `["begin"]`, for a new buffer, `["tell", parent, child, ns, moved, turned, is_static]`
or `["ask", target, source, ns]`. For each `ask` it prints seven numbers and a time, or the exception's name.
"""

import json
import sys
from typing import Any

import genpy  # type: ignore[import-not-found]
import tf2_py  # type: ignore[import-not-found]
from geometry_msgs.msg import TransformStamped  # type: ignore[import-not-found]


def main() -> None:
    answers = []
    for what, *deed in json.load(sys.stdin):
        if what == "begin":
            buffer = tf2_py.BufferCore()
        elif what == "tell":
            tell(buffer, *deed)
        else:
            answers.append(ask(buffer, *deed))
    json.dump(answers, sys.stdout)


def stamp(time_ns: int) -> Any:
    return genpy.Time(time_ns // 1_000_000_000, time_ns % 1_000_000_000)


def tell(buffer: Any, *deed: Any) -> None:
    parent, child, time_ns, moved, turned, is_static = deed
    made = TransformStamped()
    made.header.frame_id, made.child_frame_id, made.header.stamp = parent, child, stamp(time_ns)
    place = made.transform
    place.translation.x, place.translation.y, place.translation.z = moved
    place.rotation.x, place.rotation.y, place.rotation.z, place.rotation.w = turned
    (buffer.set_transform_static if is_static else buffer.set_transform)(made, "judge")


def ask(buffer: Any, target: str, source: str, time_ns: int) -> Any:
    try:
        found = buffer.lookup_transform_core(target, source, stamp(time_ns))
    except tf2_py.TransformException as error:
        return type(error).__name__
    moved, turned = found.transform.translation, found.transform.rotation
    place = [moved.x, moved.y, moved.z, turned.x, turned.y, turned.z, turned.w]
    return [*place, found.header.stamp.to_nsec()]


if __name__ == "__main__":
    main()
