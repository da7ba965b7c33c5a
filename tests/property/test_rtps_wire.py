"""Datagrams of RTPS: any submessages come out as they went in, in any company, and damage is never more than
damage."""

from contextlib import suppress

from hypothesis import given, settings
from hypothesis import strategies as st

from bus_bridge.rtps import messages as m
from bus_bridge.rtps.announcements import (
    EndpointData,
    EndpointKind,
    read_endpoint,
    read_participant,
    write_endpoint,
)
from bus_bridge.rtps.ids import reader_id, writer_id
from bus_bridge.rtps.parameters import FOREVER_NS, RtpsError, read_parameters, write_parameters
from bus_bridge.rtps.policies import Policies
from effort import examples

PREFIX = bytes(range(1, 13))
IDS = st.binary(min_size=4, max_size=4)
NUMBERS = st.integers(1, m.MAX_NUMBER)
COUNTS = st.integers(0, 2**31 - 1)
PARAMETERS = st.lists(
    st.tuples(
        st.integers(2, 0xFFFF), st.binary(max_size=9).map(lambda value: value + bytes(-len(value) % 4))
    ),
    max_size=5,
)


@st.composite
def submessages(draw: st.DrawFn) -> tuple[m.Submessage, bytes]:
    """A submessage, and its bytes."""
    reader, writer, number, count = draw(IDS), draw(IDS), draw(NUMBERS), draw(COUNTS)
    is_final = draw(st.booleans())
    match draw(st.integers(0, 6)):
        case 0:
            parameters = draw(PARAMETERS)
            inline = write_parameters(parameters) if parameters else b""
            payload = draw(st.one_of(st.none(), st.binary(max_size=20)))
            found = read_parameters(inline, "<").parameters if inline else {}
            made: m.Submessage = m.Data(reader, writer, number, payload, found, "<")
            return made, m.write_data(reader, writer, number, payload, inline)
        case 1:
            payload = draw(st.binary(min_size=1, max_size=40))
            size = draw(st.integers(1, 12))
            fragment = draw(st.integers(1, -(-len(payload) // size)))
            piece = payload[(fragment - 1) * size : fragment * size]
            made = m.DataFragments(reader, writer, number, fragment, 1, size, len(payload), piece, {}, "<")
            return made, m.write_fragment(reader, writer, number, fragment, size, payload)
        case 2:
            last = draw(st.integers(number - 1, m.MAX_NUMBER))
            made = m.Heartbeat(reader, writer, number, last, count, is_final)
            return made, m.write_heartbeat(reader, writer, number, last, count, is_final=is_final)
        case 3:
            fragment = draw(st.integers(0, 2**32 - 1))
            made = m.HeartbeatFragment(reader, writer, number, fragment, count)
            return made, m.write_heartbeat_fragment(reader, writer, number, fragment, count)
        case 4:
            number = min(number, m.MAX_NUMBER - m.MOST_IN_SET)
            missing = draw(_members(number))
            made = m.AckNack(reader, writer, number, missing, count, is_final)
            return made, m.write_acknack(reader, writer, number, missing, count, is_final=is_final)
        case 5:
            base = draw(st.integers(1, 2**32 - 257))
            missing = draw(_members(base).filter(bool))
            made = m.NackFragments(reader, writer, number, missing, count)
            return made, m.write_nack_fragments(reader, writer, number, missing, count)
        case _:
            base, more = draw(NUMBERS), draw(st.just(()))
            made = m.Gap(reader, writer, number, base, more)
            return made, m.write_gap(reader, writer, number, base, more)


def _members(base: int) -> st.SearchStrategy[tuple[int, ...]]:
    offsets = st.lists(st.integers(0, m.MOST_IN_SET - 1), unique=True, max_size=20).map(sorted)
    return offsets.map(lambda found: tuple(base + offset for offset in found))


@settings(max_examples=examples(100))
@given(st.lists(submessages(), max_size=6))
def test_what_was_written_is_read(made: list[tuple[m.Submessage, bytes]]) -> None:
    datagram = m.read_datagram(m.write_head(PREFIX) + b"".join(data for _, data in made))
    assert datagram.fault == ""
    assert [one.submessage for one in datagram.received] == [one for one, _ in made]


@settings(max_examples=examples(100))
@given(st.lists(submessages(), min_size=1, max_size=3), st.data())
def test_damage(made: list[tuple[m.Submessage, bytes]], data: st.DataObject) -> None:
    whole = bytearray(m.write_head(PREFIX) + b"".join(one for _, one in made))
    for _ in range(data.draw(st.integers(1, 3))):
        whole[data.draw(st.integers(20, len(whole) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(20, len(whole)))
    datagram = m.read_datagram(bytes(whole[:cut]))
    for one in datagram.received:
        assert all(isinstance(part, bytes) and len(part) == 4 for part in one.submessage[:2])
        assert getattr(one.submessage, "number", 1) >= 1


@settings(max_examples=examples(100))
@given(st.binary(max_size=200), st.sampled_from([b"\0\3\0\0", b"\0\2\0\0"]))
def test_any_bytes_as_announcements(data: bytes, head: bytes) -> None:
    with suppress(RtpsError):
        read_participant(head + data, PREFIX)
    for kind in ("reader", "writer"):
        with suppress(RtpsError):
            read_endpoint(head + data, kind)


DURATIONS = st.one_of(st.just(FOREVER_NS), st.integers(0, 10**17))


@settings(max_examples=examples(100))
@given(
    st.booleans(),
    st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=20),
    st.binary(max_size=20),
    st.builds(
        Policies,
        st.booleans(),
        st.integers(0, 3),
        st.booleans(),
        st.integers(1, 2**31 - 1),
        DURATIONS,
        DURATIONS,
        st.integers(0, 2),
        DURATIONS,
    ),
)
def test_endpoints(is_reader: bool, name: str, user_data: bytes, policies: Policies) -> None:
    entity = reader_id(3) if is_reader else writer_id(3)
    kind: EndpointKind = "reader" if is_reader else "writer"
    data = EndpointData(kind, PREFIX + entity, name, name, policies, user_data)
    assert read_endpoint(write_endpoint(data), kind) == data
