"""Plans against the check and msgspec's encoder: the same bytes, or none if those refuse."""

import enum
import gc
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Annotated, Any, Generic, TypeVar

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import Meta, Struct

from bus import msg, shm, srv
from bus.errors import MessageTypeError
from bus.msg import Message, float32, int8, uint16, uint64
from bus.msg.geometry_msgs import Point, PoseStamped, Vector3
from bus.msg.nav_msgs import OccupancyGrid
from bus.msg.sensor_msgs import Image, JointState, LaserScan
from bus.msg.std_msgs import Float64, Header, String, UInt64
from bus.types.large_fields import bytes_fields, encode_around, with_field
from bus.types.schema import build, describe, type_name
from bus.types.support import find_type, type_support
from effort import examples
from rows import for_each
from shm_ends import Talker, core, talker

__all__ = ["talker"]

pytestmark = pytest.mark.skipif(not shm.has_core(), reason="BUS_NATIVE=no")


def ready_made() -> list[type[Message]]:
    classes: list[type[Message]] = []
    for package in msg.PACKAGES:
        module = import_module(f"bus.msg.{package}")
        classes += [getattr(module, name) for name in module.__all__]
    for package in srv.PACKAGES:
        module = import_module(f"bus.srv.{package}")
        for name in module.__all__:
            service = getattr(module, name)
            classes += [service.Request, service.Response]
    return classes


CLASSES = ready_made()


class Text(str):
    pass


class Whole(int):
    pass


class Real(float):
    pass


class Number(enum.IntEnum):
    ONE = 1


class Longer(Vector3, kw_only=True):
    """A subclass of Vector3."""

    w: float = 0.0


BOUNDS = sorted(
    {
        sign * 2**bits + off
        for bits in (0, 5, 7, 8, 15, 16, 31, 32, 63, 64)
        for sign in (1, -1)
        for off in (-1, 0, 1)
    }
)
COUNTS = (0, 1, 9, 12, 15, 16, 36, 300)
LENGTHS = (0, 1, 31, 32, 255, 256, 4095, 65_535, 65_536)
texts = st.one_of(
    st.text(max_size=40),
    st.builds(lambda char, size: char * size, st.sampled_from("xé€😀"), st.sampled_from(LENGTHS)),
)
numbers = st.sampled_from(BOUNDS) | st.integers()
reals = st.floats() | st.sampled_from([0.0, -0.0, float("nan"), float("inf"), float("-inf"), 5e-324])
anything = st.one_of(
    texts,
    numbers,
    reals,
    st.booleans(),
    st.none(),
    st.binary(max_size=3),
    st.sampled_from(["\ud800", "a\udfffb", Text("hi"), Whole(5), Real(0.5), Number.ONE, [], [1.0], {}, (1,)]),
    st.builds(Vector3),
    st.builds(Point, x=numbers),
    st.builds(Longer),
    st.builds(Header),
    st.sampled_from([Vector3, String, msgspec.UNSET]),
)


def fitting(value: object) -> st.SearchStrategy[Any]:
    """Values of the type of `value`, many at the limits of its field."""
    match value:
        case bool():
            return st.booleans()
        case int():
            return numbers
        case float():
            return reals | numbers
        case str():
            return texts
        case bytes():
            return st.binary(max_size=3) | st.builds(bytes, st.sampled_from(LENGTHS))
    return st.just(value)


def lists(cls: type[Struct], name: str) -> st.SearchStrategy[list[Any]]:
    """Valid contents for a list field, and slightly too long ones."""
    items = st.one_of(
        reals | numbers,
        numbers,
        texts,
        st.binary(max_size=2),
        st.booleans(),
        st.sampled_from(CLASSES).map(lambda cls: cls()),
        st.builds(Point, x=reals),
    )
    schema = describe(cls)
    (node,) = (field["type"] for field in schema["types"][schema["root"]]["fields"] if field["name"] == name)
    match node:
        case ["list", "float32" | "float64", *_]:
            items = reals | numbers
        case ["list", "string"]:
            items = texts
        case ["list", str() as item, *_] if "int" in item:
            items = numbers
        case ["list", str() as item, *_] if "/" in item and (inner := find_type(item)):
            items = st.just(inner())
    return st.lists(items, max_size=20) | st.builds(
        lambda item, size: [item] * size, items, st.sampled_from(COUNTS)
    )


