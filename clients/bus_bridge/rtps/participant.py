"""A participant of an RTPS domain: discovery, and our readers and writers in it. Pure.

Owns: the announcements in both directions, matches, and which reader or writer a submessage is for. Must not
know: sockets and clocks. Datagrams come in by `receive`, and leave by `transmit`; `act` is called at
`due_ns`.

An announcement of a participant is sent again and again. Announcements of endpoints are samples of two
reliable writers that each participant has. Other endpoints than the wanted ones are not kept.

`client.py` has what is different for a client of Discovery Servers.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import count
from typing import Final, Protocol

from bus_bridge.rtps.announcements import (
    EndpointData,
    EndpointKind,
    ParticipantData,
    departed,
    is_match,
    read_endpoint,
    read_participant,
    write_endpoint,
)
from bus_bridge.rtps.due_times import DueTimes
from bus_bridge.rtps.far import FarParticipant, FarParticipants
from bus_bridge.rtps.ids import (
    DISCOVERY_READERS,
    FAST_DDS,
    PREFIX_BYTES,
    PUBLICATIONS_READER,
    PUBLICATIONS_WRITER,
    SPDP_WRITER,
    SUBSCRIPTIONS_READER,
    SUBSCRIPTIONS_WRITER,
    UNKNOWN_ENTITY,
    reader_id,
    writer_id,
)
from bus_bridge.rtps.local import Local
from bus_bridge.rtps.messages import (
    AckNack,
    Data,
    DataFragments,
    Gap,
    Heartbeat,
    HeartbeatFragment,
    NackFragments,
    Received,
    read_datagram,
    write_acknack,
)
from bus_bridge.rtps.outbox import Outbox
from bus_bridge.rtps.own_announcements import OwnAnnouncements, Settings
from bus_bridge.rtps.parameters import Address, RtpsError
from bus_bridge.rtps.policies import RELIABLE, Policies
from bus_bridge.rtps.reader import Arrived, Reader
from bus_bridge.rtps.writer import USUAL, Keeping, Writer

__all__ = ["OF_DISCOVERY", "Events", "Participant"]

_ANNOUNCE_NS: Final = 2_000_000_000
_FIRST_ACKNACK: Final = 1
"""The number of a question for another participant's reader. The reader's own questions before the first
heartbeat have number 0, so this one is new to the writer; its later ones have larger numbers."""
OF_DISCOVERY: Final = Keeping(changes=20_000, payload_bytes=32 << 20, for_late_joiners=True)
"""How much the writers of announcements keep."""
_KINDS: Final[Mapping[bytes, EndpointKind]] = {PUBLICATIONS_WRITER: "writer", SUBSCRIPTIONS_WRITER: "reader"}
"""The kind of endpoints that each writer of discovery announces."""
_WRITERS: Final = {reader: writer for writer, reader in DISCOVERY_READERS.items()}
_BUILTIN: Final = DISCOVERY_READERS.keys() | _WRITERS.keys()


class Events(Protocol):
    """The receiver of news about participants and wanted endpoints. Its methods must not raise."""

    def participant_added(self, data: ParticipantData) -> None: ...
    def participant_removed(self, prefix: bytes) -> None:
        """Called after its endpoints were removed."""

    def endpoint_added(self, endpoint: EndpointData, vendor: bytes) -> None: ...
    def endpoint_removed(self, endpoint: EndpointData) -> None: ...
    def warn(self, text: str) -> None:
        """The same text may come again."""


class Participant:
    """One participant. `is_wanted` says which far endpoints are kept and reported."""

    def __init__(
        self,
        settings: Settings,
        transmit: Callable[[Address, bytes], None],
        events: Events,
        is_wanted: Callable[[EndpointData], bool],
    ) -> None:
        self.prefix = settings.prefix
        self.far = FarParticipants(settings.bounds)
        self.faulty = 0
        """Datagrams, or rests of them, that were not RTPS."""
        self.strange = 0
        """Submessages of participants that have not announced themselves."""
        self._settings = settings
        self._events = events
        self._is_wanted = is_wanted
        self._own = OwnAnnouncements(settings)
        vendor = self._own.vendor
        self._outbox = Outbox(settings.prefix, transmit, settings.datagram_bytes, vendor)
        self._numbers = count(1)
        self._locals: dict[bytes, Local] = {}
        """By entity id."""
        self._by_topic: dict[str, dict[bytes, Local]] = {}
        self._matched: dict[bytes, dict[bytes, Local]] = {}
        """Our endpoints by the GUID of each matched far endpoint."""
        self._ends: dict[bytes, Reader | Writer] = {}
        for entity in (PUBLICATIONS_WRITER, SUBSCRIPTIONS_WRITER):
            self._ends[entity] = Writer(entity, self._send, OF_DISCOVERY)
        for entity in (PUBLICATIONS_READER, SUBSCRIPTIONS_READER):
            self._ends[entity] = Reader(entity, self._send, self._endpoint_arrived)
        self._due = DueTimes()
        self.gathers = False
        """Whether submessages wait for `flush`, to share datagrams with later ones."""
        self._announce_ns: int | None = None
        self._now_ns = 0

    # --- our endpoints

    def add_writer(
        self,
        topic: str,
        type_name: str,
        now_ns: int,
        *,
        policies: Policies = RELIABLE,
        user_data: bytes = b"",
        keeping: Keeping = USUAL,
    ) -> Local:
        """Make a writer, and announce it."""
        entity = writer_id(next(self._numbers))
        writer = Writer(entity, self._send, keeping, fragment_bytes=self._settings.fragment_bytes)
        data = EndpointData("writer", self.prefix + entity, topic, type_name, policies, user_data)
        return self._add(data, writer, now_ns)

    def add_reader(
        self,
        topic: str,
        type_name: str,
        deliver: Callable[[Arrived], None],
        now_ns: int,
        *,
        policies: Policies = RELIABLE,
        user_data: bytes = b"",
    ) -> Local:
        """Make a reader, and announce it. `deliver` must not raise."""
        entity = reader_id(next(self._numbers))
        reader = Reader(entity, self._send, deliver)
        data = EndpointData("reader", self.prefix + entity, topic, type_name, policies, user_data)
        return self._add(data, reader, now_ns)

    def remove(self, local: Local, now_ns: int) -> None:
        """End a reader or writer, and tell the others. A second call has no effect."""
        entity = local.guid[PREFIX_BYTES:]
        if self._locals.pop(entity, None) is None:
            return
        with self._turn(now_ns):
            del self._ends[entity]
            of_topic = self._by_topic[local.data.topic]
            del of_topic[entity]
            if not of_topic:
                del self._by_topic[local.data.topic]
            for guid in local.matched:
                self._matched[guid].pop(entity)
                if not self._matched[guid]:
                    del self._matched[guid]
                if local.reader is not None:
                    local.reader.remove_writer(guid)
            announcer = self._announcer(local.data.kind)
            announcer.withdraw(local.announced)
            news = self._own.inline(announcer.entity, announcer.last + 1, gone=local.guid)
            announcer.write(None, now_ns, now_ns, inline=news, stays=False)
            self._due.touch(announcer.entity)

    def write(
        self,
        local: Local,
        payload: bytes,
        now_ns: int,
        time_ns: int,
        *,
        inline: bytes = b"",
        to: bytes | None = None,
    ) -> int:
        """Write a sample; returns its number. `to`: the GUID of the only reader that gets it."""
        assert local.writer is not None
        with self._turn(now_ns):
            self._due.touch(local.writer.entity)
            return local.writer.write(payload, now_ns, time_ns, inline=inline, to=to)

    def is_known(self, local: Local, prefix: bytes) -> bool:
        """Whether that participant has acknowledged the announcement of an endpoint of ours."""
        announcer = self._announcer(local.data.kind)
        return announcer.acknowledged(prefix + DISCOVERY_READERS[announcer.entity]) >= local.announced

    def ask_for_heartbeat(self, reader: bytes, writer: bytes) -> None:
        """Ask a writer of Fast DDS for a heartbeat to a reader of another participant of this process.

        Both are GUIDs. No effect if the writer's participant is not known, or of another vendor.
        Readers of Fast DDS ask in the same way (`StatefulWriter::process_acknack`, "preemptive"): they
        acknowledge number 0, which no sample has.
        """
        far = self.far.find(writer[:PREFIX_BYTES])
        if far is None or far.vendor != FAST_DDS or far.address is None:
            return
        entities = reader[PREFIX_BYTES:], writer[PREFIX_BYTES:]
        asking = write_acknack(*entities, 0, (), _FIRST_ACKNACK, is_final=False)
        self._outbox.put_for_another(far.address, far.prefix, [asking], reader[:PREFIX_BYTES])

    # --- datagrams and times

    @property
    def due_ns(self) -> int | None:
        """When `act` is due; None before `start`."""
        if self._announce_ns is None:
            return None
        first_ns = self._due.first_ns
        return self._announce_ns if first_ns is None else min(self._announce_ns, first_ns)

    def start(self, now_ns: int) -> None:
        """Announce the participant from now on."""
        self._announce_ns = now_ns
        self.act(now_ns)

    def act(self, now_ns: int) -> None:
        """Do what is due: announcements, ends of leases, heartbeats, requests and repairs."""
        with self._turn(now_ns):
            if self._announce_ns is not None and self._announce_ns <= now_ns:
                self._announce_ns = now_ns + _ANNOUNCE_NS
                for address in self._called():
                    self._announce(address)
                self._check_leases()
            for entity in self._due.take_due(now_ns):
                end = self._ends.get(entity)
                if end is not None:
                    end.act(now_ns)

    def flush(self) -> None:
        """Send waiting submessages, and send at once from now on."""
        self.gathers = False
        self._outbox.flush()

    def receive(self, datagram: bytes, source: Address, now_ns: int) -> None:
        """Handle a datagram from that address. Never raises, whatever it is."""
        try:
            read = read_datagram(datagram)
        except RtpsError:
            self.faulty += 1
            return
        self.faulty += bool(read.fault)
        with self._turn(now_ns):
            for received in read.received:
                if received.source == self.prefix or (
                    any(received.destination) and received.destination != self.prefix
                ):
                    continue
                self._receive(received, source)

    def leave(self, now_ns: int) -> None:
        """Tell all others that this participant leaves. Nothing may be called after that."""
        news = [self._own.disposal()]
        for address in self._called():
            self._outbox.put_for_all(address, news)
        self._announce_ns = None

    # --- inside

    @contextmanager
    def _turn(self, now_ns: int) -> Iterator[None]:
        """At its end, plans follow the changes, and everything is sent."""
        self._now_ns = now_ns
        try:
            yield
        finally:  # after an error, too: an entity without a plan would never act again
            self._end_turn()

    def _end_turn(self) -> None:
        self._due.settle(self._due_ns_of)
        if not self.gathers:
            self._outbox.flush()

    def _due_ns_of(self, entity: bytes) -> int | None:
        end = self._ends.get(entity)
        return None if end is None else end.due_ns

    def _send(self, guid: bytes, parts: Iterable[bytes]) -> None:
        far = self.far.find(guid[:PREFIX_BYTES])
        if far is None:
            return
        is_discovery = guid[PREFIX_BYTES:] in _BUILTIN
        address = far.discovery_address if is_discovery else far.address_of(guid)
        if address is not None:
            self._outbox.put(address, far.prefix, list(parts))

    def _called(self) -> Iterable[Address]:
        """The addresses of all announcements: from the settings, and of all participants found.

        The latter may be out of reach of the settings' addresses, if they have called this participant first.
        A datagram may be lost, and Fast DDS ignores announcements that come while it starts.
        """
        found = (far.discovery_address for far in self.far if far.discovery_address is not None)
        return dict.fromkeys((*self._settings.peers, *found))

    def _check_leases(self) -> None:
        """Called at each announcement."""
        for far in self.far.expired(self._now_ns):
            self._remove(far)

    def _announce(self, address: Address) -> None:
        self._outbox.put_for_all(address, [self._own.alive()])

    def _announcer(self, kind: EndpointKind) -> Writer:
        end = self._ends[PUBLICATIONS_WRITER if kind == "writer" else SUBSCRIPTIONS_WRITER]
        assert isinstance(end, Writer)
        return end

    def _add(self, data: EndpointData, end: Reader | Writer, now_ns: int) -> Local:
        local = Local(data, end)
        entity = data.guid[PREFIX_BYTES:]
        with self._turn(now_ns):
            self._locals[entity] = local
            self._ends[entity] = end
            self._by_topic.setdefault(data.topic, {})[entity] = local
            announcer = self._announcer(data.kind)
            inline = self._own.inline(announcer.entity, announcer.last + 1)
            local.announced = announcer.write(write_endpoint(data), now_ns, now_ns, inline=inline)
            self._due.touch(announcer.entity)
            for far in list(self.far.of_topic(data.topic).values()):
                self._match(local, far)
        return local

    def _receive(self, received: Received, source: Address) -> None:
        one = received.submessage
        if (
            isinstance(one, Data)
            and one.writer == SPDP_WRITER
            and self._participant_arrived(one, received.source, source)
        ):
            return
        far = self.far.find(received.source)
        if far is None:
            self.strange += 1
            return
        self.far.refresh(far, self._now_ns)
        far.heard_from(source)
        if isinstance(one, AckNack | NackFragments):
            end = self._ends.get(one.writer)
            if isinstance(end, Writer):
                self._due.touch(one.writer)
                guid = received.source + one.reader
                if isinstance(one, AckNack):
                    end.acknowledge(guid, one, self._now_ns)
                else:
                    end.request_fragments(guid, one, self._now_ns)
            return
        guid = received.source + one.writer
        for reader in self._readers_for(one.reader, guid):
            self._due.touch(reader.entity)
            match one:
                case Data():
                    reader.data(guid, one, received.time_ns, self._now_ns)
                case DataFragments():
                    reader.fragments(guid, one, received.time_ns, self._now_ns)
                case Heartbeat():
                    reader.heartbeat(guid, one, self._now_ns)
                case HeartbeatFragment():
                    reader.heartbeat_fragment(guid, one, self._now_ns)
                case Gap():
                    reader.gap(guid, one, self._now_ns)

    def _readers_for(self, reader: bytes, writer: bytes) -> list[Reader]:
        """Our readers that a submessage of a far writer is for."""
        if writer[PREFIX_BYTES:] in DISCOVERY_READERS:
            end = self._ends.get(DISCOVERY_READERS[writer[PREFIX_BYTES:]])
            return [end] if isinstance(end, Reader) else []
        matched = self._matched.get(writer, {})
        if reader == UNKNOWN_ENTITY:
            found = list(matched.values())
        else:
            found = [matched[reader]] if reader in matched else []
        return [local.reader for local in found if local.reader is not None]

    def _participant_arrived(self, one: Data, prefix: bytes, source: Address) -> bool:
        """Handle the announcement of a participant; returns whether that was all."""
        known = self.far.find(prefix)
        try:
            if departed(one.payload, one.inline) is not None:
                if known is not None:
                    self._remove(known)
                return True
            data = read_participant(one.payload or b"", prefix)
        except RtpsError as error:
            self._events.warn(f"a participant at {source[0]} is ignored: {error}")
            return True
        if known is None:
            self._meet(data, source)
        else:
            known.update(data, source)
            self.far.refresh(known, self._now_ns)
        return True

    def _meet(self, data: ParticipantData, source: Address) -> None:
        """A new participant has announced itself: announce everything to it."""
        if (far := self._add_participant(data, source)) is None:
            return
        assert far.discovery_address is not None
        self._announce(far.discovery_address)
        for entity, end in list(self._ends.items()):
            if entity not in _BUILTIN:
                continue
            self._due.touch(entity)
            if isinstance(end, Writer):
                end.add_reader(far.prefix + DISCOVERY_READERS[entity], self._now_ns)
            else:
                end.add_writer(far.prefix + _WRITERS[entity], far.room, self._now_ns)

    def _add_participant(
        self, data: ParticipantData, source: Address, server: bytes = b""
    ) -> FarParticipant | None:
        far = self.far.add(data, source, self._now_ns, server)
        if far is not None:
            self._events.participant_added(data)
            return far
        self._events.warn(
            f"a participant at {source[0]} is ignored: "
            + (
                "it has no address that can be reached"
                if len(self.far) < self._settings.bounds.participants
                else f"there are {len(self.far)} participants, which is the limit"
            )
        )
        return None

    def _endpoint_arrived(self, arrived: Arrived) -> None:
        sender = self.far.find(arrived.writer[:PREFIX_BYTES])
        if sender is None:
            return
        kind = _KINDS[arrived.writer[PREFIX_BYTES:]]
        try:
            gone = departed(arrived.payload, arrived.inline)
            if gone is not None:
                self._endpoint_gone(sender, gone)
                return
            endpoint = read_endpoint(arrived.payload or b"", kind)
            if self._is_wanted(endpoint):
                self._endpoint_told(sender, endpoint)
        except RtpsError as error:
            sender.refused_endpoints += 1
            self._events.warn(f"an endpoint at {sender.source[0]} is ignored: {error}")

    def _endpoint_told(self, sender: FarParticipant, endpoint: EndpointData) -> None:
        """Handle the announcement of a wanted endpoint. Raises RtpsError if it is not the sender's."""
        if endpoint.guid[:PREFIX_BYTES] != sender.prefix:
            raise RtpsError("an endpoint of another participant")
        self._add_endpoint(sender, endpoint)

    def _endpoint_gone(self, sender: FarParticipant, guid: bytes) -> None:
        if guid[:PREFIX_BYTES] == sender.prefix:
            self._forget_endpoint(guid)

    def _add_endpoint(self, far: FarParticipant, endpoint: EndpointData) -> None:
        if self.far.find_endpoint(endpoint.guid) == endpoint:
            return
        self._forget_endpoint(endpoint.guid)
        if not self.far.add_endpoint(endpoint):
            self._events.warn(
                f"endpoints of the participant at {far.source[0]} are ignored: it has more than "
                f"{len(far.endpoints)} of them"
            )
            return
        self._events.endpoint_added(endpoint, far.vendor)
        for local in list(self._by_topic.get(endpoint.topic, {}).values()):
            self._match(local, endpoint)

    def _match(self, local: Local, endpoint: EndpointData) -> None:
        far = self.far.find(endpoint.guid[:PREFIX_BYTES])
        if far is None or not is_match(local.data, endpoint):
            return
        entity = local.guid[PREFIX_BYTES:]
        reliable = local.data.policies.reliable and endpoint.policies.reliable
        self._matched.setdefault(endpoint.guid, {})[entity] = local
        self._due.touch(entity)
        if local.writer is not None:
            local.writer.add_reader(endpoint.guid, self._now_ns, reliable=reliable)
        elif local.reader is not None:
            local.reader.add_writer(endpoint.guid, far.room, self._now_ns, reliable=reliable)

    def _forget_endpoint(self, guid: bytes) -> None:
        endpoint = self.far.remove_endpoint(guid)
        for entity, local in self._matched.pop(guid, {}).items():
            self._due.touch(entity)
            if local.writer is not None:
                local.writer.remove_reader(guid)
            elif local.reader is not None:
                local.reader.remove_writer(guid)
        if endpoint is not None:
            self._events.endpoint_removed(endpoint)

    def _remove(self, far: FarParticipant) -> None:
        """Forget a participant, and its endpoints before it. A second call has no effect."""
        if self.far.find(far.prefix) is not far:
            return
        for guid in list(far.endpoints):
            self._forget_endpoint(guid)
        for entity, end in self._ends.items():
            if entity not in _BUILTIN:
                continue
            self._due.touch(entity)
            if isinstance(end, Writer):
                end.remove_reader(far.prefix + DISCOVERY_READERS[entity])
            else:
                end.remove_writer(far.prefix + _WRITERS[entity])
        self.far.remove(far)
        self._events.participant_removed(far.prefix)
