"""Messages in parts."""

from struct import Struct

from hypothesis import given
from hypothesis import strategies as st

from bus_bridge.batch import Sample
from bus_bridge.packed import RECORD, Packed
from bus_bridge.zenoh import records
from bus_bridge.zenoh.records import (
    MAX_NUMBER,
    PART_BYTES,
    WHOLE_BYTES,
    Assembler,
    Part,
    Piece,
    Probe,
    Room,
)

_samples = st.lists(
    st.builds(
        Sample,
        st.integers(0, 3 * PART_BYTES).map(bytes) | st.binary(max_size=100),
        st.integers(0, MAX_NUMBER),
        st.integers(-(2**63), 2**63 - 1),
    ),
    max_size=20,
)


def unpack(parts: list[Part]) -> list[Sample]:
    found: list[Sample] = []
    assembler = Assembler(Room(1 << 30))
    for part in parts:
        read = records.read_part(part.payload, part.head)
        assert read is not None and read[0] == part.number
        if isinstance(read[1], Piece):
            whole = assembler.add(read[1])
            found += [] if whole is None else [whole]
        else:
            assert not isinstance(read[1], Probe)
            found += read[1]
    return found


@given(_samples, st.integers(1, 2**47))
def test_what_is_packed_comes_out_in_order(samples: list[Sample], first: int) -> None:
    parts = list(records.pack(samples, first))
    assert [part.number for part in parts] == list(range(first, first + len(parts)))
    assert all(len(part.payload) <= WHOLE_BYTES for part in parts)
    assert unpack(parts) == samples


def test_small_messages_share_a_part_and_a_large_one_is_not_copied() -> None:
    large = bytes(WHOLE_BYTES)
    samples = [Sample(b"a", 1, 5), Sample(b"b", 2, 6), Sample(large, 3, 7), Sample(b"c", 4, 8)]
    parts = list(records.pack(samples, 1))
    assert len(parts) == 3
    assert parts[1].payload is large


def test_what_is_a_batch_already_goes_as_it_is() -> None:
    (part,) = records.pack([Sample(b"a", 1, 5), Sample(b"bc", 2, 6)], 1)
    read = records.read_part(part.payload, part.head)
    assert read is not None and isinstance(read[1], Packed)
    assert list(records.pack(read[1], 1)) == [part]
    assert unpack(list(records.pack(read[1].after(1), 9))) == [Sample(b"bc", 2, 6)]


def test_a_batch_is_taken_apart_where_parts_are_to_be_small() -> None:
    samples = [Sample(b"a", 1, 5), *(Sample(bytes(PART_BYTES), number, 0) for number in (2, 3, 4))]
    data = b"".join(
        RECORD.pack(one.number, one.source_time_ns, len(one.payload)) + one.payload for one in samples
    )
    read = records.read_part(data, Struct("<cQ").pack(b"b", 1))
    assert read is not None and isinstance(read[1], Packed)
    assert [part.payload for part in records.pack(read[1], 1)] == [data]
    parts = list(records.pack(read[1], 1, 2 * PART_BYTES))
    assert [part.number for part in parts] == [1, 2, 3, 4]
    assert all(len(part.payload) <= 2 * PART_BYTES for part in parts)
    assert unpack(parts) == samples


