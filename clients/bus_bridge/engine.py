"""The interface between the bridge and what carries its messages: zenoh, or DDS.

The bridge knows no engine, and an engine knows neither busd nor nodes on this bus. Names are those on the
engine's wire: the namespace is on them already. Everything here happens on the event loop. An engine with
threads hands their news over to it, bounded. Values and protocols only.
"""

from collections.abc import Callable, Sequence
from typing import Literal, Protocol

import msgspec

from bus.qos import QoSProfile
from bus.schema import MessageSchema
from bus_bridge.batch import Batch

__all__ = [
    "LONG_BYTES",
    "LONG_PACK_BYTES",
    "PACK_BYTES",
    "EndpointKind",
    "Engine",
    "FarBus",
    "FarEndpoint",
    "FarNode",
    "FarSide",
    "LinkStatus",
    "LocalEndpoint",
    "LocalNode",
    "Reader",
    "RouteRule",
    "Writer",
]

EndpointKind = Literal["publisher", "subscription"]
Priority = Literal[
    "real_time", "interactive_high", "interactive_low", "data_high", "data", "data_low", "background"
]


PACK_BYTES = 47 << 10
"""The most that small messages may take together, with the head of each."""
LONG_BYTES = 16 << 10
"""From this size on, a message goes together with other long ones, not with small ones."""
LONG_PACK_BYTES = 6 * PACK_BYTES
"""The most that long messages may take together. A longer message goes alone."""


class RouteRule(msgspec.Struct, frozen=True):
    """The decision of the rules about one topic."""

    depth: int | None = None
    """How many messages may wait in the bridge; None: 1,000, or fewer of large types."""
    max_rate_hz: float | None = None
    priority: Priority = "data"
    transit: bool = False
    """Whether what another bridge has brought in goes on."""


# --- from this bus to the far side


class LocalNode(msgspec.Struct, frozen=True):
    """A node of this bus that the far side is to see."""

    id: int
    """The bridge's number for it, which no other node gets; it outlives a restart of busd."""
    name: str
    namespace: str
    via: tuple[str, ...] = ()
    """Ids of the buses that it came through before this one, its own first: in transit only."""


class LocalEndpoint(msgspec.Struct, frozen=True):
    """A publisher or subscription of this bus that the far side is to see."""

    kind: EndpointKind
    gid: bytes
    node: LocalNode
    topic: str
    type_name: str
    type_hash: str
    qos: QoSProfile


class Writer(Protocol):
    """The way out of one publisher of this bus."""

    @property
    def is_wanted(self) -> bool:
        """Whether a subscription on the far side is matched with it. For a transient local publisher it may
        always be True: its written messages serve late joiners."""

    @property
    def lost(self) -> dict[str, int]:
        """Messages that `write` counted as gone and the engine has dropped, by reason."""

    def write(self, batch: Batch) -> int:
        """Send the messages of `batch`, in order; never blocks. Returns how many of them have gone, from the
        front. The rest waits with the caller until `on_change`, or is lost there and counted."""

    def close(self) -> None:
        """The publisher has gone, and so does its mirror on the far side, behind what was written."""


# --- from the far side to this bus


class FarBus(msgspec.Struct, frozen=True):
    """A bus, or a DDS domain, that the engine has found."""

    id: str
    """Short text that no other bus has: part of names, shown to users."""


class FarNode(msgspec.Struct, frozen=True):
    """A node on a far bus."""

    key: str
    """The engine's name for it, which no other node has."""
    bus: str
    """The `id` of its FarBus."""
    name: str
    namespace: str
    via: tuple[str, ...] = ()
    """Ids of the buses that it came through, its own first, if that is not `bus`: in transit only."""
    announcer: str = ""
    """Who of its bus tells of it, where several do, each for itself; in words, shown to users. What is wrong
    is held against that one alone."""


