"""Parameter lists, and the values in them."""

import struct

import pytest

from bus_bridge.rtps.parameters import (
    FOREVER_NS,
    RtpsError,
    read_addresses,
    read_duration_ns,
    read_number,
    read_octets,
    read_parameters,
    read_properties,
    read_text,
    read_texts,
    write_address,
    write_duration,
    write_number,
    write_octets,
    write_parameters,
    write_properties,
    write_text,
)
from rows import for_each

END = struct.pack("<HH", 1, 0)


def test_a_list_and_what_follows_it() -> None:
    data = b"head" + write_parameters([(5, b"abc"), (7, b""), (5, b"defg")]) + b"tail"
    found, end = read_parameters(data, "<", 4)
    assert found == {5: [b"abc\0", b"defg"], 7: [b""]}
    assert data[end:] == b"tail"


def test_big_endian_and_padding() -> None:
    data = struct.pack(">HH4sHH4sHH", 0, 4, b"pad.", 0x83, 4, b"abcd", 1, 0)
    assert read_parameters(data, ">").parameters == {0x83: [b"abcd"]}


@for_each(
    "data, text",
    [
        (b"", "without its end"),
        (struct.pack("<HH", 5, 4) + b"abcd", "without its end"),
        (struct.pack("<HH", 5, 3) + b"abc" + END, "a parameter of 3 bytes"),
        (struct.pack("<HH", 5, 0xFFFC) + END, "a parameter of 65532 bytes, with 4 bytes left"),
        (struct.pack("<HH", 5, 0) * 257 + END, "more than 256 parameters"),
    ],
)
def test_a_broken_list(data: bytes, text: str) -> None:
    with pytest.raises(RtpsError, match=text):
        read_parameters(data, "<")


def test_texts_and_octets() -> None:
    assert read_text(write_text("grüß"), "<") == "grüß"
    assert read_text(struct.pack(">I", 3) + b"ab\0", ">") == "ab"
    assert read_octets(write_octets(b"\0\1\2") + b"more", "<") == b"\0\1\2"
    one = write_text("one")
    assert read_texts(write_number(2) + one + bytes(-len(one) % 4) + write_text(""), "<") == ["one", ""]


@for_each(
    "data, text",
    [
        (b"\1\0", "a number of 2 bytes"),
        (write_number(5) + b"abcd", "5 bytes announced, 4 there"),
        (write_octets(b"\xff\0"), "not UTF-8"),
    ],
)
def test_a_broken_text(data: bytes, text: str) -> None:
    with pytest.raises(RtpsError, match=text):
        read_text(data, "<")


def test_many_texts() -> None:
    with pytest.raises(RtpsError, match="at most 64"):
        read_texts(write_number(65) + bytes(400), "<")


@for_each("duration_ns", [0, 1, 999_999_999, 1_000_000_000, 20_123_456_789, FOREVER_NS])
def test_durations(duration_ns: int) -> None:
    assert read_duration_ns(write_duration(duration_ns), "<") == duration_ns


@for_each("value", [b"", bytes(7), struct.pack("<iI", -1, 0)])
def test_a_broken_duration(value: bytes) -> None:
    with pytest.raises(RtpsError, match="a duration of"):
        read_duration_ns(value, "<")


def test_addresses() -> None:
    shared_memory = struct.pack("<iI", 16, 7411) + bytes(16)
    without_port = write_address(("10.0.0.1", 0))
    values = [shared_memory, write_address(("127.0.0.1", 7411)), without_port]
    assert read_addresses(values, "<") == (("127.0.0.1", 7411),)
    with pytest.raises(RtpsError, match="a locator of 23 bytes"):
        read_addresses([bytes(23)], "<")


def test_numbers_of_both_orders() -> None:
    assert read_number(b"\1\0\0\0", "<") == read_number(b"\0\0\0\1", ">") == 1


def test_properties() -> None:
    pairs = [("PARTICIPANT_TYPE", "SERVER"), ("a", ""), ("odd", "four")]
    written = write_properties(pairs)
    assert read_properties(written, "<") == dict(pairs)
    assert read_properties(written + bytes(4), "<") == dict(pairs)  # binary ones may follow
    assert read_properties(write_properties([]), "<") == {}
    for wrong in (write_number(33) + bytes(400), written[:-8], write_number(1)):
        with pytest.raises(RtpsError):
            read_properties(wrong, "<")
