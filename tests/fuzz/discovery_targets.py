"""Datagrams of Discovery Servers of Fast DDS that lie, and of the participants that they announce."""

from typing import Final

from bus_bridge.rtps import messages as m
from bus_bridge.rtps.announcements import (
    EndpointData,
    ParticipantData,
    inline_qos,
    write_endpoint,
    write_participant,
)
from bus_bridge.rtps.client import ClientParticipant
from bus_bridge.rtps.far import Bounds
from bus_bridge.rtps.ids import (
    DISCOVERY_READERS,
    FAST_DDS,
    OUR_VENDOR,
    PARTICIPANT,
    PUBLICATIONS_READER,
    PUBLICATIONS_WRITER,
    SPDP_READER,
    SPDP_WRITER,
    SUBSCRIPTIONS_READER,
    SUBSCRIPTIONS_WRITER,
    reader_id,
    writer_id,
)
from bus_bridge.rtps.own_announcements import Settings
from bus_bridge.rtps.parameters import Address
from fuzz.rtps_targets import Watched, changed
from fuzz.script import Script

_ADDRESSES: Final[dict[bytes, Address]] = {
    b"server 1 ...": ("10.0.0.2", 11811),
    b"server 2 ...": ("10.0.0.3", 11811),
    b"client 1 ...": ("10.0.0.4", 7410),
    b"client 2 ...": ("10.0.0.5", 7410),
}
"""By prefix. The first two are in the settings."""
_SERVERS: Final = tuple(_ADDRESSES.values())[:2]
_BOUNDS: Final = Bounds(participants=3, endpoints=3, room_bytes=3000)


def discovery_servers(data: bytes) -> None:
    """What two servers and two others say, each also in the name of another, to a client of the servers.

    What holds of any participant holds. Those that only a server has announced are forgotten after it.
    """
    script = Script(data)
    settings = Settings(b"o" * 12, (("10.0.0.1", 7410),), _SERVERS, is_client=True, bounds=_BOUNDS)
    watched = Watched(ClientParticipant, settings)

    def say() -> tuple[bytes, Address]:
        sender = script.choose(tuple(_ADDRESSES))
        vendor = FAST_DDS if _ADDRESSES[sender] in _SERVERS else OUR_VENDOR
        said = changed(_said(script, sender, watched.reader.guid[12:], watched.writer.guid[12:]), script)
        return m.write_head(sender, vendor) + said, _ADDRESSES[sender]

    while script:
        watched.step(script, say)
    watched.check_end(3)


def _said(script: Script, sender: bytes, reader: bytes, writer: bytes) -> bytes:
    """One submessage. A server announces others by the number of each announcement."""
    about = script.choose(tuple(_ADDRESSES))
    number = 1 + script.byte() % 16
    of_theirs = script.choose((SPDP_WRITER, PUBLICATIONS_WRITER, SUBSCRIPTIONS_WRITER, writer_id(0)))
    to_ours = DISCOVERY_READERS.get(of_theirs, reader)
    match script.byte() % 10:
        case 0:
            return m.write_data(SPDP_READER, SPDP_WRITER, 1, _described(sender, script))
        case 1 | 2:
            return m.write_data(SPDP_READER, SPDP_WRITER, number, _described(about, script))
        case 3:
            endpoint = EndpointData("writer", about + writer_id(script.byte() % 3), script.choose("tu"), "T")
            payload = write_endpoint(endpoint)
            return m.write_data(PUBLICATIONS_READER, PUBLICATIONS_WRITER, number, payload)
        case 4:
            endpoint = EndpointData("reader", about + reader_id(script.byte() % 3), script.choose("tu"), "T")
            payload = write_endpoint(endpoint)
            return m.write_data(SUBSCRIPTIONS_READER, SUBSCRIPTIONS_WRITER, number, payload)
        case 5:
            entity = script.choose((PARTICIPANT, writer_id(0), reader_id(0)))
            return m.write_data(to_ours, of_theirs, number, None, inline_qos(gone=about + entity))
        case 6:
            return m.write_data(to_ours, of_theirs, number, script.take(script.byte() % 8))
        case 7:
            first, last = 1 + script.byte() % 32, script.byte() % 32
            is_final = bool(script.byte() % 2)
            return m.write_heartbeat(
                to_ours, of_theirs, first, max(last, first - 1), script.byte(), is_final=is_final
            )
        case 8:
            return m.write_gap(to_ours, of_theirs, number, number + script.byte(), ())
        case _:
            ours = script.choose((*DISCOVERY_READERS, writer))
            theirs = DISCOVERY_READERS.get(ours, reader_id(0))
            missing = range(number, number + script.byte() % 9)
            return m.write_acknack(theirs, ours, number, missing, script.byte(), is_final=False)


def _described(prefix: bytes, script: Script) -> bytes:
    """The announcement of a participant: mostly of its own kind, sometimes with a lie, or without a place."""
    address = _ADDRESSES[prefix]
    kind = script.byte() % 8
    is_server = (address in _SERVERS) != (kind == 1)
    places = () if kind == 2 else (address,)
    lease_ns = script.number(10**9, signed=False) % 10**10
    role = "SERVER" if is_server else ""
    return write_participant(ParticipantData(prefix, FAST_DDS, places, places, lease_ns, role=role))