def change(data: st.DataObject, message: Struct) -> None:
    """Change some of the fields, at any depth."""
    for name in message.__struct_fields__:
        value = getattr(message, name)
        choice = data.draw(st.integers(0, 9))
        if choice == 0:
            setattr(message, name, data.draw(anything))
        elif choice == 1:
            delattr(message, name)
        elif isinstance(value, Struct):
            change(data, value)
        elif isinstance(value, list) and choice > 4:
            setattr(message, name, data.draw(lists(type(message), name)))
        elif choice > 4:
            setattr(message, name, data.draw(fitting(value)))


def same_as_the_long_way(message: Struct, *, is_complete: bool = True) -> None:
    support = type_support(type(message))
    if support.plan is None:
        return
    planned = support.plan.encode(message)
    try:
        expected = support.encode_checked(message)
    except MessageTypeError:
        assert planned is None
        return
    if planned is None:
        assert not (is_complete and support.is_valid(message))
    else:
        assert planned == expected
        assert support.is_valid(message)


@pytest.mark.parametrize("cls", CLASSES, ids=type_name)
@settings(max_examples=examples(60))
@given(data=st.data())
def test_the_bytes_of_ready_made_classes(cls: type[Message], data: st.DataObject) -> None:
    message = cls()
    same_as_the_long_way(message)
    change(data, message)
    same_as_the_long_way(message)


WITH_BYTES = [cls for cls in CLASSES if bytes_fields(cls)]


@pytest.mark.parametrize("cls", WITH_BYTES, ids=type_name)
@settings(max_examples=examples(60))
@given(data=st.data())
def test_what_stands_around_a_loan(cls: type[Message], data: st.DataObject) -> None:
    support, talker = type_support(cls), Talker()
    message, name = cls(), data.draw(st.sampled_from(bytes_fields(cls)))
    talker.writer.prepare(*support.steps)
    change(data, message)
    setattr(message, name, b"")
    size = data.draw(st.sampled_from([0, 1, 9, 4096, 60_000]))
    place = talker.lend_field(message, cls.__struct_fields__.index(name), size)
    try:
        support.encode_checked(lent := with_field(message, name, bytes(size)))
        before, after = encode_around(lent, name, size, support.encode)
    except (MessageTypeError, AttributeError):
        assert place is False
    else:
        if place is False:
            assert message != cls()  # there was not enough room for a plan
        else:
            place[:] = b"x" * size
            assert bytes(talker.writer.lent()) == before + b"x" * size + after
    talker.close()


def test_which_ready_made_classes_have_a_plan() -> None:
    planned = {cls for cls in CLASSES if type_support(cls).plan is not None}
    assert planned == set(CLASSES)
    for cls in planned:
        message = cls()
        assert type_support(cls).plan.encode(message) == msgspec.msgpack.encode(message)


@for_each("number", BOUNDS)
def test_numbers_at_every_bound(number: int) -> None:
    same_as_the_long_way(UInt64(data=number))
    same_as_the_long_way(Float64(data=number))
    for bits in (8, 16, 32, 64):
        for sign in ("", "U"):
            cls = getattr(import_module("bus.msg.std_msgs"), f"{sign}Int{bits}")
            same_as_the_long_way(cls(data=number))


@for_each("length", [*LENGTHS, 1 << 20])
@for_each("char", ["x", "é", "€", "😀"])
def test_text_of_every_length(length: int, char: str) -> None:
    message = String(data=char * length)
    assert type_support(String).plan.encode(message) == msgspec.msgpack.encode(message)


@for_each("count", [0, 1, 15, 16, 17, 65_535, 65_536])
@for_each("item", [0.5, 7, -1.0, True, "x", b"", None, 2**64])
def test_lists_of_every_length(count: int, item: Any) -> None:
    lists: tuple[tuple[Any, str], ...] = (
        (LaserScan, "ranges"),
        (OccupancyGrid, "data"),
        (JointState, "name"),
    )
    for cls, name in lists:
        same_as_the_long_way(cls(**{name: [item] * count}))
    same_as_the_long_way(LaserScan(ranges=[0.5] * count + [item]))


@for_each("size", LENGTHS)
def test_bytes_of_every_length(size: int) -> None:
    same_as_the_long_way(Image(data=bytes(size)))
    for data in (bytearray(size), memoryview(bytes(size))):
        same_as_the_long_way(Image(data=data), is_complete=False)  # type: ignore[arg-type]


# --- classes of programs


class Map(Struct):
    name: str = ""
    count: int = 0
    point: Point = msgspec.field(default_factory=Point)


class Renamed(Struct, rename="camel"):
    first_name: str = "a"
    is_long_enough_to_have_a_key_of_more_than_31_bytes: bool = False


