"""Datagrams of RTPS, from any machine of a network."""

from collections.abc import Callable
from contextlib import suppress
from typing import Final

from bus_bridge.rtps import messages as m
from bus_bridge.rtps.announcements import (
    EndpointData,
    ParticipantData,
    inline_qos,
    read_endpoint,
    read_participant,
    write_endpoint,
    write_participant,
)
from bus_bridge.rtps.far import Bounds
from bus_bridge.rtps.ids import (
    OUR_VENDOR,
    PARTICIPANT,
    PUBLICATIONS_READER,
    PUBLICATIONS_WRITER,
    SPDP_WRITER,
    SUBSCRIPTIONS_READER,
    SUBSCRIPTIONS_WRITER,
    UNKNOWN_ENTITY,
    reader_id,
    writer_id,
)
from bus_bridge.rtps.own_announcements import Settings
from bus_bridge.rtps.parameters import Address, RtpsError
from bus_bridge.rtps.participant import Participant
from bus_bridge.rtps.reader import Arrived
from bus_bridge.rtps.writer import Keeping
from fuzz.script import Script

_SOURCE: Final = b"s" * 12
_FAR: Final = (b"1" * 12, b"2" * 12)
_BOUNDS: Final = Bounds(participants=1, endpoints=3, room_bytes=3000)
_MOST_WRITTEN: Final = 1 << 20
_MOST_SENT: Final = 20_000
"""Bytes in answer to one datagram."""
_MOST_NUMBERS: Final = (1 << 63) - 512
"""So that numbers up to 511 above them still fit into 64 bits."""
_LONG_NS: Final = 1_000_000_000_000


def datagrams(data: bytes) -> None:
    """Only possible submessages come out, and writing them again gives the same values."""
    with suppress(RtpsError):
        datagram = m.read_datagram(data)
        for one in datagram.received:
            if isinstance(one.submessage, m.DataFragments) and _end(one.submessage) > _MOST_WRITTEN:
                continue
            again = m.read_datagram(m.write_head(one.source) + _written(one.submessage))
            assert not again.fault, again.fault
            assert _plain(again.received[0].submessage) == _plain(one.submessage)


def _end(one: m.DataFragments) -> int:
    return (one.first - 1) * one.fragment_bytes + len(one.payload)


def _written(one: m.Submessage) -> bytes:
    match one:
        case m.Data(reader, writer, number, payload):
            return m.write_data(reader, writer, number, payload)
        case m.DataFragments(reader, writer, number, first, _, size, _, payload):
            whole = bytes((first - 1) * size) + payload
            return m.write_fragment(reader, writer, number, first, size, whole)
        case m.Heartbeat(reader, writer, first, last, count, is_final):
            return m.write_heartbeat(reader, writer, first, last, count, is_final=is_final)
        case m.HeartbeatFragment(reader, writer, number, last, count):
            return m.write_heartbeat_fragment(reader, writer, number, last, count)
        case m.AckNack(reader, writer, base, missing, count, is_final):
            return m.write_acknack(reader, writer, base, missing, count, is_final=is_final)
        case m.NackFragments(reader, writer, number, missing, count):
            return m.write_nack_fragments(reader, writer, number, missing or (1,), count)
        case m.Gap(reader, writer, first, base, more):
            return m.write_gap(reader, writer, first, base, more)


def _plain(one: m.Submessage) -> tuple[object, ...]:
    """What must be equal: not the byte order, and counts of 31 bits."""
    match one:
        case m.Data(reader, writer, number, payload):
            return reader, writer, number, payload
        case m.DataFragments(reader, writer, number):
            return reader, writer, number
        case m.NackFragments(reader, writer, number, missing):
            return reader, writer, number, missing or (1,)
        case m.Gap():
            return tuple(one)
        case _:
            return tuple(part % 2**31 if name == "serial" else part for name, part in one._asdict().items())


def announcements(data: bytes) -> None:
    """Descriptions that are accepted come out the same after they were sent on."""
    with suppress(RtpsError):
        far = read_participant(data, _SOURCE)
        again = read_participant(write_participant(far), _SOURCE)
        assert again[2:] == far[2:]
    for kind in ("reader", "writer"):
        with suppress(RtpsError):
            endpoint = read_endpoint(data, kind)
            sent = read_endpoint(write_endpoint(endpoint), kind)
            assert sent == endpoint._replace(is_default_partition=True, representations=sent.representations)


class _News:
    """The receiver of a participant's news; each must be about an existing endpoint."""

    def __init__(self) -> None:
        self.there: dict[bytes, EndpointData] = {}
        self.participants: set[bytes] = set()

    def participant_added(self, data: ParticipantData) -> None:
        assert data.prefix not in self.participants
        self.participants.add(data.prefix)

    def participant_removed(self, prefix: bytes) -> None:
        self.participants.remove(prefix)
        assert not any(guid.startswith(prefix) for guid in self.there)

    def endpoint_added(self, endpoint: EndpointData, vendor: bytes) -> None:
        assert endpoint.guid not in self.there
        self.there[endpoint.guid] = endpoint

    def endpoint_removed(self, endpoint: EndpointData) -> None:
        assert self.there.pop(endpoint.guid) == endpoint

    def warn(self, text: str) -> None:
        assert text.isprintable()