class FarEndpoint(msgspec.Struct, frozen=True):
    """A publisher or subscription on a far bus."""

    kind: EndpointKind
    gid: bytes
    """16 bytes, the same on every bus."""
    node: str
    """The `key` of its FarNode."""
    topic: str
    type_name: str
    type_hash: str
    qos: QoSProfile


class FarSide(Protocol):
    """The receiver of what the engine finds: the bridge. Calls never raise, and may come in any order; news
    about an unknown bus, node or gid is ignored. If a bus has gone, so have all its nodes and endpoints; if a
    node has gone, so have all its endpoints.
    """

    def bus_added(self, bus: FarBus) -> None: ...
    def bus_removed(self, bus_id: str, reason: str) -> None: ...
    def node_added(self, node: FarNode) -> None: ...
    def node_removed(self, key: str) -> None: ...
    def endpoint_added(self, endpoint: FarEndpoint) -> None: ...

    def endpoint_removed(self, gid: bytes, node: str) -> None:
        """`node` is the key of its node: with transit one gid may come by two ways."""

    def warn(self, text: str) -> None:
        """Something that the user should know; the same text is said once."""


class Reader(Protocol):
    """The way in from one far publisher, while its mirror has a subscription."""

    @property
    def lost(self) -> dict[str, int]:
        """Messages that the engine had and lost, by reason."""

    def taken(self, size: int) -> None:
        """So many bytes of payload were published here. For lossless ways, whose writer waits for that."""

    def close(self) -> None:
        """No subscription is matched any more."""


class LinkStatus(msgspec.Struct, frozen=True):
    """One link, or one address that the engine tries to reach."""

    address: str
    state: Literal["up", "trying", "refused", "spare"]
    """`spare`: another address is used in its place."""
    bus: str = ""
    text: str = ""
    """Why it is not up."""


class Engine(Protocol):
    """A wire. Made with its own options; opened once."""

    name: str
    """As the user calls it: `zenoh`, `ros2`."""
    has_numbers: bool
    """Whether the messages of far publishers have numbers, by which losses on the way are counted."""
    only_bus: str
    """The id of the far bus, if it never reaches more than one; "" otherwise. Messages from there never go
    back there."""

    async def open(self, far: FarSide) -> None:
        """Begin; what is found is told `far`. Raises BridgeError. Cancellation: closed."""

    async def close(self) -> None:
        """End: the far side sees nothing of this bus any more. The bridge waits 0.3 s for it at most."""

    def announce_node(self, node: LocalNode) -> None: ...
    def withdraw_node(self, node: LocalNode) -> None: ...

    def announce_publisher(
        self,
        endpoint: LocalEndpoint,
        schema: MessageSchema,
        rule: RouteRule,
        on_change: Callable[[], None],
    ) -> Writer:
        """Show it to the far side. `on_change` is called when `is_wanted` has changed, and when `write` may
        go on.

        Raises BridgeError if the engine can't carry the type or the QoS, NotCarried if it carries
        nothing of the kind.
        """

    def announce_subscription(self, endpoint: LocalEndpoint, schema: MessageSchema) -> Callable[[], None]:
        """Show it to the far side; the result withdraws it. Raises as `announce_publisher`."""

    async def find_schema(self, endpoint: FarEndpoint) -> MessageSchema:
        """The far side's description of an endpoint's type; the bridge checks it. Raises BridgeError if it
        can't be had. Cancellation leaves nothing behind.
        """

    def read(
        self,
        endpoint: FarEndpoint,
        schema: MessageSchema,
        on_batch: Callable[[Batch], None],
    ) -> Reader:
        """Have what the far publisher sends brought here. With transient local, first what it keeps.

        Raises BridgeError.
        """

    def refuse(self, bus_id: str, reason: str, announcer: str = "") -> None:
        """End with that bus, or only with `announcer` of it, which has sent false data or exceeded a limit.

        It is ignored until it, or the bridge of that bus, comes back.
        """

    def links(self) -> Sequence[LinkStatus]: ...

    def refusals(self) -> tuple[int, str]:
        """How many connections were refused before it was known which bus asks, and why the last one was."""