class Array(Struct, array_like=True):
    ratio: float32 = 0.5
    small: int8 = -1
    large: uint64 = 2**64 - 1
    between: Annotated[int, Meta(gt=-5, lt=5)] = 0


class Frozen(Struct, frozen=True):
    name: str = "x"


class Empty(Struct):
    pass


class Derived(Map):
    ratio: float = 0.0


class Redefined(Map):
    count: uint16 = 7


class Around(Struct):
    array: Array = msgspec.field(default_factory=Array)
    derived: Derived = msgspec.field(default_factory=Derived)


class Forward(Struct):
    later: "Later"


class Later(Struct):
    name: str = "x"


T = TypeVar("T")


class Holder(Struct, Generic[T]):
    value: T


class Lists(Struct):
    """Lists that a plan supports, and bytes; some of a bounded length."""

    texts: list[str] = msgspec.field(default_factory=lambda: ["", "é" * 20])
    blob: bytes = b"abc"
    key: Annotated[bytes, Meta(min_length=1, max_length=2)] = b"k"
    few: Annotated[list[uint16], Meta(max_length=3)] = msgspec.field(default_factory=lambda: [1, 65_535])
    many: Annotated[list[bool], Meta(min_length=2)] = msgspec.field(default_factory=lambda: [True, False])
    deep: list[list[list[float]]] = msgspec.field(default_factory=lambda: [[], [[0.5, 1], []]])
    points: list[Point] = msgspec.field(default_factory=lambda: [Point(), Point(x=1.0)])


class Number8(Struct):
    """Annotations that do not change the plan."""

    number: Annotated[int8, Meta(description="of what")] = 1


Many: Any = msgspec.defstruct("Many", [(f"field{number}", int, number) for number in range(300)])
ManyInARow: Any = msgspec.defstruct("ManyInARow", [(f"f{n}", int, n) for n in range(300)], array_like=True)

OWN: list[Callable[[], Struct]] = [
    Map,
    Renamed,
    Array,
    Frozen,
    Empty,
    Derived,
    Redefined,
    Around,
    lambda: Forward(Later()),
    Number8,
    Lists,
    Many,
    ManyInARow,
]


@pytest.mark.parametrize("make", OWN)
@settings(max_examples=examples(60))
@given(data=st.data())
def test_the_bytes_of_users_classes(make: Callable[[], Struct], data: st.DataObject) -> None:
    message = make()
    assert type_support(type(message)).plan.encode(message) == msgspec.msgpack.encode(message)
    if not message.__struct_config__.frozen and len(message.__struct_fields__) < 20:
        change(data, message)
        same_as_the_long_way(message)


class Tagged(Struct, tag="t"):
    name: str = ""


class TaggedInARow(Struct, tag=5, array_like=True):
    name: str = ""


class Omitting(Struct, omit_defaults=True):
    name: str = ""


class Property(Map):
    pass


Property.count = property(lambda self: 5)  # type: ignore[assignment]


@for_each(
    "cls",
    [
        Tagged,
        TaggedInARow,
        Omitting,
        msgspec.defstruct("HasTagged", [("inner", Tagged)]),
        msgspec.defstruct("HasOmitting", [("inner", Omitting)]),
        Property,
        build(describe(Point)),
        msgspec.defstruct("HasForeign", [("inner", build(describe(Point)))]),
        msgspec.defstruct("HasHolder", [("inner", Holder[int])]),
        *(
            msgspec.defstruct("Other", [("value", kind)])
            for kind in (
                Any,
                int | None,
                int | str,
                Number,
                bytearray,
                set[int],
                tuple[int, ...],
                list[int | None],
                list[Tagged],
                dict[str, int],
                Annotated[str, Meta(max_length=3)],
                Annotated[str, Meta(pattern="a")],
                Annotated[float, Meta(ge=0)],
                Annotated[int, Meta(multiple_of=2)],
            )
        ),
    ],
)
def test_other_classes_have_none(cls: Any) -> None:
    assert type_support(cls).plan is None


def test_what_is_left_out_goes_the_long_way() -> None:
    class Sparse(Struct):
        name: str = "x"
        count: int | msgspec.UnsetType = msgspec.UNSET

    assert type_support(Sparse).plan.encode(Sparse()) is None
    same_as_the_long_way(Sparse(count=5))


def test_a_class_in_itself_has_none() -> None:
    class Tree(Struct):
        child: "Tree | None" = None

    globals()["Tree"] = Tree  # looked up by name when the type is read
    assert type_support(Tree).plan is None


