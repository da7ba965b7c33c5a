"""Datagrams: what is read is what was written, and what can't be right is refused."""

import struct

import pytest

from bus_bridge.rtps import messages as m
from bus_bridge.rtps.ids import UNKNOWN_ENTITY, UNKNOWN_PREFIX
from bus_bridge.rtps.parameters import RtpsError, write_parameters
from rows import for_each

PREFIX, FAR = bytes(range(12)), bytes(range(20, 32))
HEAD = m.write_head(PREFIX)
R, W = b"rrr\x04", b"www\x03"
INLINE = write_parameters([(0x83, b"i" * 24)])


def read(data: bytes) -> m.Submessage:
    datagram = m.read_datagram(HEAD + data)
    assert datagram.fault == ""
    (received,) = datagram.received
    return received.submessage


def fault(data: bytes) -> str:
    datagram = m.read_datagram(HEAD + data)
    assert datagram.received == []
    return datagram.fault


def big(kind: int, flags: int, body: bytes) -> bytes:
    return struct.pack(">BBH", kind, flags, len(body)) + body


def little(kind: int, flags: int, body: bytes) -> bytes:
    return struct.pack("<BBH", kind, flags | 1, len(body)) + body


def test_samples() -> None:
    assert read(m.write_data(R, W, 2**40 + 7, b"body")) == m.Data(R, W, 2**40 + 7, b"body", {}, "<")
    inline = {0x83: [b"i" * 24]}
    assert read(m.write_data(R, W, 1, b"", INLINE)) == m.Data(R, W, 1, b"", inline, "<")
    assert read(m.write_data(R, W, 1, None, INLINE)) == m.Data(R, W, 1, None, inline, "<")


def test_a_key_is_no_payload() -> None:
    body = struct.pack("<HH", 0, 16) + R + W + m.write_number64(4) + b"\0\3\0\0key."
    assert read(little(0x15, 0x08, body)) == m.Data(R, W, 4, None, {}, "<")


def test_fragments() -> None:
    payload = bytes(range(10))
    for number, piece in enumerate((payload[:4], payload[4:8], payload[8:]), 1):
        found = read(m.write_fragment(R, W, 9, number, 4, payload, INLINE))
        inline = {0x83: [b"i" * 24]}
        assert found == m.DataFragments(R, W, 9, number, 1, 4, 10, piece, inline, "<")


def test_several_fragments_in_one() -> None:
    body = struct.pack("<HH", 0, 28) + R + W + m.write_number64(9) + struct.pack("<IHHI", 2, 2, 4, 10)
    assert read(little(0x16, 0, body + b"efghij")) == m.DataFragments(
        R, W, 9, 2, 2, 4, 10, b"efghij", {}, "<"
    )


@for_each(
    "first, count, size, total, payload",
    [
        (0, 1, 4, 10, b"abcd"),  # fragments count from 1
        (1, 0, 4, 10, b"abcd"),
        (1, 1, 0, 10, b"abcd"),
        (1, 1, 4, 10, b"abc"),  # shorter than it says
        (4, 1, 4, 10, b"abcd"),  # behind the end
        (3, 2, 4, 10, b"ij"),
        (2**32 - 1, 1, 65535, 2**32 - 1, b"abcd"),
    ],
)
def test_fragments_that_can_t_be(first: int, count: int, size: int, total: int, payload: bytes) -> None:
    body = struct.pack("<HH", 0, 28) + R + W + m.write_number64(9)
    body += struct.pack("<IHHI", first, count, size, total)
    assert "fragments of" in fault(little(0x16, 0, body + payload))


def test_heartbeats() -> None:
    assert read(m.write_heartbeat(R, W, 3, 9, 5, is_final=True)) == m.Heartbeat(R, W, 3, 9, 5, True)
    assert read(m.write_heartbeat(R, W, 10, 9, 6, is_final=False)) == m.Heartbeat(R, W, 10, 9, 6, False)
    assert read(m.write_heartbeat_fragment(R, W, 3, 9, 5)) == m.HeartbeatFragment(R, W, 3, 9, 5)


@for_each("first, last", [(0, 4), (5, 3), (-1, -2), (-(2**63), 0), (1, 2**62 + 1), (2**63 - 1, 2**63 - 1)])
def test_heartbeats_that_can_t_be(first: int, last: int) -> None:
    assert "a heartbeat for" in fault(m.write_heartbeat(R, W, first, last, 5, is_final=True))


@for_each("missing", [(), (7,), (7, 9, 200), tuple(range(7, 7 + 256))])
def test_acknowledgments(missing: tuple[int, ...]) -> None:
    found = read(m.write_acknack(R, W, 7, missing, 3, is_final=not missing))
    assert found == m.AckNack(R, W, 7, missing, 3, not missing)
    if missing:
        assert read(m.write_nack_fragments(R, W, 5, missing, 3)) == m.NackFragments(R, W, 5, missing, 3)


def test_the_first_word_of_a_reader() -> None:
    assert read(m.write_acknack(R, W, 0, (), 1, is_final=False)) == m.AckNack(R, W, 1, (), 1, False)


def test_gaps() -> None:
    assert read(m.write_gap(R, W, 1, 2**50, (2**50 + 2,))) == m.Gap(R, W, 1, 2**50, (2**50 + 2,))


