"""The generated checks: True is certain, and the usual values of programs give True."""

import enum
from array import array
from typing import Annotated, Any, Literal

import msgspec
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Meta, Struct, field

from bus.msg import Message, float64, int8, uint8, uint16, uint64
from bus.msg.geometry_msgs import Point, Pose, PoseArray, Twist, Vector3
from bus.msg.nav_msgs import OccupancyGrid
from bus.msg.sensor_msgs import Image, Imu, JointState, LaserScan, PointCloud2, PointField
from bus.msg.std_msgs import Bool, Byte, Float32, Int8, String, UInt8, UInt64
from bus.types.check import predicate
from bus.types.schema import build, describe
from bus.types.support import type_support
from rows import for_each


class Number(enum.IntEnum):
    ONE = 1


class Text(str):
    """A str whose exact type is not `str`, like numpy's."""


class Scalar(float):
    pass


class Whole(int):
    pass


@for_each(
    "message",
    [
        String(data="hi"),
        Bool(data=True),
        Byte(data=b"\xff"),
        Float32(data=float("nan")),
        Float32(data=3),
        Float32(data=-(2**63)),
        Int8(data=-128),
        UInt64(data=2**64 - 1),
        Twist(linear=Vector3(x=1, y=0.5, z=-0.0)),
        Imu(orientation_covariance=[1.0] * 8 + [float("inf")]),
        Imu(orientation_covariance=[1, 2.0, 3, 4, 5, 6, 7, 8, 2**64 - 1]),
        Image(data=b"abc"),
        Image(data=bytearray(b"abc")),  # type: ignore[arg-type]
        Image(data=memoryview(b"abc")),  # type: ignore[arg-type]
        Image(data=memoryview(bytes(12)).cast("B", (2, 2, 3))),  # type: ignore[arg-type]
        JointState(name=["a", "b"], position=[0.0, 1.0]),
        PoseArray(poses=[Pose(), Pose(position=Point(x=1.0))]),
        PointCloud2(fields=[PointField(name="x"), PointField(name="y", datatype=PointField.FLOAT32)]),
        *(LaserScan(ranges=[0.5] * length) for length in (0, 1, 15, 16, 17, 65_535, 65_536)),
        LaserScan(ranges=[0.5, 1] * 20),
        *(OccupancyGrid(data=[-128, -33, -32, -1, 0, 100, 127] * length) for length in (1, 3, 10_000)),
        OccupancyGrid(data=[0, 100, -1, 50] * 20_000),
    ],
)
def test_what_programs_publish_is_valid_at_once(message: Message) -> None:
    support: Any = type_support(type(message))
    assert support.is_valid(message) is True
    assert support.explain(message) is None


