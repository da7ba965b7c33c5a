"""Messages of rosidl's classes decoded by a plan: for any bytes, the result is the same as msgspec's."""

from collections.abc import Callable
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus import shm
from bus.types.classes import message_class as native_class
from bus_ros.rosidl.classes import message_class
from bus_ros.rosidl.support import support_of
from bus_ros.rosidl.wire import codec
from effort import examples
from shm_ends import core

pytestmark = pytest.mark.skipif(not shm.has_core(), reason="BUS_NATIVE=no")

NAMES = [
    *("std_msgs/msg/" + name for name in ("String", "Bool", "Int8", "UInt8", "Int16", "UInt32", "Int64")),
    *("std_msgs/msg/" + name for name in ("UInt64", "Float32", "Float64", "Header", "ColorRGBA", "Empty")),
    *("geometry_msgs/msg/" + name for name in ("Twist", "PoseStamped", "TransformStamped")),
    "builtin_interfaces/msg/Time",
    "sensor_msgs/msg/Temperature",
]
SLOWLY = {name: codec(message_class(name), native_class(name))[1] for name in NAMES}
scalars = st.none() | st.booleans() | st.floats() | st.text() | st.binary(max_size=9)
scalars |= st.integers(-(2**63), 2**64 - 1)
values = st.recursive(scalars, lambda inner: st.lists(inner, max_size=9), max_leaves=20)
heads = st.binary(min_size=1, max_size=3).map(lambda head: bytes(byte | 0x80 for byte in head))


def support(name: str) -> Any:
    cls: Any = message_class(name)
    return support_of(cls)


def outcome(decode: Callable[[Any], Any], payload: Any) -> tuple[Any, ...]:
    try:
        message = decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        return type(error), str(error)
    return type(message), repr(message), deep_types(message)


def deep_types(value: Any) -> Any:
    slots = getattr(type(value), "__slots__", ())
    return type(value), [deep_types(getattr(value, slot)) for slot in slots]


@st.composite
def payloads(draw: st.DrawFn, name: str) -> bytes:
    """Payloads: mostly valid or nearly valid, a few arbitrary."""
    if draw(st.integers(0, 4)) == 0:
        return msgspec.msgpack.encode(draw(values))
    numbers = st.floats() | st.integers(-300, 70_000) | st.integers(-(2**63), 2**64 - 1)

    def fill(plain: Any) -> Any:
        if isinstance(plain, list):
            return [fill(one) for one in plain]
        if isinstance(plain, bool):
            return draw(st.booleans())
        if isinstance(plain, float):
            return draw(st.floats())
        return draw(st.text(max_size=300) if isinstance(plain, str) else numbers)

    plain = msgspec.msgpack.decode(support(name).encode(message_class(name)()))
    payload = bytearray(msgspec.msgpack.encode(fill(plain)))
    if draw(st.booleans()):
        begin = draw(st.integers(0, len(payload)))
        payload[begin : begin + draw(st.integers(0, 3))] = draw(st.just(b"") | st.binary(max_size=3) | heads)
    return bytes(payload)


@pytest.mark.parametrize("name", NAMES)
def test_a_message_is_what_msgspec_makes_of_it(name: str) -> None:
    quick = support(name).decode
    assert quick.__self__.__class__ is core.Plan

    @settings(max_examples=examples(300))
    @given(payloads(name))
    def check(payload: bytes) -> None:
        assert outcome(quick, payload) == outcome(SLOWLY[name], payload)
        assert outcome(quick, memoryview(payload)) == outcome(quick, payload)

    check()


@pytest.mark.parametrize(
    "payload",
    [
        *(bytes([0x91, *number]) for number in ((0x7F,), (0xFF,), (0xCC, 0x80), (0xCD, 0xFF, 0xFF))),
        b"\x91\xcf" + b"\xff" * 8,
        b"\x91\xd0\x80",
        b"\x91\xd1\x80\x00",
        b"\x91\xd2\x80\x00\x00\x00",
        b"\x91\xd3\x80" + bytes(7),
        b"\x91\xd3\x7f" + b"\xff" * 7,
        b"\xdc\x00\x01\x05",
        b"\x92\x05\x06",
        b"\x91",
        b"",
        b"\x91\x05\x00",
        b"\x91\xcd\x01",
    ],
)
@pytest.mark.parametrize("name", [f"std_msgs/msg/{kind}" for kind in ("Int8", "UInt16", "Int64", "UInt64")])
def test_numbers_of_all_lengths(name: str, payload: bytes) -> None:
    quick = support(name).decode
    slowly = codec(message_class(name), native_class(name))[1]
    assert outcome(quick, payload) == outcome(slowly, payload)


def test_it_does_the_most_by_itself() -> None:
    string = support("std_msgs/msg/String")
    plan: Any = string.plan
    before, plan.decode_slowly = plan.decode_slowly, None
    try:
        assert plan.decode(string.encode(string.cls(data="é" * 400))).data == "é" * 400
        with pytest.raises(TypeError, match="not callable"):
            plan.decode(b"\x91\x01")
    finally:
        plan.decode_slowly = before


def test_a_plan_of_structs_does_not_decode() -> None:
    plan: Any = core.Plan(Slotted, ((vars(Slotted)["x"], b"", (core.AS_INT, 0, 9, None)),), True)
    with pytest.raises(TypeError, match="does not decode"):
        plan.decode(b"\x91\x01")


class Slotted:
    __slots__ = ("x",)