def test_pieces_that_go_on_nowhere_are_dropped() -> None:
    first, second, third = (
        records.read_part(part.payload, part.head)
        for part in records.pack([Sample(bytes(5 * PART_BYTES // 2), 7, 0)], 1, 2 * PART_BYTES)
    )
    assembler = Assembler(Room(1 << 30))
    for read in (second, first, third, first, second):
        assert read is not None and isinstance(read[1], Piece)
        assert assembler.add(read[1]) is None
    assert assembler.size == 2 * PART_BYTES
    assert third is not None and isinstance(third[1], Piece)
    whole = assembler.add(third[1])
    assert whole == Sample(bytes(5 * PART_BYTES // 2), 7, 0) and assembler.size == 0


def test_a_probe_is_no_message() -> None:
    probe = records.probe(7)
    assert records.read_part(probe.payload, probe.head) == (7, Probe())
    assert records.read_part(b"x", probe.head) is None


def test_pairs() -> None:
    assert records.read_pair(records.write_pair(2**64 - 1, 3)) == (2**64 - 1, 3)
    assert records.read_pair(b"x") is None
    assert records.read_pair(None) is None


def test_a_size_beyond_the_end_is_refused() -> None:
    (part,) = records.pack([Sample(b"abc", 1, 2)], 1)
    for payload, head in (
        (part.payload[:-1], part.head),
        (part.payload + b"x", part.head),
        (part.payload, part.head + b"x"),
        (part.payload, None),
    ):
        assert records.read_part(payload, head) is None
    piece = records.piece(Sample(bytes(3 * PART_BYTES // 2), 1, 2), PART_BYTES, 1)
    assert records.read_part(bytes(PART_BYTES), piece.head) is None
    huge = piece.head[:25] + (2**40).to_bytes(8, "little") + piece.head[33:]
    assert records.read_part(b"x", huge) is None


def test_parts_that_nobody_packs_are_refused() -> None:
    """Such parts would cost more than their bytes, or break counters."""
    batch = Struct("<cQ").pack(b"b", 1)

    def record(number: int) -> bytes:
        return Struct("<QqI").pack(number, 0, 0)

    assert records.read_part(record(MAX_NUMBER), batch) is not None
    assert records.read_part(record(MAX_NUMBER + 1), batch) is None
    assert records.read_part(b"", batch) is None
    for number in (MAX_NUMBER + 1, 2**64 - 1):
        assert records.read_part(record(1), Struct("<cQ").pack(b"b", number)) is None
        assert records.read_part(b"", Struct("<cQ").pack(b"?", number)) is None
    assert records.read_part(record(1) * (WHOLE_BYTES // 20 + 1), batch) is None
    assert records.read_part(b"x", Struct("<cQQq").pack(b"w", 1, MAX_NUMBER + 1, 0)) is None
    assert records.read_part(bytes(WHOLE_BYTES + 1), Struct("<cQQq").pack(b"w", 1, 1, 0)) is None
    for payload, message, total, offset in (
        (b"x", 1, 1000, 0),
        (bytes(PART_BYTES), 1, 2 * PART_BYTES, 1),
        (b"", 1, PART_BYTES, PART_BYTES),
        (bytes(PART_BYTES), MAX_NUMBER + 1, 2 * PART_BYTES, 0),
    ):
        head = Struct("<cQQqQQ").pack(b"p", 1, message, 0, total, offset)
        assert records.read_part(payload, head) is None


def test_messages_that_find_no_room_are_dropped_and_give_back_what_they_had() -> None:
    room = Room(3 * PART_BYTES)
    one, other = Assembler(room), Assembler(room)
    message = Sample(bytes(2 * PART_BYTES), 7, 0)
    first, second = (
        read[1]
        for part in (records.piece(message, 0, 1), records.piece(message, PART_BYTES, 2))
        if (read := records.read_part(part.payload, part.head)) and isinstance(read[1], Piece)
    )
    assert one.add(first) is None and room.left == 2 * PART_BYTES
    endless = first._replace(total=100 * PART_BYTES)
    for offset in range(100):
        assert other.add(endless._replace(offset=offset * PART_BYTES)) is None
    assert other.size == 0 and room.left == 2 * PART_BYTES
    assert one.add(second) == message
    assert room.left == 3 * PART_BYTES


@given(st.binary(max_size=200), st.none() | st.binary(max_size=40))
def test_random_bytes_get_no_further_than_none(payload: bytes, head: bytes | None) -> None:
    for kind in (b"", b"b", b"w", b"p", b"?"):
        found = records.read_part(payload, None if head is None else kind + head)
        if found is not None and isinstance(found[1], list):
            assert sum(len(one.payload) for one in found[1]) <= len(payload)