@for_each(
    "message",
    [
        String(data=None),  # type: ignore[arg-type]
        String(data=b"hi"),  # type: ignore[arg-type]
        Bool(data=1),  # type: ignore[arg-type]
        Byte(data=b""),
        Byte(data=b"ab"),
        Byte(data=1),  # type: ignore[arg-type]
        Float32(data=True),
        Float32(data="1.0"),  # type: ignore[arg-type]
        Float32(data=2**64),
        Int8(data=128),
        Int8(data=-129),
        Int8(data=True),
        Int8(data=1.0),  # type: ignore[arg-type]
        UInt8(data=-1),
        UInt64(data=-1),
        UInt64(data=2**64),
        Twist(linear=Point()),  # type: ignore[arg-type]
        Twist(linear=Vector3(x=None)),  # type: ignore[arg-type]
        Twist(linear=None),  # type: ignore[arg-type]
        Imu(orientation_covariance=[0.0] * 8),
        Imu(orientation_covariance=[0.0] * 10),
        Imu(orientation_covariance=[0.0] * 8 + [False]),
        Imu(orientation_covariance=["x"] * 9),  # type: ignore[list-item]
        Imu(orientation_covariance=[0.0] * 8 + [2**64]),
        Imu(orientation_covariance=None),  # type: ignore[arg-type]
        Image(data="abc"),  # type: ignore[arg-type]
        Image(data=[1, 2, 3]),  # type: ignore[arg-type]
        Image(data=memoryview(bytes(12))[::2]),  # type: ignore[arg-type]
        JointState(name=["a", 5]),  # type: ignore[list-item]
        JointState(name="ab"),  # type: ignore[arg-type]
        JointState(position=[1.0, None]),  # type: ignore[list-item]
        PoseArray(poses=[Pose(), Point()]),  # type: ignore[list-item]
        PoseArray(poses=[[[0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]]),  # type: ignore[list-item]
        PoseArray(poses=[Pose(position=Point(x="1"))]),  # type: ignore[arg-type]
        LaserScan(ranges=[0.5] * 100 + [True]),
        LaserScan(ranges=[0.5] * 100 + ["\u02cb" * 4]),  # type: ignore[list-item]
        OccupancyGrid(data=[128]),
        OccupancyGrid(data=[0] * 100 + [128]),
        OccupancyGrid(data=[0] * 100 + [True]),
        OccupancyGrid(data=[0] * 100 + [0.5]),  # type: ignore[list-item]
        OccupancyGrid(data=[0] * 100 + [""]),  # type: ignore[list-item]
        OccupancyGrid(data=[0] * 100 + [[]]),  # type: ignore[list-item]
    ],
)
def test_what_is_wrong_is_neither_valid_nor_right_after_all(message: Message) -> None:
    support: Any = type_support(type(message))
    assert support.is_valid(message) is False
    assert support.explain(message) is not None


@for_each(
    "message",
    [
        String(data=Text("hi")),
        Int8(data=Number.ONE),
        Float32(data=Scalar(0.5)),
        Int8(data=Whole(5)),
        LaserScan(ranges=array("f", [1.0, 2.0])),  # type: ignore[arg-type]
        OccupancyGrid(data=array("b", [1, -1])),  # type: ignore[arg-type]
        LaserScan(ranges=(1.0, 2.0)),  # type: ignore[arg-type]
        PoseArray(poses=()),  # type: ignore[arg-type]
    ],
)
def test_what_is_unusual_is_right_after_all(message: Message) -> None:
    support: Any = type_support(type(message))
    assert support.is_valid(message) is False
    assert support.explain(message) is None


def test_a_deleted_field_is_not_valid() -> None:
    message = String()
    del message.data
    assert type_support(String).is_valid(message) is False


class Own(Struct):
    """Python types that have their own check."""

    maybe: int | None = None
    colour: Number = Number.ONE
    pair: tuple[int, str] = (1, "a")
    path: tuple[float, ...] = ()
    names: set[str] = field(default_factory=set)
    table: dict[str, list[float]] = field(default_factory=dict)
    deep: list[list[uint8]] = field(default_factory=list)
    limited: Annotated[int, Meta(gt=0, lt=10)] = 5
    few: Annotated[list[bool], Meta(max_length=2)] = field(default_factory=list)
    key: Annotated[bytes, Meta(min_length=2)] = b"ab"
    point: Point | None = None


@for_each(
    ("name", "right", "wrong"),
    [
        ("maybe", [1, None], ["1", 1.5, True]),
        ("colour", [Number.ONE], [2, "ONE"]),
        ("pair", [(2, "b")], [(1,), (1, 2), ("a", 1), 5]),
        ("path", [(), (1.0, 2)], [("a",), (True,), 5]),
        ("names", [{"a"}], [{1}, "a"]),
        ("table", [{"a": [1.0]}], [{1: [1.0]}, {"a": ["x"]}, {"a": 1.0}, []]),
        ("deep", [[[1], []], [[0] * 50]], [[[256]], [1], [[-1] * 50]]),
        ("limited", [1, 9], [0, 10]),
        ("few", [[], [True, False]], [[True] * 3, [1]]),
        ("key", [b"abc"], [b"a", "ab"]),
        ("point", [None, Point()], [Vector3, 5, Point(x="a")]),  # type: ignore[arg-type]
    ],
)
def test_own_types(name: str, right: list[Any], wrong: list[Any]) -> None:
    support = type_support(Own)
    assert support.is_valid(Own())
    for value in right:
        assert support.is_valid(msgspec.structs.replace(Own(), **{name: value})), value
    for value in wrong:
        message = msgspec.structs.replace(Own(), **{name: value})
        assert not support.is_valid(message), value
        assert support.explain(message) is not None, value


@for_each(
    ("annotation", "value"),
    [
        (int | str, 1),
        (Any, 1),
        (Literal["a"], "a"),
        (Annotated[str, Meta(max_length=3)], "a"),
        (Annotated[float, Meta(ge=0)], 0.5),
        (Annotated[int, Meta(multiple_of=2)], 2),
        (Annotated[dict[str, int], Meta(max_length=3)], {}),
    ],
)
def test_for_the_rest_there_is_no_code(annotation: Any, value: Any) -> None:
    cls: Any = msgspec.defstruct("Rest", [("x", annotation)])
    assert predicate(cls)(cls(value)) is False
    assert type_support(cls).explain(cls(value)) is None


def test_for_a_type_in_itself_there_is_no_code() -> None:
    class Tree(Struct):
        children: list["Tree"] = field(default_factory=list)

    # The check looks this name up when it reads the type.
    globals()["Tree"] = Tree
    assert predicate(Tree)(Tree()) is False


def test_too_large_a_type_gets_no_code() -> None:
    small: Any = msgspec.defstruct("Small", [("a", int)])
    assert predicate(small)(small(1)) is True
    cls, message = small, small(1)
    for level in range(12):
        cls = msgspec.defstruct(f"Level{level}", [("a", cls), ("b", cls)])
        message = cls(message, message)
    assert predicate(cls)(message) is False
    assert type_support(cls).explain(message) is None


def test_no_code_is_made_from_a_foreign_schema() -> None:
    foreign: Any = build(describe(Point))
    around = msgspec.defstruct("Around", [("point", foreign)])
    for cls, message in ((foreign, foreign()), (around, around(foreign()))):
        assert predicate(cls)(message) is False
        assert type_support(cls).explain(message) is None


garbage = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=5)
    | st.binary(max_size=5)
    | st.builds(Point)
    | st.builds(Vector3, x=st.integers() | st.booleans()),
    lambda inner: st.lists(inner, max_size=20) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=20,
)
numbers = st.lists(st.integers() | st.floats() | st.booleans() | st.integers(-200, 300), max_size=40)
bytes_like = st.text(st.sampled_from("\u02cb\x01a"), max_size=9) | st.floats()


