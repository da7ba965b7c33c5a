"""A participant that is a client of Discovery Servers of Fast DDS. Pure.

It announces itself to the servers only, and learns of all others from them. It hears of participants by a
third pair of a reliable writer and a reader, and of their endpoints by the writers of the server. Samples go
directly.

Owns: the choice of trusted servers, and the knowledge that stays while servers come and go. Participants that
a server announces have no separate lease: the server watches them. Without a server, this participant asks
them for signs of life.
"""

from collections.abc import Callable, Iterable
from typing import Final, NamedTuple

from bus_bridge.rtps.announcements import EndpointData, ParticipantData, departed, read_participant
from bus_bridge.rtps.far import FarParticipant, choose_address
from bus_bridge.rtps.ids import PREFIX_BYTES, SPDP_READER, SPDP_WRITER
from bus_bridge.rtps.messages import Data
from bus_bridge.rtps.own_announcements import Settings
from bus_bridge.rtps.parameters import Address, RtpsError
from bus_bridge.rtps.participant import OF_DISCOVERY, Events, Participant
from bus_bridge.rtps.reader import Arrived, Reader
from bus_bridge.rtps.writer import Writer

__all__ = ["ClientParticipant"]

_LOOPBACK: Final = "127."
_EARLY_NS: Final = 60_000_000_000
"""Time for which an endpoint waits for its participant."""
_DOUBT_NS: Final = 30_000_000_000
"""Time for a server that is back to announce the endpoints of a participant again."""
_AGAIN_NS: Final = 60_000_000_000
"""Time between two complete lists of a server."""
_MOST_RENEWED: Final = 64
_PAUSE_NS: Final = 1_500_000_000
"""Time for a server to handle the end of this participant: it forgets an end that is followed by a call."""
_SILENCE_NS: Final = 10_000_000_000
"""Time without any server before the user is told."""


class _Early(NamedTuple):
    """An endpoint that a server has announced before its participant."""

    server: bytes
    endpoint: EndpointData
    until_ns: int


