"""Far participants and their endpoints, with their leases and limits. Pure.

Owns: the present participants, the ends of their leases and their addresses. Must not know: the transport of
announcements, our own endpoints.
"""

from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from bus_bridge.rtps.announcements import EndpointData, ParticipantData
from bus_bridge.rtps.ids import PREFIX_BYTES
from bus_bridge.rtps.parameters import Address
from bus_bridge.rtps.room import Room

__all__ = ["USUAL_BOUNDS", "Bounds", "FarParticipant", "FarParticipants", "choose_address"]

_LOOPBACK: Final = "127."
_LEAST_LEASE_NS: Final = 1_000_000_000
_LONGEST_LEASE_NS: Final = 300_000_000_000
"""A participant that names a longer one, or none, still has to call now and then."""


class Bounds(NamedTuple):
    """The most that others may have here."""

    participants: int = 256
    endpoints: int = 4000
    """The most of each participant, among the wanted topics."""
    room_bytes: int = 32 << 20
    """Memory for samples of each participant that can't be delivered yet."""


USUAL_BOUNDS: Final = Bounds()


class FarParticipant:
    """One participant. `server`: the Discovery Server that announced it; empty: it did that itself."""

    def __init__(self, data: ParticipantData, source: Address, room_bytes: int, server: bytes = b"") -> None:
        self.prefix = data.prefix
        self.servers = {server} if server else set()
        """Prefixes of the Discovery Servers that announce it."""
        self.room = Room(room_bytes)
        self.endpoints: dict[bytes, EndpointData] = {}
        self.refused_endpoints = 0
        """Announcements that were wrong, or above the limit."""
        self.update(data, source)

    def update(self, data: ParticipantData, source: Address) -> None:
        """Take over its newest announcement, from `source`: its own address, or the address of a server."""
        self.data = data
        self.source = source
        self.vendor = data.vendor
        self.discovery_address = choose_address(data.discovery_addresses, source)
        self.address = choose_address(data.addresses or data.discovery_addresses, source)
        self.lease_ns = min(max(data.lease_ns, _LEAST_LEASE_NS), _LONGEST_LEASE_NS)

    def heard_from(self, source: Address) -> None:
        """Use the address from which it sends, if it has announced that one.

        A server's announcement has all its addresses, and does not say which of them can be reached.
        """
        if self.servers and source[0] != self.source[0]:
            named = (*self.data.addresses, *self.data.discovery_addresses)
            if source[0] in (one[0] for one in named):
                self.update(self.data, source)

    def address_of(self, guid: bytes) -> Address | None:
        """The address for samples to its endpoint, or from there."""
        endpoint = self.endpoints.get(guid)
        if endpoint is not None and endpoint.addresses:
            return choose_address(endpoint.addresses, self.source)
        return self.address


class FarParticipants:
    """All far participants, by prefix."""

    def __init__(self, bounds: Bounds) -> None:
        self.refused = 0
        """Announcements of further participants, above the limit."""
        self._bounds = bounds
        self._by_prefix: dict[bytes, FarParticipant] = {}
        self._expires_ns: dict[bytes, int] = {}
        self._by_topic: dict[str, dict[bytes, EndpointData]] = {}

    def __iter__(self) -> Iterator[FarParticipant]:
        return iter(list(self._by_prefix.values()))

    def __len__(self) -> int:
        return len(self._by_prefix)

    def find(self, prefix: bytes) -> FarParticipant | None:
        return self._by_prefix.get(prefix)

    def add(
        self, data: ParticipantData, source: Address, now_ns: int, server: bytes = b""
    ) -> FarParticipant | None:
        """Note a new participant; None if there are too many, or if it has no address for announcements."""
        if len(self._by_prefix) >= self._bounds.participants:
            self.refused += 1
            return None
        far = FarParticipant(data, source, self._bounds.room_bytes, server)
        if far.discovery_address is None:
            self.refused += 1
            return None
        self._by_prefix[far.prefix] = far
        self.refresh(far, now_ns)
        return far

    def refresh(self, far: FarParticipant, now_ns: int) -> None:
        """It has given a sign of life."""
        self._expires_ns[far.prefix] = now_ns + far.lease_ns

    def expired(self, now_ns: int) -> list[FarParticipant]:
        """Participants whose lease has ended, without those that a Discovery Server watches."""
        due = [self._by_prefix[prefix] for prefix, end in self._expires_ns.items() if end <= now_ns]
        return [far for far in due if not far.servers]

    def lose_server(self, far: FarParticipant, server: bytes, now_ns: int) -> bool:
        """That server does not announce it any more; returns whether no server does now.

        From then on its own lease counts.
        """
        if server not in far.servers:
            return False
        far.servers.discard(server)
        self.refresh(far, now_ns)
        return not far.servers

    def remove(self, far: FarParticipant) -> None:
        """Forget a participant and its endpoints."""
        for guid in list(far.endpoints):
            self.remove_endpoint(guid)
        self._by_prefix.pop(far.prefix, None)
        self._expires_ns.pop(far.prefix, None)

    def add_endpoint(self, endpoint: EndpointData) -> bool:
        """Note an endpoint of a known participant; returns whether there was room for it."""
        far = self._by_prefix[endpoint.guid[:PREFIX_BYTES]]
        if len(far.endpoints) >= self._bounds.endpoints:
            far.refused_endpoints += 1
            return False
        far.endpoints[endpoint.guid] = endpoint
        self._by_topic.setdefault(endpoint.topic, {})[endpoint.guid] = endpoint
        return True

    def remove_endpoint(self, guid: bytes) -> EndpointData | None:
        """Forget an endpoint; returns it, or None if it is not known."""
        far = self._by_prefix.get(guid[:PREFIX_BYTES])
        endpoint = None if far is None else far.endpoints.pop(guid, None)
        if endpoint is not None:
            of_topic = self._by_topic[endpoint.topic]
            del of_topic[guid]
            if not of_topic:
                del self._by_topic[endpoint.topic]
        return endpoint

    def find_endpoint(self, guid: bytes) -> EndpointData | None:
        far = self._by_prefix.get(guid[:PREFIX_BYTES])
        return None if far is None else far.endpoints.get(guid)

    def of_topic(self, topic: str) -> Mapping[bytes, EndpointData]:
        """Endpoints of a topic, by GUID."""
        return self._by_topic.get(topic, {})


def choose_address(addresses: tuple[Address, ...], source: Address) -> Address | None:
    """The address of a participant to use, if its announcement came from `source`.

    A participant of this machine may name all addresses of the machine. Then loopback is the nearest one.
    """
    if not addresses:
        return None
    host = source[0]
    for one in addresses:
        if one[0] == host:
            return one
    if host.startswith(_LOOPBACK):
        return host, addresses[0][1]
    return addresses[0]
