"""Codecs: messages from other encoders, long fields, and errors."""

import struct
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec import Struct

import bus
from bus.errors import ConfigurationError
from bus.msg.builtin_interfaces import Time
from bus.msg.sensor_msgs import Image
from bus.msg.std_msgs import Float64, Float64MultiArray, Header, String, UInt8
from bus.types.classes import message_class
from bus.types.definitions import names
from bus_ros.cdr import CdrError, Codec, codec_of, schema_of_definition
from daily_types import daily_part
from payloads import payload
from rows import for_each

HEAD = bytes((0, 1, 0, 0))
JAZZY = Path(__file__).parents[3] / "golden" / "cdr_jazzy.txt"


def codec(cls: type[Struct]) -> Codec:
    return codec_of(bus.MessageSchema.of(cls))


def pack(message: Any) -> bytes:
    return msgspec.msgpack.encode(message)


def test_a_codec_is_made_once_for_a_type() -> None:
    assert codec(String) is codec(String)
    assert codec(String) is not codec(Header)


PARTS = [
    *(f"{name}_Event" for name in names("srv")),
    *(f"{name}_{part}" for name in names("action") for part in ("SendGoal_Request", "FeedbackMessage")),
]
"""The other parts of services and actions are fields of these."""


@for_each("name", partial(daily_part, PARTS))
def test_parts_of_services_and_actions_come_back(name: str) -> None:
    schema = bus.MessageSchema.of(message_class(name))
    made = codec_of(schema)
    parsed = schema_of_definition(name, made.definition)
    assert (made.type_name, made.type_hash, parsed.type_hash) == (name, schema.type_hash, schema.type_hash)
    sent = payload(schema.description, 1)
    assert made.decode(b"".join(made.encode(sent))) == sent


# Long fields.


def test_many_at_once_are_as_one_by_one() -> None:
    codec = codec_of(bus.MessageSchema.of(Image))
    payloads = [
        msgspec.msgpack.encode(Image(header=Header(frame_id=name), data=bytes(size)))
        for name, size in (("a", 3), ("four", 0), ("long", 20 << 10))
    ]
    assert codec.encode_many(payloads) == [b"".join(codec.encode(payload)) for payload in payloads]
    with pytest.raises(CdrError, match="sensor_msgs/msg/Image"):
        codec.encode_many([*payloads, b"\xc1"])


def test_a_long_field_of_bytes_is_a_view_of_the_payload() -> None:
    image = Image(
        header=Header(frame_id="camera"), height=480, width=640, encoding="rgb8", data=bytes(921600)
    )
    payload = pack(image)
    before, data, *after = codec(Image).encode(payload)
    assert isinstance(data, memoryview)
    assert data.obj is payload and data.nbytes == 921600
    assert len(before) < 100 and after == []
    assert codec(Image).decode(b"".join((before, data))) == payload


def test_long_texts_are_views_of_the_payload() -> None:
    class Texts(Struct):
        texts: list[str]
        by_name: dict[str, str]
        perhaps: str | None = None

    for text in ("short", "x" * 300, "x" * 20_000, "x" * 70_000):
        payload = bytearray(pack(Texts([text, "", text], {"a": text}, text)))
        parts = codec(Texts).encode(payload)
        assert codec(Texts).decode(b"".join(parts)) == payload
        long = [part for part in parts if isinstance(part, memoryview)]
        assert len(long) == (3 if len(text) > 16384 else 0)
        payload[:] = payload.replace(b"xxx", b"yyy")
        assert {bytes(part[:3]) for part in long} <= {b"yyy"}


def test_long_lists_of_numbers_come_as_they_went() -> None:
    payload = pack(Float64MultiArray(data=[float(number) for number in range(100_000)]))
    assert codec(Float64MultiArray).decode(b"".join(codec(Float64MultiArray).encode(payload))) == payload


# Messages from other encoders.

