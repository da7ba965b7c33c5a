"""The graph of ROS 2 in a DDS domain: its nodes, and the node of each endpoint.

Owns: the messages in which participants list their nodes, in both directions; the nodes and endpoints of all
participants; and the conclusions from each piece of news. Knows no clock (times come in) and no DDS.
"""

import struct
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple, TypeAlias

import msgspec

from bus_bridge.dds.names import bare_node_name
from bus_bridge.engine import FarEndpoint, FarNode

__all__ = [
    "GID_SIZE",
    "HUMBLE_GID_SIZE",
    "Added",
    "DomainGraph",
    "Found",
    "NodeEntities",
    "Removed",
    "announcer_of",
    "decode",
    "encode",
    "participant_of",
]

GID_SIZE: Final = 16
HUMBLE_GID_SIZE: Final = 24
"""Size of gids up to Humble; the last eight bytes are zero."""
_GUID_SIZE: Final = 16
_MAX_TEXT: Final = 256
_MAX_BYTES: Final = 1 << 20
_MAX_NODES: Final = 4096
"""The limits of one participant's list. Above them, decoding a hostile list would take many seconds."""
_HEAD: Final = b"\0\1\0\0"


class NodeEntities(NamedTuple):
    """A node, and the gids of its readers and writers."""

    namespace: str
    name: str
    readers: tuple[bytes, ...] = ()
    writers: tuple[bytes, ...] = ()


def encode(participant: bytes, nodes: Sequence[NodeEntities], gid_size: int = GID_SIZE) -> bytes:
    """Encode a ParticipantEntitiesInfo in CDR. Gids have 16 bytes here."""
    parts = [_HEAD, participant.ljust(gid_size, b"\0"), struct.pack("<I", len(nodes))]
    size = gid_size + 4  # a multiple of four, as is the size of each other part
    for node in nodes:
        for text in (node.namespace, node.name):
            encoded = text.encode() + b"\0"
            parts.append(struct.pack("<I", len(encoded)) + encoded)
            padding = -len(encoded) % 4
            parts.append(b"\0" * padding)
            size += 4 + len(encoded) + padding
        for gids in (node.readers, node.writers):
            parts.append(struct.pack("<I", len(gids)))
            parts.extend(gid.ljust(gid_size, b"\0") for gid in gids)
    return b"".join(parts)


def decode(data: bytes, gid_size: int = GID_SIZE) -> tuple[bytes, list[NodeEntities]]:
    """Decode the participant and its nodes. Raises ValueError for malformed data, and above the limits of
    bytes and nodes."""
    if len(data) > _MAX_BYTES:
        raise ValueError(f"it has {len(data):,} bytes; the limit is {_MAX_BYTES:,}")
    if data[:2] not in (b"\0\0", b"\0\1"):
        raise ValueError(f"it begins with {data[:4].hex(' ')}")
    take = _Taker(data[4:], "<I" if data[1] else ">I")
    participant = take.bytes(gid_size)[:_GUID_SIZE]
    count = take.count(16)
    if count > _MAX_NODES:
        raise ValueError(f"it has {count:,} nodes; the limit is {_MAX_NODES:,}")
    nodes = []
    for _ in range(count):
        namespace, name = take.text(), take.text()
        readers, writers = (
            tuple(take.bytes(gid_size)[:_GUID_SIZE] for _ in range(take.count(gid_size))) for _ in range(2)
        )
        nodes.append(NodeEntities(namespace, name, readers, writers))
    return participant, nodes


class _Taker:
    def __init__(self, data: bytes, number: str) -> None:
        self._data = data
        self._number = struct.Struct(number)
        self._at = 0

    def bytes(self, size: int) -> bytes:
        found = self._data[self._at : self._at + size]
        if len(found) < size:
            raise ValueError(f"it ends after {len(self._data)} bytes")
        self._at += size
        return found

    def count(self, least: int) -> int:
        """Read a count of items with at least `least` bytes each."""
        self._at += -self._at % 4
        count: int = self._number.unpack(self.bytes(4))[0]
        if count * least > len(self._data) - self._at:
            raise ValueError(f"{count} are said to follow in {len(self._data) - self._at} bytes")
        return count

    def text(self) -> str:
        size = self.count(1)
        if size > _MAX_TEXT + 1:
            raise ValueError(f"a name of {size} bytes")
        return self.bytes(size).rstrip(b"\0").decode()


def announcer_of(participant: bytes) -> str:
    """The bridge's name for a participant, which only announces its own nodes."""
    return f"participant {participant.hex()}"


def participant_of(announcer: str) -> bytes:
    """The participant of an announcer's name: the reverse of `announcer_of`."""
    return bytes.fromhex(announcer.rpartition(" ")[2])


class Found(NamedTuple):
    """An endpoint found by discovery; `endpoint.node` is still empty."""

    participant: bytes
    endpoint: FarEndpoint


class Added(NamedTuple):
    what: FarNode | FarEndpoint


class Removed(NamedTuple):
    node: str
    """The key of the node."""
    gid: bytes = b""
    """The gid of its endpoint, if only the endpoint has gone."""


News: TypeAlias = Iterator[Added | Removed]