def test_a_set_that_is_too_large() -> None:
    body = R + W + m.write_number64(1) + struct.pack("<I", 257) + bytes(36 + 4)
    assert fault(little(0x06, 0, body)) == "a set of 257 numbers; at most 256 are allowed"
    body = R + W + m.write_number64(1) + struct.pack("<I", 2**32 - 1)
    assert "a set of" in fault(little(0x06, 0, body))


@for_each("base, more", [(2**62 + 1, ()), (2**62, (2**62 + 1,)), (2**63 - 1, (2**63 - 1,))])
def test_sets_of_numbers_that_can_t_be(base: int, more: tuple[int, ...]) -> None:
    assert "number" in fault(m.write_gap(R, W, 1, base, more))
    assert fault(m.write_acknack(R, W, base, more, 1, is_final=True)) == f"a set of numbers from {base} on"


def test_a_fragment_above_32_bits() -> None:
    """Found by `make fuzz`: a number of a fragment that could not be written again."""
    body = R + W + m.write_number64(5) + struct.pack("<IIII", 2**32 - 1, 2, 1 << 30, 3)
    assert fault(little(0x12, 0, body)) == f"a set of numbers from {2**32 - 1} on"


@for_each("number", [0, -1, -(2**63), 2**62 + 1, 2**63 - 1])
def test_numbers_of_samples_have_limits(number: int) -> None:
    wanted = f"a sample with the number {number}"
    assert fault(m.write_data(R, W, number, b"")) == wanted
    assert fault(m.write_gap(R, W, number, 5)) == wanted
    assert fault(m.write_heartbeat_fragment(R, W, number, 5, 1)) == wanted


def test_inline_qos_outside_the_submessage() -> None:
    body = struct.pack("<HH", 0, 200) + R + W + m.write_number64(1)
    assert fault(little(0x15, 0x04, body)) == "inline QoS at byte 204 of 20"
    body = struct.pack("<HH", 0, 4) + R + W + m.write_number64(1)
    assert "inline QoS at byte 8" in fault(little(0x15, 0x04, body))


def test_big_endian() -> None:
    body = R + W + struct.pack(">iIiII", 0, 3, 1, 2, 5)
    assert read(big(0x07, 0, body)) == m.Heartbeat(R, W, 3, 2**32 + 2, 5, False)
    body = (
        struct.pack(">HH", 0, 16)
        + R
        + W
        + struct.pack(">iI", 0, 4)
        + struct.pack(">HH4sHH", 0x83, 4, b"abcd", 1, 0)
    )
    assert read(big(0x15, 0x06, body + b"x")) == m.Data(R, W, 4, b"x", {0x83: [b"abcd"]}, ">")


def test_what_the_others_say_about_it() -> None:
    time_ns = 1_700_000_000_123_456_789
    data = HEAD + m.write_data(R, W, 1, b"") + m.write_destination(FAR) + m.write_time(time_ns)
    data += m.write_data(R, W, 2, b"")
    data += little(0x09, 0x02, b"")  # from here on without a time
    data += m.write_data(R, W, 3, b"")
    data += little(0x0C, 0, bytes(4) + b"\2\3\1\x0f" + FAR) + m.write_data(R, W, 4, b"")
    datagram = m.read_datagram(data)
    assert (datagram.vendor, datagram.fault) == (b"\x01\x7f", "")
    assert [one[:3] for one in datagram.received] == [
        (PREFIX, UNKNOWN_PREFIX, 0),
        (PREFIX, FAR, time_ns),
        (PREFIX, FAR, 0),
        (FAR, FAR, 0),
    ]


def test_unknown_kinds_are_passed_over() -> None:
    data = little(0x01, 0, b"") + little(0x80, 0, b"statistics..") + m.write_data(R, W, 1, b"x")
    assert read(data) == m.Data(R, W, 1, b"x", {}, "<")


def test_the_last_length_may_be_left_out() -> None:
    body = struct.pack("<HH", 0, 16) + R + W + m.write_number64(4) + b"x" * 70_000
    found = read(struct.pack("<BBH", 0x15, 0x05, 0) + body)
    assert isinstance(found, m.Data) and found.payload == b"x" * 70_000


def test_what_follows_a_broken_submessage_is_ignored() -> None:
    data = HEAD + m.write_data(R, W, 1, b"x") + little(0x07, 0, b"short") + m.write_data(R, W, 2, b"y")
    datagram = m.read_datagram(data)
    assert len(datagram.received) == 1
    assert datagram.fault == "a submessage that is too short"


def test_a_length_beyond_the_datagram() -> None:
    assert (
        fault(struct.pack("<BBH", 0x15, 5, 500) + bytes(20))
        == "a submessage of 500 bytes, with 20 bytes left"
    )
    assert "a prefix in 4 bytes" in fault(little(0x0E, 0, bytes(4)))


@for_each("data", [b"", b"RTPS\2\3", b"RTPX" + HEAD[4:], b"RTPS\1\0" + HEAD[6:]])
def test_not_rtps(data: bytes) -> None:
    with pytest.raises(RtpsError, match="not a datagram of RTPS 2"):
        m.read_datagram(data)


def test_no_reader_named() -> None:
    assert read(m.write_data(UNKNOWN_ENTITY, W, 1, b"")).reader == UNKNOWN_ENTITY