OUTER = """\
uint8 small
float64 big
t/Inner inner
string[] names
t/Inner[] inners
float64[] numbers
uint16[3] fixed
t/Inner[2] two
t/Inner[] none
float64[<=1] maybe
uint8[] raw
int32 last
================================================================================
MSG: t/Inner
uint8 flag
float64 at
string name
"""
VALUES = [
    *(1, 2.5, [2, 3.5, "abc"], ["x", "yz"], [[4, 5.5, ""], [5, 6.5, "q"]], [1.5, 2.5], [1, 2, 3]),
    *([[6, 7.5, "r"], [7, 8.5, "ss"]], [], [9.5], bytes((1, 2, 3)), -1),
]
OF_CYCLONE = (
    """
    00070000010000000000000000000440020000000000000000000c400400000061626300130000000200000002000000
    7800000003000000797a0000260000000200000004000000000000000000164001000000000500000000000000001a40
    020000007100000002000000000000000000f83f00000000000004400100020003000000230000000600000000000000
    00001e400200000072000700000000000000214003000000737300000400000000000000010000000000000000002340
    0300000001020300ffffffff
    """,
    """
    0006000001000000400400000000000002000000400c0000000000000000000461626300000000130000000200000002
    7800000000000003797a000000000026000000020400000040160000000000000000000100050000401a000000000000
    0000000271000000000000023ff8000000000000400400000000000000010002000300000000002306000000401e0000
    000000000000000272000700402100000000000000000003737300000000000400000000000000014023000000000000
    0000000301020300ffffffff
    """,
    """
    00090000e400000001000000000000000000044014000000020000000000000000000c40040000006162630013000000
    02000000020000007800000003000000797a000032000000020000001100000004000000000000000000164001000000
    0000000012000000050000000000000000001a40020000007100000002000000000000000000f83f0000000000000440
    01000200030000002f00000012000000060000000000000000001e400200000072000000130000000700000000000000
    00002140030000007373000004000000000000000100000000000000000023400300000001020300ffffffff
    """,
    """
    00080000000000e40100000040040000000000000000001402000000400c000000000000000000046162630000000013
    00000002000000027800000000000003797a000000000032000000020000001104000000401600000000000000000001
    000000000000001205000000401a0000000000000000000271000000000000023ff80000000000004004000000000000
    00010002000300000000002f0000001206000000401e0000000000000000000272000000000000130700000040210000
    00000000000000037373000000000004000000000000000140230000000000000000000301020300ffffffff
    """,
    """
    00000000010000000000000040040000000000000200000000000000400c000000000000000000046162630000000002
    000000027800000000000003797a000000000002040000000000000040160000000000000000000100050000401a0000
    00000000000000027100000000000002000000003ff800000000000040040000000000000001000200030600401e0000
    000000000000000272000700402100000000000000000003737300000000000000000001402300000000000000000003
    01020300ffffffff
    """,
)
"""VALUES as Cyclone DDS encodes them: XCDR2, plain and delimited, and XCDR1, in both byte orders."""


@for_each("encoded", OF_CYCLONE)
def test_every_representation_is_understood(encoded: str) -> None:
    outer = codec_of(schema_of_definition("t/msg/Outer", OUTER))
    assert outer.decode(bytes.fromhex(encoded)) == pack(VALUES)


@for_each(("name", "sent", "serialized"), [line.split() for line in JAZZY.read_text().splitlines()[1:]])
def test_what_ros_itself_serializes_is_understood(name: str, sent: str, serialized: str) -> None:
    """ROS 2 leaves old memory in the padding, and sometimes bytes behind the message."""
    made = codec(message_class(name))
    assert made.decode(bytes.fromhex(serialized)).hex() == sent
    assert len(b"".join(made.encode(bytes.fromhex(sent)))) <= len(bytes.fromhex(serialized))


def test_what_a_newer_type_has_behind_our_fields_is_passed_over() -> None:
    # 16 bytes. The inner message has 8 of them behind its length, and our type has 4 of these.
    delimited = bytes((0, 9, 0, 0)) + struct.pack("<IIIII", 16, 8, 7, 99, 5)
    nested = f"demo/Inner x\nuint32 y\n{'=' * 80}\nMSG: demo/Inner\nuint32 z"
    assert codec(bus_type(nested)).decode(delimited) == pack([[7], 5])


def bus_type(definition: str) -> type[Struct]:
    return schema_of_definition("demo/msg/Probe", definition + "\n").to_class()


@for_each("behind", (b"", b"\0", bytes(3), b"\xaa" * 32))
def test_what_is_behind_the_last_field_is_not_looked_at(behind: bytes) -> None:
    """The bytes are padding, or the rest that ROS 2's serialize_message leaves there."""
    assert codec(UInt8).decode(HEAD + b"\x05" + behind) == pack(UInt8(data=5))