class Everything(Message, kw_only=True):
    text: str = ""
    flag: bool = False
    small: int8 = 0
    medium: uint16 = 0
    large: uint64 = 0
    ratio: float64 = 0.0
    blob: bytes = b""
    ratios: list[float64] = field(default_factory=list)
    fixed: Annotated[list[float64], Meta(min_length=3, max_length=3)] = field(
        default_factory=lambda: [0.0] * 3
    )
    smalls: list[int8] = field(default_factory=list)
    counts: list[uint8] = field(default_factory=list)
    larges: list[uint64] = field(default_factory=list)
    flags: list[bool] = field(default_factory=list)
    points: list[Point] = field(default_factory=list)
    table: dict[str, int8] = field(default_factory=dict)


@given(
    changes=st.dictionaries(
        st.sampled_from(Everything.__struct_fields__), garbage | numbers | st.lists(bytes_like, max_size=20)
    )
)
def test_a_message_that_passes_is_right(changes: dict[str, Any]) -> None:
    support = type_support(Everything)
    message = Everything(**changes)
    if support.is_valid(message):
        support.decode(support.encode(message))
    elif support.explain(message) is None:
        # The check may be uncertain only if a value has another Python type and the same encoding.
        assert any(type(value) is not type(getattr(Everything(), name)) for name, value in changes.items())