def test_many_levels_share_what_is_the_same() -> None:
    cls: Any = msgspec.defstruct("Leaf", [("a", int, 1)])
    for level in range(60):  # as a tree it would have 2**60 leaves
        cls = msgspec.defstruct(f"Level{level}", [("a", cls), ("b", cls)])
    message = cls(None, None)
    assert type_support(cls).plan.encode(message) is None


def test_without_the_native_core_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUS_NATIVE", "no")
    assert type_support(msgspec.defstruct("Plain", [("a", int)])).plan is None


# --- the object


def test_what_makes_no_plan() -> None:
    slot = Point.x
    right = (core.AS_FLOAT, 0, 0, None)
    with pytest.raises(TypeError):
        core.Plan(5, (), True)
    for value, error in (
        ((0, 0, 0, None), ValueError),
        ((8, 0, 0, None), ValueError),
        ((core.AS_STRUCT, 0, 0, None), ValueError),
        ((core.AS_INT, 0, -1, None), OverflowError),
        ((core.AS_INT, 2**63, 0, None), OverflowError),
        ((core.AS_LIST, 0, 0, None), TypeError),
        ((core.AS_LIST, 0, 0, (core.AS_LIST, 0, 0, (9, 0, 0, None))), ValueError),
        ((core.AS_LIST, 0, 0, (core.AS_STRUCT, 0, 0, 5)), ValueError),
        ((), TypeError),
        (5, TypeError),
    ):
        with pytest.raises(error):
            core.Plan(Point, ((slot, b"", right), (slot, b"", value)), True)
    for field in ((slot, "", right), (5, b"", right), (slot, b""), 5):
        with pytest.raises(TypeError):
            core.Plan(Point, ((slot, b"", right), field), True)
    with pytest.raises(ValueError, match="too many"):
        core.Plan(Point, ((slot, b"", right),) * 65_536, True)


def test_a_slot_of_another_class_is_not_read() -> None:
    wrong = core.Plan(Point, ((String.data, b"", (core.AS_TEXT, 0, 0, None)),), True)
    assert wrong.encode(Point()) is None


def test_nothing_leaks() -> None:
    support = type_support(PoseStamped)
    right, wrong = PoseStamped(), PoseStamped(header=Header(frame_id="\ud800"))
    del wrong.pose.position.x
    long = String(data="é" * 10_000)
    watched: list[object] = [
        PoseStamped,
        Header,
        right.header,
        right.header.frame_id,
        wrong.header,
        long.data,
    ]

    def use() -> None:
        for _ in range(1000):
            core.Plan(Point, ((Point.x, b"", (core.AS_FLOAT, 0, 0, None)),), True).encode(Point())
            support.plan.encode(right)
            support.plan.encode(wrong)
            type_support(String).plan.encode(long)

    use()
    gc.collect()
    before = [sys.getrefcount(one) for one in watched], sys.getallocatedblocks()
    use()
    gc.collect()
    after = [sys.getrefcount(one) for one in watched], sys.getallocatedblocks()
    assert after[0] == before[0]
    assert abs(after[1] - before[1]) < 100


# --- the writer


def test_a_writer_publishes_by_plan_what_is_as_planned(talker: Talker) -> None:
    support, asked = type_support(Header), []

    def is_valid(message: Header) -> bool:
        asked.append(message)
        return support.is_valid(message)

    writer = talker.writer
    writer.prepare(Header, is_valid, support.encode, support.plan)
    plain, long, unusual = Header(frame_id="map"), Header(frame_id="é" * 3000), Header(frame_id=Text("map"))
    wrong = Header(frame_id="\ud800")
    sent = [writer.publish(message) for message in (plain, long, unusual, wrong, String(), plain)]
    assert sent == [True, True, False, False, False, True]
    assert asked == [long, unusual, wrong]  # the long one has no room for encoding by a plan
    assert [payload for _, _, payload in writer.since(0)] == [
        support.encode(one) for one in (plain, long, plain)
    ]


def test_a_writer_takes_nothing_else_for_a_plan(talker: Talker) -> None:
    with pytest.raises(TypeError, match="Plan"):
        talker.writer.prepare(Header, bool, bytes, object())
    talker.writer.prepare(Header, bool, bytes, None)


def test_by_plan_only_the_thread_that_made_it_publishes(talker: Talker) -> None:
    from concurrent.futures import ThreadPoolExecutor

    support = type_support(Header)
    talker.writer.prepare(Header, support.is_valid, support.encode, support.plan)
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(talker.writer.publish, Header()).result() == core.WRONG_THREAD
    talker.writer.close()
    with pytest.raises(ValueError, match="closed"):
        talker.writer.publish(Header())