@for_each(
    ("data", "text"),
    [
        (struct.pack("<I", 3) + b"hi\0", "hi"),
        (struct.pack("<I", 2) + b"hi", "hi"),  # without the zero at its end
        (struct.pack("<I", 1) + b"\0", ""),
        (struct.pack("<I", 0), ""),
        (struct.pack("<I", 4) + b"a\xffb\0", "a\ufffdb"),  # not UTF-8
    ],
)
def test_texts_are_taken_as_ros_takes_them(data: bytes, text: str) -> None:
    assert codec(String).decode(HEAD + data) == pack(String(data=text))


def test_whatever_holds_bytes_is_taken() -> None:
    payload = pack(String(data="hello"))
    (part,) = codec(String).encode(memoryview(payload))
    assert bytes(part) == bytes(codec(String).encode(bytearray(payload))[0])
    for data in (bytes(part), bytearray(part), memoryview(part)):
        assert codec(String).decode(data) == payload


# Numbers.


def test_a_float_may_be_an_int_in_a_payload() -> None:
    assert codec(Float64).decode(codec(Float64).encode(pack([3]))[0]) == pack([3.0])


@for_each(
    ("cls", "value"), [(UInt8, -1), (UInt8, 256), (Time, 2**31), (UInt8, "1"), (Float64, "1"), (String, 5)]
)
def test_a_value_that_cdr_cannot_hold_is_refused(cls: type[Struct], value: Any) -> None:
    values = [value, 0] if cls is Time else [value]
    with pytest.raises(CdrError, match=f"no payload of .*/{cls.__name__}"):
        codec(cls).encode(pack(values))


# Missing fields.


def test_fields_that_were_left_out_have_their_defaults() -> None:
    class Settings(Struct, omit_defaults=True, tag="settings"):
        limit: int = 5
        names: list[str] = msgspec.field(default_factory=lambda: ["a"])
        stamp: Time = msgspec.field(default_factory=Time)
        needed: bool | None = None

    sent = codec(Settings).encode(pack(Settings()))[0]
    assert msgspec.msgpack.decode(codec(Settings).decode(sent)) == {
        "type": "settings",
        "limit": 5,
        "names": ["a"],
        "stamp": [0, 0],
        "needed": None,
    }
    assert msgspec.msgpack.decode(codec(Settings).decode(sent), type=Settings) == Settings()


# Errors.

HUGE = struct.pack("<I", 2**32 - 1)


@for_each(
    ("definition", "data"),
    [
        ("string x", HUGE),
        ("uint8[] x", HUGE + bytes(100)),
        ("float64[] x", HUGE + bytes(100)),
        ("float64[<=3] x", struct.pack("<II", 4, 0) + bytes(32)),
        ("string[] x", HUGE + bytes(100)),
        ("demo/Empty[] x\n" + "=" * 80 + "\nMSG: demo/Empty", HUGE + bytes(100)),
        ("float64[100] x", bytes(799)),
        ("uint8[100] x", bytes(99)),
        ("bool x", b""),
    ],
)
def test_what_a_message_does_not_hold_is_not_made_room_for(definition: str, data: bytes) -> None:
    with pytest.raises(CdrError, match="no CDR message of demo/msg/Probe"):
        codec(bus_type(definition)).decode(HEAD + data)


@for_each("data", [b"", b"\0", b"\0\1", b"\0\1\0", b"\0\2\0\0\0", b"\x91\xa2hi", b"\0\x0b\0\0\0"])
def test_what_is_no_cdr_is_refused(data: bytes) -> None:
    with pytest.raises(CdrError, match="no CDR message of std_msgs/msg/UInt8"):
        codec(UInt8).decode(data)


def test_a_wide_string_is_refused_with_type_and_field() -> None:
    schema = schema_of_definition("demo/msg/Wide", "int8 x\nwstring<=5[] texts\n")
    with pytest.raises(ConfigurationError, match="field 'texts' of demo/msg/Wide is a wstring"):
        codec_of(schema)


def test_a_hostile_schema_is_refused() -> None:
    itself = {"root": "a/msg/A", "types": {"a/msg/A": {"fields": [{"name": "x", "type": "a/msg/A"}]}}}
    with pytest.raises(ConfigurationError, match="contains itself"):
        codec_of(bus.MessageSchema("a/msg/A", "", pack(itself)))
    with pytest.raises(ConfigurationError, match="is broken"):
        codec_of(bus.MessageSchema("a/msg/A", "", b"\xc1"))
