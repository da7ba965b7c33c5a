"""Paths into messages: `--field a.b[0].c`."""

from typing import Any

import msgspec
import pytest

from bus.msg.geometry_msgs import Point, Pose, PoseArray, PoseStamped
from bus.msg.sensor_msgs import JointState
from bus.msg.std_msgs import ByteMultiArray, String, UInt8MultiArray
from bus.types.support import type_support
from bus_cli.fields import FieldPath
from bus_cli.output import CommandError
from rows import for_each


class Part(msgspec.Struct):
    size: int = 1


class Own(msgspec.Struct):
    maybe: Part | None = None
    table: dict[str, Part] = {}
    pair: tuple[int, str] = (1, "x")
    anything: Any = None


def pick(message: msgspec.Struct, text: str) -> Any:
    return FieldPath(text, type_support(type(message)).schema).pick(message)


@for_each(
    ("message", "path", "value"),
    [
        (String(data="hi"), "data", "hi"),
        (PoseStamped(pose=Pose(position=Point(x=3.0))), "pose.position.x", 3.0),
        (PoseArray(poses=[Pose(), Pose(position=Point(y=2.0))]), "poses[1].position.y", 2.0),
        (PoseArray(poses=[Pose(position=Point(z=4.0))]), "poses[-1].position.z", 4.0),
        (JointState(name=["a", "b"]), "name[1]", "b"),
        (UInt8MultiArray(data=b"\x05\x06"), "data[1]", 6),
        (Own(maybe=Part(7)), "maybe.size", 7),
        (Own(table={"k": Part(8)}), "table.k.size", 8),
        (Own(pair=(1, "y")), "pair[1]", "y"),
        (Own(anything={"a": [1, 2]}), "anything.a[1]", 2),
    ],
)
def test_what_a_path_means(message: msgspec.Struct, path: str, value: object) -> None:
    assert pick(message, path) == value


@for_each(
    ("cls", "path", "node"),
    [
        (PoseStamped, "pose.position", "geometry_msgs/msg/Point"),
        (PoseArray, "poses[0]", "geometry_msgs/msg/Pose"),
        (UInt8MultiArray, "data", "uint8[]"),
        (UInt8MultiArray, "data[0]", "uint8"),
        (ByteMultiArray, "data[0]", "byte"),
        (Own, "maybe.size", "int"),
        (Own, "anything.x.y", "any"),
    ],
)
def test_the_type_of_what_is_there(cls: type[msgspec.Struct], path: str, node: object) -> None:
    assert FieldPath(path, type_support(cls).schema).node == node


@for_each(
    ("cls", "path", "text"),
    [
        (String, "x", "Invalid field 'x': 'String' object has no attribute 'x'"),
        (PoseStamped, "pose.pos", "Invalid field 'pose.pos': 'Pose' object has no attribute 'pos'"),
        (String, "data.x", "Invalid field 'data.x': 'str' object has no attribute 'x'"),
        (String, "data[0]", "Invalid field 'data[0]': 'str' object is not subscriptable"),
        (JointState, "name.x", "Invalid field 'name.x': 'list' object has no attribute 'x'"),
        (Own, "pair[5]", "Invalid field 'pair[5]': list index out of range"),
        (String, "", "Invalid field value ''"),
        (String, "data[x]", "Invalid field value 'data[x]'"),
        (String, ".data", "Invalid field value '.data'"),
        (String, "data.", "Invalid field value 'data.'"),
        (
            String,
            "__class__.__init__",
            "Invalid field '__class__.__init__': 'String' object has no attribute '__class__'",
        ),
    ],
)
def test_a_wrong_path_is_known_before_any_message(cls: type[msgspec.Struct], path: str, text: str) -> None:
    with pytest.raises(CommandError) as caught:
        FieldPath(path, type_support(cls).schema)
    assert str(caught.value) == text


@for_each(
    ("message", "path"),
    [(JointState(), "name[0]"), (Own(), "maybe.size"), (Own(), "table.k"), (Own(anything=3), "anything.x")],
)
def test_what_is_missing_in_a_message(message: msgspec.Struct, path: str) -> None:
    with pytest.raises(CommandError, match="Invalid field"):
        pick(message, path)
