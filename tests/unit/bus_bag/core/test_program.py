"""Programs of message types, and the native core that runs them: values at the limits, hostile packs, CRC."""

import math
import os
import struct
import subprocess
import sys
import zlib
from struct import Struct
from typing import Any

import msgspec
import pytest

import bus
from bus.schema import MessageSchema
from bus_bag.core import Program, crc32, program_of
from bus_bag.core.program import operations
from bus_bag.storage.chunk import ChunkBuilder
from bus_ros.cdr import CdrError, Codec, codec_of
from packing import packed
from rows import for_each

if Program is None:
    pytest.skip("BUS_NATIVE=no", allow_module_level=True)

_u32 = Struct("<I").pack
TEXT, EMPTY = b"\x10", b"\x14"


def codec(*nodes: Any, **types: Any) -> Codec:
    """The codec of a message with fields of these types."""
    fields = [{"name": f"f{number}", "type": node} for number, node in enumerate(nodes)]
    described = {"demo/msg/Own": {"array": True, "fields": fields}, **types}
    description = {"root": "demo/msg/Own", "types": described}
    return codec_of(MessageSchema("demo/msg/Own", "", msgspec.msgpack.encode(description)))


def records(of: Codec, *payloads: bytes) -> bytes | None:
    """The records by the native core; None if it refuses them."""
    program = program_of(of.shape)
    assert program is not None
    made = program.records(packed((7, 8, payload) for payload in payloads), 3, 9, 0)
    return None if made is None else bytes(made[0])


def expected(of: Codec, *payloads: bytes) -> bytes | None:
    """The records by Python; None if it refuses them."""
    builder = ChunkBuilder()
    try:
        builder.add_many(3, [(8, 9, 7, 0, 0)] * len(payloads), of.encode_many(payloads))
    except CdrError:
        return None
    chunk = builder.close()
    assert chunk is not None
    return b"".join(chunk.pieces)


class TestTypes:
    def test_what_a_program_is(self) -> None:
        nodes = ("bool", "string", ["bytes", 3, 3], ["list", "int16", 0, 4], "demo/msg/Empty")
        of = codec(*nodes, **{"demo/msg/Empty": {"array": True, "fields": []}})
        parts = (
            b"\x13\x05\x00",
            b"\x00",
            TEXT,
            b"\x11\x01" + _u32(3) + _u32(3),
            b"\x12\x00" + _u32(0) + _u32(4) + _u32(1) + b"\x05",
            EMPTY,
        )
        assert operations(of.shape) == b"".join(parts)

    @for_each(
        "node", [["union", "string", "none"], ["dict", "string", "int"], "any", ["tuple", "int8", "string"]]
    )
    def test_types_without_a_program(self, node: Any) -> None:
        assert program_of(codec(node).shape) is None

    def test_a_message_in_a_map_has_no_program(self) -> None:
        described = {
            "root": "demo/msg/Own",
            "types": {"demo/msg/Own": {"fields": [{"name": "a", "type": "int"}]}},
        }
        schema = MessageSchema("demo/msg/Own", "", msgspec.msgpack.encode(described))
        assert program_of(codec_of(schema).shape) is None

    def test_a_type_that_repeats_others_too_often_has_no_program(self) -> None:
        types: dict[str, Any] = {"demo/msg/T0": {"array": True, "fields": [{"name": "a", "type": "bool"}]}}
        for depth in range(1, 17):
            fields = [{"name": f"f{one}", "type": f"demo/msg/T{depth - 1}"} for one in range(2)]
            types[f"demo/msg/T{depth}"] = {"array": True, "fields": fields}
        assert program_of(codec("demo/msg/T8", **types).shape) is not None
        assert program_of(codec("demo/msg/T16", **types).shape) is None

    @for_each(
        "bad",
        [
            b"",
            b"\x0c",  # no such kind
            b"\x15",
            TEXT + TEXT,
            b"\x13\x00\x00",  # a message without fields
            b"\x13\x02\x00" + TEXT,
            b"\x11\x00" + _u32(0) + _u32(1)[:3],
            b"\x12\x00" + _u32(0) + _u32(1) + _u32(1),
            b"\x12\x00" + _u32(0) + _u32(1) + _u32(2) + TEXT,
            b"\x13\x01\x00" * 64 + TEXT,
        ],
    )
    def test_no_program(self, bad: bytes) -> None:
        with pytest.raises(ValueError, match=f"{len(bad)} bytes are no program"):
            Program(bad)

    def test_the_deepest_program(self) -> None:
        deepest = Program(b"\x13\x01\x00" * 63 + TEXT)
        assert deepest.records(packed([(1, 1, b"\x91" * 63 + b"\xa1x")]), 0, 0, 0) is not None
        assert deepest.records(packed([(1, 1, b"\x91" * 64 + b"\xa1x")]), 0, 0, 0) is None


