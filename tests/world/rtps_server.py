"""A Discovery Server on the network of `rtps_world`, after the one of Fast DDS (2.14, PDPServerListener.cpp).

It passes on what its clients announce to all of them, by writers of its own. Like that one it ignores
participants of other vendors, and announcements without an identity.
"""

from collections.abc import Sequence
from typing import Any

from bus_bridge.rtps.announcements import (
    ParticipantData,
    departed,
    inline_qos,
    read_endpoint,
    read_participant,
    write_participant,
)
from bus_bridge.rtps.ids import (
    DISCOVERY_READERS,
    FAST_DDS,
    GUID_BYTES,
    PARTICIPANT,
    PREFIX_BYTES,
    PUBLICATIONS_WRITER,
    SPDP_READER,
    SPDP_WRITER,
)
from bus_bridge.rtps.messages import (
    AckNack,
    Data,
    Gap,
    Heartbeat,
    read_datagram,
    write_data,
    write_destination,
    write_head,
)
from bus_bridge.rtps.parameters import Address
from bus_bridge.rtps.reader import Arrived, Reader
from bus_bridge.rtps.room import Room
from bus_bridge.rtps.writer import Keeping, Writer
from rtps_world import Network

__all__ = ["Server"]

_PAIRS = DISCOVERY_READERS.items()
_RELATED = 0x83
_ANNOUNCE_NS = 3_000_000_000
_LEASE_NS = 20_000_000_000
_KEPT = Keeping(changes=1000, for_late_joiners=True)


class _Once(Writer):
    """It sends nothing again that was acknowledged: the server's database has it as known."""

    def _offer_again(self, far: Any, upto: int, now_ns: int) -> None:
        pass


class Server:
    """One server. It is a machine of the network, and what a machine has as its participant."""

    def __init__(self, network: Network, host: str, number: int = 0) -> None:
        self.address: Address = host, 11811
        self.prefix = b"DS" + bytes([number]) + b"_EPROSIMA"
        self.is_cut = False
        self.clients: dict[bytes, Address] = {}
        self.ignored = 0
        self.network = network
        self.participant = self
        self._writers = {one: _Once(one, self._send, _KEPT) for one, _ in _PAIRS}
        self._readers = {one: Reader(one, self._send, self._arrived) for _, one in _PAIRS}
        self._ends: list[Writer | Reader] = [*self._writers.values(), *self._readers.values()]
        place = (self.address,)
        own = ParticipantData(self.prefix, FAST_DDS, place, place, 20 * 10**9, role="SERVER")
        self._own = write_participant(own)
        self._write(SPDP_WRITER, self._own)
        self._announce_ns = network.now_ns
        self._heard_ns: dict[bytes, int] = {}
        self._numbers: dict[bytes, int] = {}
        """Of the announcements of participants and endpoints, by GUID."""
        network.machines.append(self)

    @property
    def due_ns(self) -> int | None:
        return min(self._announce_ns, *(end.due_ns or self._announce_ns for end in self._ends))

    def act(self, now_ns: int) -> None:
        if self._announce_ns <= now_ns:
            self._announce_ns = now_ns + _ANNOUNCE_NS
            for prefix in [one for one, at_ns in self._heard_ns.items() if at_ns <= now_ns - _LEASE_NS]:
                del self._heard_ns[prefix]
                if prefix in self.clients:
                    self._forget(prefix)
                    self._write(SPDP_WRITER, None, inline_qos(gone=prefix + PARTICIPANT))
            for prefix in self.clients:
                self._send(prefix, [write_data(SPDP_READER, SPDP_WRITER, 1, self._own)])
        for end in self._ends:
            end.act(now_ns)

    def leave(self) -> None:
        """Tell the clients that the server goes."""
        self._write(SPDP_WRITER, None, inline_qos(gone=self.prefix + PARTICIPANT))

    def receive(self, datagram: bytes, source: Address, now_ns: int) -> None:
        read = read_datagram(datagram)
        for received in read.received:
            one, prefix = received.submessage, received.source
            self._heard_ns[prefix] = now_ns
            if isinstance(one, Data) and one.writer == SPDP_WRITER and prefix not in self.clients:
                self._meet(one, prefix, now_ns)
            if prefix not in self.clients or read.vendor != FAST_DDS:
                self.ignored += 1
            elif isinstance(one, AckNack):
                self._writers[one.writer].acknowledge(prefix + one.reader, one, now_ns)
            elif isinstance(one, Data | Heartbeat | Gap):
                reader = self._readers[DISCOVERY_READERS[one.writer]]
                match one:
                    case Data():
                        reader.data(prefix + one.writer, one, received.time_ns, now_ns)
                    case Heartbeat():
                        reader.heartbeat(prefix + one.writer, one, now_ns)
                    case Gap():
                        reader.gap(prefix + one.writer, one, now_ns)

    def _meet(self, one: Data, prefix: bytes, now_ns: int) -> None:
        if one.payload is None:
            return
        data = read_participant(one.payload, prefix)
        if data.vendor != FAST_DDS or data.role != "SUPER_CLIENT" or _RELATED not in one.inline:
            return
        self.clients[prefix] = data.discovery_addresses[0]
        for writer, reader in _PAIRS:
            self._readers[reader].add_writer(prefix + writer, Room(1 << 20), now_ns)
            self._writers[writer].add_reader(prefix + reader, now_ns)

    def _arrived(self, arrived: Arrived) -> None:
        prefix, writer = arrived.writer[:PREFIX_BYTES], arrived.writer[PREFIX_BYTES:]
        if arrived.inline[_RELATED][0][:GUID_BYTES] != arrived.writer:
            self.ignored += 1
            return
        gone = departed(arrived.payload, arrived.inline)
        key = gone or self._key_in(writer, arrived.payload or b"")
        if key in self._numbers:  # its history has one announcement of each
            self._writers[writer].withdraw(self._numbers.pop(key))
        number = self._write(writer, arrived.payload, inline_qos(gone=gone))
        if gone is None:
            self._numbers[key] = number
        if gone is not None and writer == SPDP_WRITER:
            self._forget(prefix)

    def _forget(self, prefix: bytes) -> None:
        del self.clients[prefix]
        for entity, reader in _PAIRS:
            self._readers[reader].remove_writer(prefix + entity)
            self._writers[entity].remove_reader(prefix + reader)

    def _key_in(self, writer: bytes, payload: bytes) -> bytes:
        if writer == SPDP_WRITER:
            return read_participant(payload, None).prefix + PARTICIPANT
        return read_endpoint(payload, "writer" if writer == PUBLICATIONS_WRITER else "reader").guid

    def _write(self, writer: bytes, payload: bytes | None, inline: bytes = b"") -> int:
        now_ns = self.network.now_ns
        return self._writers[writer].write(payload, now_ns, now_ns, inline=inline)

    def _send(self, guid: bytes, parts: Sequence[bytes]) -> None:
        prefix = guid[:PREFIX_BYTES]
        if not self.is_cut and prefix in self.clients:
            datagram = write_head(self.prefix, FAST_DDS) + write_destination(prefix) + b"".join(parts)
            self.network.send(self, self.clients[prefix], datagram)
