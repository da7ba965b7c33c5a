"""`bus run tf2_ros tf2_echo`: a transform between two frames, again and again.

    tf2_echo source_frame target_frame [rate]

Owns: the lines for a transform (`lines`, pure), and how often they are printed.
"""

import sys
from collections.abc import Sequence
from math import asin, atan2, cos, degrees, pi
from typing import Any, NamedTuple

import bus_ros.rclpy as rclpy
from bus.base.printable import printable
from bus_ros.rclpy.clock import Clock, ClockType
from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.time import Time
from bus_tf2.core.rotation import Matrix, Vector, matrix
from bus_tf2.programs.shell import begun, own_words
from bus_tf2.tf2_ros import Buffer, TransformException, TransformListener

__all__ = ["Wish", "lines", "main", "read", "run"]

_USAGE = """\
Usage: tf2_echo source_frame target_frame [echo_rate]

This will echo the transform from the coordinate frame of the source_frame
to the coordinate frame of the target_frame.
Note: This is the transform to get data from target_frame into the source_frame.
Default echo rate is 1 if echo_rate is not given.

options:
  -r RATE       the echo rate, in Hz
  -t TIME       the transform at this time, in seconds; by default the latest
  -p PRECISION  digits after the point; 3 by default
"""
_END_S = 2**63 // 10**9
"""A time has its nanoseconds in 64 bits."""


class Wish(NamedTuple):
    """The request of a command line. `time_s`: None for the latest."""

    source: str
    target: str
    rate_hz: float = 1.0
    time_s: float | None = None
    precision: int = 3


def main() -> int:
    return run(own_words())


def run(words: Sequence[str]) -> int:
    """Echo until an interrupt; returns an exit status."""
    try:
        wish = read(words)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    if wish is None:
        print(_USAGE)
        return 1
    with begun():
        _echo(wish)
    return 0


def read(words: Sequence[str]) -> Wish | None:
    """None if the usage should be shown. Raises ValueError, with a text for the user, if one is wrong."""
    frames: list[str] = []
    given: dict[str, str] = {}
    ahead = iter(words)
    for word in ahead:
        if word in ("-r", "-t", "-p"):
            value = next(ahead, None)
            if value is None:
                return None
            given[word] = value
        elif word.startswith("-") and len(word) > 1:
            return None
        else:
            frames.append(word)
    if len(frames) == 3:
        given.setdefault("-r", frames.pop())
    if len(frames) != 2:
        return None
    rate = _number(given.get("-r", "1"), "rate", "a floating-point number")
    if not 0 < rate < float("inf"):
        raise ValueError("Rate must be positive")
    time = _number(given["-t"], "time", "a floating-point number") if "-t" in given else None
    if time is not None and not 0 <= time < _END_S:
        raise ValueError(f"Time must be from 0 to {_END_S} seconds, and is '{given['-t']}'")
    precision = _number(given.get("-p", "3"), "precision", "an integer")
    if not 0 <= precision <= 20 or precision != int(precision):
        raise ValueError(f"Precision must be from 0 to 20, and is '{given['-p']}'")
    return Wish(frames[0], frames[1], rate, time, int(precision))


def _number(text: str, what: str, kind: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"Failed to convert {what} argument '{text}' to {kind}") from None


def lines(found: Any, precision: int = 3) -> list[str]:
    """A TransformStamped, in words."""
    stamp, place = found.header.stamp, found.transform
    moved = (place.translation.x, place.translation.y, place.translation.z)
    turned = (place.rotation.x, place.rotation.y, place.rotation.z, place.rotation.w)
    rows = matrix(turned)
    angles = _angles(rows)

    def listed(numbers: Sequence[float]) -> str:
        return ", ".join(f"{number:.{precision}f}" for number in numbers)

    def aligned(numbers: Sequence[float]) -> str:
        return "".join(f" {number:6.{precision}f}" for number in numbers)

    nanosec = f"{stamp.nanosec:09d}" if stamp.sec or stamp.nanosec else "0"
    return [
        f"At time {stamp.sec}.{nanosec}",
        f"- Translation: [{listed(moved)}]",
        f"- Rotation: in Quaternion (xyzw) [{listed(turned)}]",
        f"- Rotation: in RPY (radian) [{listed(angles)}]",
        f"- Rotation: in RPY (degree) [{listed([degrees(angle) for angle in angles])}]",
        "- Matrix:",
        *(aligned((*row, part)) for row, part in zip(rows, moved, strict=True)),
        aligned((0.0, 0.0, 0.0, 1.0)),
    ]


def _angles(rows: Matrix) -> Vector:
    """Roll, pitch and yaw of a rotation."""
    slope = rows[2][0]
    if abs(slope) >= 1:  # the first axis stands on the third: the yaw is free
        return atan2(rows[2][1], rows[2][2]), pi / 2 if slope < 0 else -pi / 2, 0.0
    pitch = -asin(slope)
    c = cos(pitch)
    return atan2(rows[2][1] / c, rows[2][2] / c), pitch, atan2(rows[1][0] / c, rows[0][0] / c)


def _echo(wish: Wish) -> None:
    node = Node("tf2_echo")
    buffer = Buffer(node=node)
    listener = TransformListener(buffer, node, spin_thread=True)
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    period = Duration(seconds=1 / wish.rate_hz)
    time = Time(nanoseconds=0 if wish.time_s is None else round(wish.time_s * 1e9))
    while rclpy.ok():
        can, why = buffer.can_transform(wish.source, wish.target, time, period, return_debug_tuple=True)
        if can:
            break
        node.get_logger().info(
            f"Waiting for transform {wish.source} ->  {wish.target}: {why}", throttle_duration_sec=1.0
        )
    while rclpy.ok():
        try:
            said = lines(buffer.lookup_transform(wish.source, wish.target, time), wish.precision)
        except TransformException as error:
            said = [
                f"Failure at {node.get_clock().now().nanoseconds / 1e9:.9f}",
                f"Exception thrown:{error}",
                "The current list of frames is:",
                buffer.all_frames_as_string(),
            ]
        print(printable("\n".join(said)), flush=True)
        clock.sleep_for(period)
    listener.unregister()
