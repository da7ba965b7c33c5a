"""A program's own message classes, with types that Python has and ROS 2 doesn't."""

import enum
from typing import Annotated, Any

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

from bus.msg.builtin_interfaces import Time
from bus.msg.geometry_msgs import Pose

__all__ = ["WHEEL", "Wheel"]


class Color(enum.Enum):
    RED = "red"
    BLUE = "blue"


class Level(enum.IntEnum):
    LOW = 1
    HIGH = 2


class Axle(Struct, tag="axle"):
    length: int = 3


class Nut(Struct, array_like=True, tag=7):
    size: float
    kind: str = "M3"


class größe_x(Struct):
    value: int


class Wheel(Struct):
    index: int
    speed: float
    raw: bytes
    cameraInfo: bool
    _hidden: int
    stamp: Time
    pose: Pose | None
    axle: Axle
    maybe: int | None
    grown: größe_x
    gone: str | UnsetType = UNSET
    names: dict[str, float] = msgspec.field(default_factory=dict)
    parts: dict[int, dict[str, list[bytes]]] = msgspec.field(default_factory=dict)
    color: Color = Color.RED
    level: Level = Level.LOW
    grid: list[list[float]] = msgspec.field(default_factory=list)
    blob: bytes | None = None
    nuts: list[Nut] = msgspec.field(default_factory=list)
    extra: Any = None
    pair: tuple[int, bytes] = (1, b"")
    either: int | str = 0
    xyz: Annotated[list[float], Meta(min_length=3, max_length=3)] = msgspec.field(
        default_factory=lambda: [0.0] * 3
    )
    few: Annotated[list[int], Meta(min_length=1, max_length=5)] = msgspec.field(default_factory=lambda: [1])
    renamed: int = msgspec.field(default=1, name="class")


WHEEL = """\
int64 index
float64 speed
uint8[] raw
bool camera_info
int64 hidden
builtin_interfaces/Time stamp
geometry_msgs/Pose[<=1] pose
local/Axle axle
int64[<=1] maybe
local/GroeX grown
string[<=1] gone
local/WheelNamesEntry[] names
local/WheelPartsEntry[] parts
string color
int64 level
local/WheelGridItem[] grid
local/WheelBlobItem[<=1] blob
local/Nut[] nuts
busd/Json extra
busd/Json pair
busd/Json either
float64[3] xyz
int64[<=5] few
int64 renamed
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
================================================================================
MSG: local/Axle
int64 length
================================================================================
MSG: local/GroeX
int64 value
================================================================================
MSG: local/WheelNamesEntry
string key
float64 value
================================================================================
MSG: local/WheelPartsEntry
int64 key
local/WheelPartsEntryValueEntry[] value
================================================================================
MSG: local/WheelGridItem
float64[] value
================================================================================
MSG: local/WheelBlobItem
uint8[] value
================================================================================
MSG: local/Nut
float64 size
string kind
================================================================================
MSG: busd/Json
string data
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
================================================================================
MSG: local/WheelPartsEntryValueEntry
string key
local/WheelPartsEntryValueEntryValueItem[] value
================================================================================
MSG: local/WheelPartsEntryValueEntryValueItem
uint8[] value
"""
"""The definition of Wheel."""