class DomainGraph:
    """The known part of a domain. Each method returns news, in the order in which they must be reported.

    An endpoint is reported once its node is known. Some endpoints belong to no node, because their program
    uses DDS without ROS 2, or because their participant has not named a node in time. They get a node that
    stands for their participant.
    """

    def __init__(self, bus: str, patience_s: float = 1.0) -> None:
        self._bus = bus
        self._patience_s = patience_s
        self._found: dict[bytes, Found] = {}
        self._owners: dict[bytes, str] = {}
        """Keys of nodes by gid of the endpoint, as named by participants."""
        self._told: dict[bytes, str] = {}
        """Nodes under which endpoints were reported, by gid."""
        self._nodes: dict[bytes, dict[str, NodeEntities]] = {}
        """Nodes by participant and key."""
        self._bare: dict[str, set[bytes]] = {}
        """Endpoints that were reported under a participant's own node, by that node's key."""
        self._waiting: dict[bytes, float] = {}
        """The time until which an endpoint waits for its node, by gid."""
        self._speak_dds_alone: set[bytes] = set()
        """Participants without ROS 2."""

    @property
    def next_time(self) -> float | None:
        """The next time at which `pass_time` has to act; None if there is none."""
        return min(self._waiting.values(), default=None)

    @property
    def participants(self) -> int:
        """The number of participants with nodes or endpoints."""
        return len({*self._nodes, *(found.participant for found in self._found.values())})

    def endpoints_of(self, participant: bytes) -> list[bytes]:
        """The gids of a participant's endpoints."""
        return [gid for gid, found in self._found.items() if found.participant == participant]

    def participant_added(self, participant: bytes, *, speaks_ros: bool) -> None:
        """Add a participant. If it does not use ROS 2, its endpoints don't wait for names of nodes."""
        if speaks_ros:
            self._speak_dds_alone.discard(participant)
        else:
            self._speak_dds_alone.add(participant)

    def nodes_said(self, participant: bytes, nodes: Sequence[NodeEntities]) -> News:
        """Handle a participant's list of all its nodes, and of the node of each endpoint."""
        before = self._nodes.get(participant, {})
        now: dict[str, NodeEntities] = {}
        counts: Counter[str] = Counter()
        for node in nodes:
            name = f"{participant.hex()}:{node.namespace.rstrip('/')}/{node.name}"
            counts[name] += 1
            now[name if counts[name] == 1 else f"{name}#{counts[name]}"] = node
        # A participant only names its own endpoints: their gids begin like its own gid.
        owners = {
            gid: key
            for key, node in now.items()
            for gid in (*node.readers, *node.writers)
            if gid[:12] == participant[:12]
        }
        for node in before.values():
            for gid in (*node.readers, *node.writers):
                if owners.get(gid) != self._owners.get(gid) and self._owners.get(gid) in before:
                    del self._owners[gid]
                    if self._told.get(gid) in before:
                        yield from self._untell(gid)
        for key in before:
            if key not in now:
                yield Removed(key)
        self._nodes[participant] = now
        if not now:
            del self._nodes[participant]
        for key, node in now.items():
            if key not in before:
                yield Added(
                    FarNode(key, self._bus, node.name, node.namespace, announcer=announcer_of(participant))
                )
        self._owners.update(owners)
        for gid in owners:
            if gid in self._found:
                yield from self._report(gid)

    def endpoint_added(self, found: Found, now: float) -> News:
        """Handle an endpoint found by discovery, or a change of its description."""
        gid = found.endpoint.gid
        if gid in self._found:
            yield from self.endpoint_removed(gid)
        self._found[gid] = found
        if gid in self._owners or found.participant in self._speak_dds_alone:
            yield from self._report(gid)
        else:
            self._waiting[gid] = now + self._patience_s

    def endpoint_removed(self, gid: bytes) -> News:
        """Remove an endpoint."""
        yield from self._untell(gid)
        self._waiting.pop(gid, None)
        self._found.pop(gid, None)

    def participant_removed(self, participant: bytes) -> News:
        """Remove a participant with its endpoints and nodes."""
        self._speak_dds_alone.discard(participant)
        for gid in self.endpoints_of(participant):
            yield from self.endpoint_removed(gid)
        yield from self.nodes_said(participant, ())

    def pass_time(self, now: float) -> News:
        """Report endpoints if no participant has named their node in time."""
        for gid in [gid for gid, end in self._waiting.items() if end <= now]:
            yield from self._report(gid)

    def _report(self, gid: bytes) -> News:
        found = self._found[gid]
        self._waiting.pop(gid, None)
        key = self._owners.get(gid)
        if key is not None and self._told.get(gid) == key:
            return
        yield from self._untell(gid)
        if key is None:
            key = found.participant.hex()
            if key not in self._bare:
                self._bare[key] = set()
                name, announcer = bare_node_name(found.participant), announcer_of(found.participant)
                yield Added(FarNode(key, self._bus, name, "/", announcer=announcer))
            self._bare[key].add(gid)
        self._told[gid] = key
        yield Added(msgspec.structs.replace(found.endpoint, node=key))

    def _untell(self, gid: bytes) -> News:
        key = self._told.pop(gid, None)
        if key is None:
            return
        yield Removed(key, gid)
        if key in self._bare:
            self._bare[key].discard(gid)
            if not self._bare[key]:
                del self._bare[key]
                yield Removed(key)
