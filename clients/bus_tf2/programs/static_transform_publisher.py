"""`bus run tf2_ros static_transform_publisher`: sends one static transform, and stays."""

import random
import string
import sys
from collections.abc import Sequence
from typing import NamedTuple

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.impl.rcutils_logger import RcutilsLogger
from bus_ros.rclpy.node import Node
from bus_tf2.core.rotation import Quaternion, Vector, from_angles
from bus_tf2.messages import message
from bus_tf2.programs.shell import begun, own_words
from bus_tf2.tf2_ros import StaticTransformBroadcaster

__all__ = ["Wish", "main", "read"]

_USAGE = """\
usage: static_transform_publisher [--x X] [--y Y] [--z Z] [--qx QX] [--qy QY] [--qz QZ] [--qw QW] \
[--roll ROLL] [--pitch PITCH] [--yaw YAW] --frame-id FRAME_ID --child-frame-id CHILD_FRAME_ID

A command line utility for manually sending a static transform.

If no translation or orientation is provided, the identity transform will be published.

The translation offsets are in meters.

The rotation may be provided with roll, pitch, yaw euler angles in radians, or as a quaternion.

required arguments:
  --frame-id FRAME_ID parent frame
  --child-frame-id CHILD_FRAME_ID child frame id

optional arguments:
  --x X                 x component of translation
  --y Y                 y component of translation
  --z Z                 z component of translation
  --qx QX               x component of quaternion rotation
  --qy QY               y component of quaternion rotation
  --qz QZ               z component of quaternion rotation
  --qw QW               w component of quaternion rotation
  --roll ROLL           roll component Euler rotation
  --pitch PITCH         pitch component Euler rotation
  --yaw YAW             yaw component Euler rotation"""

_NUMBERS = ("x", "y", "z", "qx", "qy", "qz", "qw", "roll", "pitch", "yaw")
_OLD_EULER = ("x", "y", "z", "yaw", "pitch", "roll")
_OLD_QUATERNION = ("x", "y", "z", "qx", "qy", "qz", "qw")


class Wish(NamedTuple):
    """The request of a command line."""

    frame_id: str
    child_frame_id: str
    translation: Vector
    rotation: Quaternion
    is_old_style: bool = False


def main() -> int:
    with begun():
        try:
            wish = read(own_words())
        except ValueError as error:
            RcutilsLogger().error(f"error parsing command line arguments: {error}")
            print(_USAGE)
            return 1
        if wish is None:
            print(_USAGE)
            return 0
        if wish.is_old_style:
            RcutilsLogger().warning("Old-style arguments are deprecated; see --help for new-style arguments")
        return _publish(wish)
    return 0


def read(words: Sequence[str]) -> Wish | None:
    """A command line without the program's name; None asks for help. Raises ValueError with ROS 2's text."""
    if not words:
        raise ValueError("Not enough arguments to parse")
    numbers: dict[str, float] = {}
    texts: dict[str, str] = {}
    rest: list[str] = []
    ahead = iter(words)
    for word in ahead:
        name = word.removeprefix("--")
        if word in ("-h", "--help"):
            return None
        if word == name or name not in (*_NUMBERS, "frame-id", "child-frame-id"):
            rest.append(word)
        elif (value := next(ahead, None)) is None:
            raise ValueError(f"Not enough arguments for {word}")
        elif name in _NUMBERS:
            numbers[name] = _number(word, value)
        else:
            texts[name] = value
    has_angles = not numbers.keys().isdisjoint(("roll", "pitch", "yaw"))
    if has_angles and not numbers.keys().isdisjoint(_OLD_QUATERNION[3:]):
        raise ValueError("Cannot specify both quaternion and Euler rotations")
    if len(rest) in (8, 9):
        if texts or numbers:
            raise ValueError("Cannot specify both new-style (flags) and old-style (arguments)")
        names = _OLD_EULER if len(rest) == 8 else _OLD_QUATERNION
        *values, texts["frame-id"], texts["child-frame-id"] = rest
        numbers = {name: _number(name, value) for name, value in zip(names, values, strict=True)}
        has_angles = len(rest) == 8
    elif rest:
        raise ValueError("Extra unparsed arguments on command-line")
    for name, what in (("frame-id", "Frame"), ("child-frame-id", "Child frame")):
        if not texts.get(name):
            raise ValueError(f"{what} id must not be empty")
    of = numbers.get
    turned = (of("qx", 0.0), of("qy", 0.0), of("qz", 0.0), of("qw", 1.0))
    if has_angles:
        turned = from_angles(of("roll", 0.0), of("pitch", 0.0), of("yaw", 0.0))
    moved = (of("x", 0.0), of("y", 0.0), of("z", 0.0))
    return Wish(texts["frame-id"], texts["child-frame-id"], moved, turned, bool(rest))


def _number(name: str, value: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise ValueError(f"Failed to parse {name} argument as float") from None


def _publish(wish: Wish) -> int:
    name = "static_transform_publisher_" + "".join(random.choices(string.ascii_letters + string.digits, k=16))
    node = Node(name)
    if wish.frame_id == wish.child_frame_id:
        node.get_logger().error(
            f"cannot publish static transform from '{wish.frame_id}' to '{wish.child_frame_id}', exiting"
        )
        print("child_frame_id cannot equal frame_id", file=sys.stderr)
        return 1
    _declare(node, wish)
    made = message("geometry_msgs/msg/TransformStamped", child_frame_id=wish.child_frame_id)
    made.header.frame_id, made.header.stamp = wish.frame_id, node.get_clock().now().to_msg()
    moved, turned = made.transform.translation, made.transform.rotation
    moved.x, moved.y, moved.z = wish.translation
    turned.x, turned.y, turned.z, turned.w = wish.rotation
    StaticTransformBroadcaster(node).sendTransform(made)
    node.get_logger().info(
        "Spinning until stopped - publishing transform\n"
        f"translation: ({_quoted(wish.translation)})\n"
        f"rotation: ({_quoted(wish.rotation)})\n"
        f"from '{wish.frame_id}' to '{wish.child_frame_id}'"
    )
    rclpy.spin(node)
    return 0


def _declare(node: Node, wish: Wish) -> None:
    """The transform as parameters that can't be set, as ROS 2's program has them."""
    values: dict[str, float | str] = {
        **{f"translation.{axis}": value for axis, value in zip("xyz", wish.translation, strict=True)},
        **{f"rotation.{axis}": value for axis, value in zip("xyzw", wish.rotation, strict=True)},
        "frame_id": wish.frame_id,
        "child_frame_id": wish.child_frame_id,
    }
    for name, value in values.items():
        descriptor = message("rcl_interfaces/msg/ParameterDescriptor", read_only=True)
        node.declare_parameter(name, value, descriptor, ignore_override=True)


def _quoted(numbers: Sequence[float]) -> str:
    return ", ".join(f"'{number:f}'" for number in numbers)