class Watched:
    """A participant, with a reader and a writer of one topic, and what holds of it at any time."""

    def __init__(self, kind: type[Participant], settings: Settings) -> None:
        self._bounds = settings.bounds
        self._news = _News()
        self._numbers: dict[bytes, int] = {}
        """Of the newest samples, by writer."""
        self._sent = 0
        self.now_ns = 1
        self.participant = kind(settings, self._transmit, self._news, lambda _: True)
        self.participant.start(self.now_ns)
        self.reader = self.participant.add_reader("t", "T", self._deliver, self.now_ns)
        self.writer = self.participant.add_writer("t", "T", self.now_ns, keeping=Keeping(changes=3))

    def _transmit(self, _: Address, datagram: bytes) -> None:
        self._sent += len(datagram)

    def _deliver(self, arrived: Arrived) -> None:
        assert arrived.number > self._numbers.get(arrived.writer, 0), "samples come once, and in order"
        self._numbers[arrived.writer] = arrived.number

    def step(self, script: Script, say: Callable[[], tuple[bytes, Address]]) -> None:
        """Time passes, a sample is written, or a datagram arrives that `say` makes. Then check everything."""
        self.now_ns += script.byte() << script.byte() % 28
        match script.byte() % 16:
            case 0:
                self.participant.act(self.now_ns)
            case 1:
                self.participant.write(self.writer, bytes(script.byte()), self.now_ns, self.now_ns)
            case _:
                self.participant.receive(*say(), self.now_ns)
        self._check()

    def _check(self) -> None:
        there = self._news.there
        assert len(self.participant.far) <= self._bounds.participants
        assert self._news.participants == {far.prefix for far in self.participant.far}
        for far in self.participant.far:
            assert len(far.endpoints) <= self._bounds.endpoints and far.room.left >= 0
            assert all(guid in there for guid in far.endpoints)
        assert {*self.reader.matched, *self.writer.matched} <= there.keys()
        assert self.writer.writer is not None and self.writer.writer.kept <= 3
        # A writer that is matched again may count again.
        self._numbers = {guid: one for guid, one in self._numbers.items() if guid in self.reader.matched}
        assert self._sent < _MOST_SENT
        self._sent = 0

    def check_end(self, turns: int) -> None:
        """After so many long silences nothing is left."""
        for _ in range(turns):
            self.now_ns += _LONG_NS
            self.participant.act(self.now_ns)
        assert not self.participant.far and not self._news.there
        assert not self.reader.matched and not self.writer.matched


def participant(data: bytes) -> None:
    """Submessages of two hostile participants: matches follow from their announcements, samples come in
    order, nothing grows beyond its limit, and nothing is left after they have gone."""
    script = Script(data)
    watched = Watched(Participant, Settings(b"o" * 12, (("10.0.0.1", 7410),), (), bounds=_BOUNDS))

    def say() -> tuple[bytes, Address]:
        prefix = script.choose(_FAR)
        said = _said(script, prefix, watched.reader.guid[12:], watched.writer.guid[12:])
        return m.write_head(prefix) + said, ("10.0.0.2", 1)

    while script:
        watched.step(script, say)
    watched.check_end(1)


def _said(script: Script, prefix: bytes, reader: bytes, writer: bytes) -> bytes:
    """One submessage."""
    ours, theirs = script.choose((reader, UNKNOWN_ENTITY, PUBLICATIONS_READER)), writer_id(script.byte() % 3)
    count = script.byte()
    match script.byte() % 10:
        case 0 | 1:
            lease_ns = script.number(10**9, signed=False) % 10**10
            far = ParticipantData(prefix, OUR_VENDOR, (("10.0.0.2", 7410),), (), lease_ns)
            said = m.write_data(UNKNOWN_ENTITY, SPDP_WRITER, 1, write_participant(far))
        case 2:
            endpoint = EndpointData("writer", prefix + theirs, script.choose("tu"), "T")
            said = m.write_data(PUBLICATIONS_READER, PUBLICATIONS_WRITER, 1 + count, write_endpoint(endpoint))
        case 3:
            far_reader = EndpointData("reader", prefix + reader_id(script.byte() % 3), "t", "T")
            said = m.write_data(
                SUBSCRIPTIONS_READER, SUBSCRIPTIONS_WRITER, 1 + count, write_endpoint(far_reader)
            )
        case 4:
            said = m.write_data(ours, theirs, 1 + count % 8, script.take(script.byte() % 8))
        case 5:
            whole = bytes(1 + script.byte())
            fragment = 1 + script.byte() % -(-len(whole) // 16)
            said = m.write_fragment(ours, theirs, 1 + count % 8, fragment, 16, whole)
        case 6:
            first = 1 + script.number(0, signed=False) % _MOST_NUMBERS
            last = first - 1 + script.byte()
            said = m.write_heartbeat(ours, theirs, first, last, count, is_final=bool(script.byte() % 2))
        case 7:
            first = 1 + script.number(0, signed=False) % _MOST_NUMBERS
            base = first + script.byte()
            more = range(base, base + script.byte() % 3)
            said = m.write_gap(ours, theirs, first, base, more)
        case 8:
            base = 1 + script.byte()
            missing = range(base, base + script.byte() % 9)
            said = m.write_acknack(reader_id(count % 3), writer, base, missing, count, is_final=False)
        case _:
            gone = inline_qos(gone=prefix + script.choose((PARTICIPANT, theirs)))
            said = m.write_data(
                UNKNOWN_ENTITY, script.choose((SPDP_WRITER, PUBLICATIONS_WRITER)), 1 + count, None, gone
            )
    return changed(said, script)


def changed(said: bytes, script: Script) -> bytes:
    """A submessage, rarely with a changed byte."""
    if script.byte() % 8 != 1:
        return said
    wrong = bytearray(said)
    wrong[script.byte() % len(wrong)] = script.byte()
    return bytes(wrong)