class TestValues:
    @for_each(
        "kind", ["int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "char", "int"]
    )
    def test_whole_numbers_at_every_limit(self, kind: str) -> None:
        of = codec("bool", kind)
        for bits in (5, 7, 8, 15, 16, 31, 32, 63, 64):
            for value in {2**bits - 1, 2**bits, -(2**bits), -(2**bits) - 1, -(2 ** (bits - 1)), 0}:
                if -(2**63) <= value < 2**64:
                    payload = msgspec.msgpack.encode([True, value])
                    assert records(of, payload) == expected(of, payload), (kind, value)
        for form, code in (
            (">B", 0xCC),
            (">H", 0xCD),
            (">I", 0xCE),
            (">Q", 0xCF),
            (">b", 0xD0),
            (">q", 0xD3),
        ):
            payload = b"\x92\xc3" + bytes([code]) + struct.pack(form, 5)  # longer than needed
            assert records(of, payload) == expected(of, payload) is not None

    @for_each("kind", ["float32", "float64"])
    def test_floats(self, kind: str) -> None:
        of = codec("uint8", kind)
        values = (
            0.0,
            -0.0,
            1.5,
            math.inf,
            -math.inf,
            math.nan,
            3.4028234e38,
            3.4028236e38,
            1e39,
            1e-46,
            5e-324,
        )
        for value in (*values, 0, -1, 2**53 + 1, 2**63 + 1025, 2**64 - 1, -(2**63), 2**24 + 1):
            payload = msgspec.msgpack.encode([1, value])
            assert records(of, payload) == expected(of, payload), (kind, value)
        for bits in (0x3FC00000, 0xFF800000, 0x00000001):
            payload = b"\x92\x01\xca" + bits.to_bytes(4, "big")
            assert records(of, payload) == expected(of, payload) is not None

    def test_a_nan_that_python_may_change_is_left_to_python(self) -> None:
        signaling = b"\x91\xcb\x7f\xf0\x00\x00\x00\x00\x00\x01"
        assert records(codec("float32"), signaling) is None
        assert records(codec("float64"), signaling) == expected(codec("float64"), signaling)
        assert records(codec("float64"), b"\x91\xca\x7f\xc0\x00\x00") is None

    @for_each("size", [0, 1, 31, 32, 33, 255, 256, 5000])
    def test_texts_and_bytes_of_every_head(self, size: int) -> None:
        of = codec("string", ["list", "string"], "uint8[]")
        for text in ("x" * size, "ü" * (size // 2), "x" * (size // 2) + "語🤖"):
            payload = msgspec.msgpack.encode([text, [text, text], text.encode()])
            assert records(of, payload) == expected(of, payload) is not None

    @for_each(
        "text",
        [
            b"\x80",
            b"\xc0\x80",
            b"\xc1\xbf",
            b"\xe0\x9f\xbf",
            b"\xed\xa0\x80",
            b"\xf0\x8f\xbf\xbf",
            b"\xf4\x90\x80\x80",
            b"\xf5\x80\x80\x80",
            b"\xff",
            b"\xc3",
            b"\xe2\x82",
            b"\xf0\x9f\xa4",
            b"\xc3(",
            b"\xe2(\xac",
            b"\xf0\x9f(\x96",
        ],
    )
    def test_no_utf8(self, text: bytes) -> None:
        of = codec("string")
        for before in (b"", b"x" * 31, b"x" * 40, b"\xc3\xbc" * 17):
            whole = before + text
            payload = b"\x91\xd9" + bytes([len(whole)]) + whole
            assert records(of, payload) is None and expected(of, payload) is None

    def test_every_character(self) -> None:
        of = codec("string")
        for first in range(0, 0x110000, 4096):
            chunk = [chr(one) for one in range(first, first + 4096) if not 0xD800 <= one < 0xE000]
            payload = msgspec.msgpack.encode(["".join(chunk)])
            assert records(of, payload) == expected(of, payload)

    def test_bounds(self) -> None:
        of = codec(["list", "int8", 0, 2], ["list", "int8", 2, 2], ["bytes", 0, 2], ["bytes", 2, 2])
        good = [[1], [1, 2], b"a", b"ab"]
        payload = msgspec.msgpack.encode(good)
        assert records(of, payload) == expected(of, payload) is not None
        for index, wrong in ((0, [1, 2, 3]), (1, [1]), (1, [1, 2, 3]), (2, b"abc"), (3, b"a"), (3, b"abc")):
            payload = msgspec.msgpack.encode([*good[:index], wrong, *good[index + 1 :]])
            assert records(of, payload) is None and expected(of, payload) is None


class TestHostilePacks:
    OF = codec(
        "string",
        ["list", "demo/msg/Part"],
        **{
            "demo/msg/Part": {
                "array": True,
                "fields": [{"name": "x", "type": "float64"}, {"name": "b", "type": "byte"}],
            }
        },
    )
    GOOD = msgspec.msgpack.encode(["text", [[1.5, b"a"], [2.5, b"b"]]])

    def test_one_wrong_message_refuses_the_pack(self) -> None:
        assert records(self.OF, self.GOOD, self.GOOD) == expected(self.OF, self.GOOD, self.GOOD)
        for bad in (
            b"",
            b"\xc1",
            self.GOOD[:-1],
            self.GOOD + b"\0",
            b"\x91" * 10_000,
            b"\xdd\xff\xff\xff\xff",
        ):
            assert records(self.OF, self.GOOD, bad, self.GOOD) is None
            assert expected(self.OF, bad) is None

    def test_other_types(self) -> None:
        for value in (
            [],
            ["a"],
            ["a", [], 1],
            {"a": 1},
            [1, []],
            [b"a", []],
            ["a", [[1.5]]],
            ["a", [[True, b"a"]]],
        ):
            payload = msgspec.msgpack.encode(value)
            assert records(self.OF, payload) is None and expected(self.OF, payload) is None

    def test_a_pack_that_is_cut_off(self) -> None:
        program = program_of(self.OF.shape)
        assert program is not None
        whole = packed((1, 1, self.GOOD) for _ in range(3))
        for end in range(len(whole)):
            assert (program.records(whole[:end], 0, 0, 0) is None) == (end % (20 + len(self.GOOD)) != 0)

    def test_counts_that_lie(self) -> None:
        of = codec(["list", "float64"])
        for head in (b"\xdd\xff\xff\xff\xff", b"\xdc\xff\xff", b"\x9f"):
            assert records(of, b"\x91" + head + b"\xcb" + bytes(8)) is None

    def test_messages_that_grow(self) -> None:
        """CDR may need eight times the bytes of MessagePack, and a text of no bytes needs eight."""
        for item, value in (("float64", 0), ("string", "")):
            of = codec(["list", item])
            payload = msgspec.msgpack.encode([[value] * 10_000])
            assert records(of, *[payload] * 3) == expected(of, *[payload] * 3)
            assert records(of, *[payload] * 3, b"") is None  # refused, after the buffer was full
            program = program_of(of.shape)
            assert program is not None and program.messages((payload, b"")) is None
            assert program.messages((payload, payload)) == of.encode_many([payload] * 2)

    def test_wrong_arguments(self) -> None:
        program = Program(TEXT)
        for wrong in (
            (),
            (b"", 1, 2),
            (b"", 1 << 16, 0, 0),
            (b"", -1, 0, 0),
            (b"", 0, -1, 0),
            (1, 1, 1, 1),
            (bytearray(20), 1, 1, 1),
            (memoryview(bytes(20)), 1, 1, 1),
            (b"", "a", 1, 1),
        ):
            with pytest.raises((TypeError, OverflowError)):
                program.records(*wrong)
        for payloads in ([b""], (1,), None):
            with pytest.raises(TypeError):
                program.messages(payloads)  # type: ignore[arg-type]
        with pytest.raises(TypeError):
            Program("text")  # type: ignore[arg-type]


def test_records_of_an_empty_pack() -> None:
    assert Program(TEXT).records(b"", 1, 2, 3) == (bytearray(), b"")


def test_heads_and_index() -> None:
    program = Program(b"\x13\x01\x00" + TEXT)
    made = program.records(
        packed([((1 << 40) + 5, -6, b"\x91\xa1x"), (1 << 63, 1, b"\x91\xa0")]), 65535, 7, 100
    )
    assert made is not None
    data, index = made
    first, second = data[:41], data[41:]
    assert first == struct.pack("<BQHIQq", 5, 32, 65535, 5, 7, -6) + b"\0\1\0\0" + _u32(2) + b"x\0"
    assert second == struct.pack("<BQHIQQ", 5, 31, 65535, 0, 7, 1) + b"\0\1\0\0" + _u32(1) + b"\0"
    assert index == struct.pack("<4Q", 7, 100, 7, 141)


def test_the_crc_is_that_of_zlib() -> None:
    noise = bytes(range(256)) * 300 + b"end"
    for size in (*range(200), 1000, 4095, 4096, 4097, len(noise)):
        for start in (0, 1, 7):
            data = memoryview(noise)[start : start + size]
            for value in (0, 1, 0xFFFFFFFF, 0x12345678):
                assert crc32(data, value) == zlib.crc32(data, value)
    assert crc32(b"") == 0


def test_a_message_of_busd_has_a_program() -> None:
    from bus.msg import PACKAGES

    for package in PACKAGES:
        module = __import__(f"bus.msg.{package}", fromlist=["__all__"])
        for name in module.__all__:
            of = codec_of(bus.MessageSchema.of(getattr(module, name)))
            payload = msgspec.msgpack.encode(getattr(module, name)())
            assert records(of, payload) == expected(of, payload) is not None, name


WITHOUT_CORE = """
import zlib, bus
from bus.msg.std_msgs import String
from bus_bag.core import Program, crc32, program_of
from bus_ros.cdr import codec_of
print(Program, program_of(codec_of(bus.MessageSchema.of(String)).shape), crc32 is zlib.crc32)
"""


def test_without_the_core() -> None:
    """There are no programs then, and the CRC is zlib's."""
    environ = {**os.environ, "BUS_NATIVE": "no", "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_CORE], env=environ, capture_output=True, text=True, check=True
    )
    assert done.stdout == "None None True\n"
