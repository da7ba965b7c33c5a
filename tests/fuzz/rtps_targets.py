"""Datagrams of RTPS, from any machine of a network."""

from contextlib import suppress

from bus_bridge.rtps import messages as m
from bus_bridge.rtps.announcements import read_endpoint, read_participant, write_endpoint, write_participant
from bus_bridge.rtps.parameters import RtpsError

_SOURCE = b"s" * 12


def datagrams(data: bytes) -> None:
    """Only possible submessages come out, and writing them again gives the same values."""
    with suppress(RtpsError):
        datagram = m.read_datagram(data)
        for one in datagram.received:
            again = m.read_datagram(m.write_head(one.source) + _written(one.submessage))
            assert not again.fault, again.fault
            assert _plain(again.received[0].submessage) == _plain(one.submessage)


def _written(one: m.Submessage) -> bytes:
    match one:
        case m.Data(reader, writer, number, payload):
            return m.write_data(reader, writer, number, payload)
        case m.DataFragments(reader, writer, number, first, _, size, _, payload):
            if first * size > 1 << 20:
                return m.write_data(reader, writer, number, payload)
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
            endpoint = read_endpoint(data, kind, _SOURCE)
            sent = read_endpoint(write_endpoint(endpoint), kind, _SOURCE)
            assert sent == endpoint._replace(is_default_partition=True, representations=sent.representations)