class ClientParticipant(Participant):
    """A participant whose settings have servers as peers, and `is_client`."""

    def __init__(
        self,
        settings: Settings,
        transmit: Callable[[Address, bytes], None],
        events: Events,
        is_wanted: Callable[[EndpointData], bool],
    ) -> None:
        super().__init__(settings, transmit, events, is_wanted)
        restarted = self._server_restarted
        self._listing = Writer(SPDP_WRITER, self._send, OF_DISCOVERY, on_restart=restarted)
        self._ends[SPDP_WRITER] = self._listing
        self._ends[SPDP_READER] = Reader(SPDP_READER, self._send, self._listed, on_restart=restarted)
        self._early: dict[bytes, _Early] = {}
        """By GUID."""
        self._doubted: dict[bytes, set[bytes]] = {}
        """GUIDs of endpoints that were announced by servers that have gone, by participant."""
        self._doubt_ends_ns: dict[bytes, int] = {}
        self._renewed: set[bytes] = set()
        """Prefixes of servers that have to announce everything once more."""
        self._has_refused = False
        """Whether there was no place for a participant. Servers announce each only once."""
        self._again_ns = 0
        self._warn_ns = 0

    def start(self, now_ns: int) -> None:
        self._list(now_ns)
        self._warn_ns = now_ns + _SILENCE_NS
        super().start(now_ns)

    # --- participants

    def _list(self, now_ns: int) -> None:
        """Write the announcement of this participant for servers, with a new number."""
        self._own.number = self._listing.last + 1
        inline = self._own.inline(SPDP_WRITER, self._own.number)
        self._listing.write(self._own.description, now_ns, now_ns, inline=inline)

    def _called(self) -> Iterable[Address]:
        return self._settings.peers

    def _servers(self) -> list[FarParticipant]:
        return [far for far in self.far if far.data.is_server]

    def _participant_arrived(self, one: Data, prefix: bytes, source: Address) -> bool:
        """A Discovery Server may have announced itself for the first time. Else, its reader takes it."""
        if self.far.find(prefix) is None:
            try:
                data = read_participant(one.payload or b"", prefix)
            except RtpsError:
                return False  # about another participant: a known server repeats it
            if data.is_server and self._is_chosen(data, source):
                self._meet_server(data, source)
        return False

    def _meet_server(self, data: ParticipantData, source: Address) -> None:
        """A server announces itself. It does not repeat samples that this participant has acknowledged to it.

        So if it must repeat everything, it gets the end of this participant, and later its announcement.
        """
        if data.prefix in self._renewed and data.discovery_addresses:
            self._renewed.discard(data.prefix)
            address = choose_address(data.discovery_addresses, source)
            assert address is not None
            self._outbox.put_for_all(address, [self._own.disposal()])
            self._listing.withdraw(self._own.number)
            self._listing.write(None, self._now_ns, self._now_ns, stays=False)  # the number of the disposal
            self._list(self._now_ns)
            self._announce_ns = self._now_ns + _PAUSE_NS
        else:
            self._meet(data, source)

    def _is_chosen(self, data: ParticipantData, source: Address) -> bool:
        """Whether the settings name a server. It may answer from another address of its machine."""
        hosts = {peer[0] for peer in self._settings.peers}
        is_here = source[0] in {one[0] for one in self._settings.addresses}
        return (
            source[0] in hosts
            or any(one in self._settings.peers for one in data.discovery_addresses)
            or (is_here and any(host.startswith(_LOOPBACK) for host in hosts))
        )

    def _listed(self, arrived: Arrived) -> None:
        """A Discovery Server announces a participant, which may be itself, or its end."""
        server = self.far.find(arrived.writer[:PREFIX_BYTES])
        if server is None:
            return
        try:
            gone = departed(arrived.payload, arrived.inline)
            data = None if gone is not None else read_participant(arrived.payload or b"", None)
        except RtpsError as error:
            self._events.warn(f"a participant that {server.source[0]} announces is ignored: {error}")
            return
        if data is None:
            self._unlisted((gone or b"")[:PREFIX_BYTES], server)
            return
        known = self.far.find(data.prefix)
        if known is server:
            if data.is_server and data.discovery_addresses:
                server.update(data, server.source)
        elif data.is_server or data.prefix == self.prefix or (known is not None and known.data.is_server):
            return  # servers announce themselves
        elif known is not None:
            if not known.servers and known.prefix in self._doubted:
                self._doubt_ends_ns[known.prefix] = self._now_ns + _DOUBT_NS
            known.servers.add(server.prefix)
            known.update(data, known.source)
            self._add_early(known, server)
        elif (far := self._add_participant(data, server.source, server.prefix)) is not None:
            self._add_early(far, server)
        else:
            self._has_refused = True

    def _unlisted(self, prefix: bytes, server: FarParticipant) -> None:
        """A server announces the end of a participant."""
        self._pop_early(prefix, server)
        known = self.far.find(prefix)
        if known is server or (known and self.far.lose_server(known, server.prefix, self._now_ns)):
            self._remove(known)

    def _server_restarted(self, guid: bytes) -> None:
        """A Discovery Server has restarted, with the GUID that it had before."""
        if (server := self.far.find(guid[:PREFIX_BYTES])) is not None:
            self._renew(server)

    def _renew(self, server: FarParticipant) -> None:
        """Forget a server. At its next announcement of itself, it is asked for everything."""
        self._remove(server)
        self._renewed = {server.prefix, *list(self._renewed)[:_MOST_RENEWED]}

    def _remove(self, far: FarParticipant) -> None:
        super()._remove(far)
        self._doubted.pop(far.prefix, None)
        self._doubt_ends_ns.pop(far.prefix, None)
        if far.data.is_server:
            self._warn_ns = self._now_ns + _SILENCE_NS
            self._early = {guid: one for guid, one in self._early.items() if one.server != far.prefix}
            for listed in self.far:
                if self.far.lose_server(listed, far.prefix, self._now_ns):
                    self._doubted[listed.prefix] = set(listed.endpoints)
                    self._doubt_ends_ns.pop(listed.prefix, None)

    def _check_leases(self) -> None:
        super()._check_leases()
        now_ns = self._now_ns
        servers = self._servers()
        if not servers and now_ns >= self._warn_ns:
            self._events.warn("no Discovery Server answers: no other participants can be found")
        has_room = len(self.far) < self._settings.bounds.participants
        if self._has_refused and has_room and now_ns >= self._again_ns:
            self._has_refused, self._again_ns = False, now_ns + _AGAIN_NS
            for server in servers:
                self._renew(server)
        for far in self.far:
            is_orphan = not far.servers and not far.data.is_server
            if is_orphan and not self._ask_for_life(far) and not servers:
                self.far.refresh(far, now_ns)  # there is no server that would know it
        self._early = {guid: one for guid, one in self._early.items() if one.until_ns > now_ns}
        for prefix in [prefix for prefix, end_ns in self._doubt_ends_ns.items() if end_ns <= now_ns]:
            del self._doubt_ends_ns[prefix]
            for guid in self._doubted.pop(prefix, ()):
                self._forget_endpoint(guid)

    def _ask_for_life(self, far: FarParticipant) -> bool:
        """Ask a participant that no server watches for a sign of life; returns whether that was possible."""
        for guid in far.endpoints:
            for local in self._matched.get(guid, {}).values():
                end = local.writer or local.reader
                if end is not None and end.ask(guid, self._now_ns):
                    return True
        return False

    # --- endpoints

    def _endpoint_told(self, sender: FarParticipant, endpoint: EndpointData) -> None:
        """An endpoint of the sender, or of a participant that it announces, now or later."""
        prefix = endpoint.guid[:PREFIX_BYTES]
        far = self.far.find(prefix)
        if far is not None and (far is sender or sender.prefix in far.servers):
            self._add_endpoint(far, endpoint)
        elif not sender.data.is_server or prefix == self.prefix or (far is not None and far.data.is_server):
            raise RtpsError("an endpoint of another participant")
        elif len(self._early) < self._settings.bounds.endpoints:
            self._early[endpoint.guid] = _Early(sender.prefix, endpoint, self._now_ns + _EARLY_NS)
        else:
            self._events.warn(
                f"endpoints that {sender.source[0]} announces are ignored: their participants are not known"
            )

    def _endpoint_gone(self, sender: FarParticipant, guid: bytes) -> None:
        if guid in self._early and self._early[guid].server == sender.prefix:
            del self._early[guid]
        far = self.far.find(guid[:PREFIX_BYTES])
        if far is not None and (far is sender or sender.prefix in far.servers):
            self._forget_endpoint(guid)

    def _add_endpoint(self, far: FarParticipant, endpoint: EndpointData) -> None:
        self._doubted.get(far.prefix, set()).discard(endpoint.guid)
        super()._add_endpoint(far, endpoint)

    def _add_early(self, far: FarParticipant, server: FarParticipant) -> None:
        """Add the endpoints of a participant that this server has announced before it."""
        for endpoint in self._pop_early(far.prefix, server):
            self._add_endpoint(far, endpoint)

    def _pop_early(self, prefix: bytes, server: FarParticipant) -> list[EndpointData]:
        found = [
            guid
            for guid, early in self._early.items()
            if guid.startswith(prefix) and early.server == server.prefix
        ]
        return [self._early.pop(guid).endpoint for guid in found]
