"""The interface between the bridge and the carrier of its messages: zenoh or DDS.

The bridge knows no engine, and an engine knows neither busd nor nodes on this bus. Names are names on the
engine's wire, which include the namespace. Everything here runs on the event loop. An engine with threads
passes their news to the loop through bounded queues. Values and protocols only.
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
"""The maximum size of a pack of small messages, with the head of each."""
LONG_BYTES = 16 << 10
"""From this size on, messages are packed with other long ones, not with small ones."""
LONG_PACK_BYTES = 6 * PACK_BYTES
"""The maximum size of a pack of long messages. A longer message is sent alone."""


class RouteRule(msgspec.Struct, frozen=True):
    """The decision of the rules about one topic."""

    depth: int | None = None
    """Number of messages that may wait in the bridge; None: 1,000, or fewer of large types."""
    max_rate_hz: float | None = None
    priority: Priority = "data"
    transit: bool = False
    """Whether messages brought in by another bridge are sent on."""


# --- from this bus to the far side


class LocalNode(msgspec.Struct, frozen=True):
    """A node of this bus that the far side may see."""

    id: int
    """The bridge's number for the node, never used again; it outlives a restart of busd."""
    name: str
    namespace: str
    via: tuple[str, ...] = ()
    """Ids of the buses that it came through before this one, starting with its own: only in transit."""


class LocalEndpoint(msgspec.Struct, frozen=True):
    """A publisher or subscription of this bus that the far side may see."""

    kind: EndpointKind
    gid: bytes
    node: LocalNode
    topic: str
    type_name: str
    type_hash: str
    qos: QoSProfile


class Writer(Protocol):
    """The route out of one publisher of this bus."""

    @property
    def is_wanted(self) -> bool:
        """Whether a subscription on the far side is matched with the publisher.

        May always be True for a transient local publisher, because late joiners get its written messages.
        """

    @property
    def lost(self) -> dict[str, int]:
        """Messages that `write` accepted and the engine then dropped, by reason."""

    def write(self, batch: Batch) -> int:
        """Send the messages of `batch`, in order; never blocks. Returns how many of the first ones were sent.

        The rest waits with the caller until `on_change`, or the caller drops and counts it.
        """

    def close(self) -> None:
        """Remove the publisher and its mirror on the far side, after all written messages."""


# --- from the far side to this bus


class FarBus(msgspec.Struct, frozen=True):
    """A bus, or a DDS domain, that the engine has found."""

    id: str
    """A short unique text: part of names, and shown to users."""


class FarNode(msgspec.Struct, frozen=True):
    """A node on a far bus."""

    key: str
    """The engine's unique name for the node."""
    bus: str
    """The `id` of its FarBus."""
    name: str
    namespace: str
    via: tuple[str, ...] = ()
    """Ids of the buses that it came through, starting with its own, if that is not `bus`: only in transit."""
    announcer: str = ""
    """The source of the news within its bus, if the bus has several independent ones. The text is shown to
    users. If the news are wrong, only this announcer is refused."""


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
    """The receiver of the engine's news: the bridge.

    Calls never raise, and may come in any order. News about an unknown bus, node or gid are ignored. The
    removal of a bus removes all its nodes and endpoints, and the removal of a node all its endpoints.
    """

    def bus_added(self, bus: FarBus) -> None: ...
    def bus_removed(self, bus_id: str, reason: str) -> None: ...
    def node_added(self, node: FarNode) -> None: ...
    def node_removed(self, key: str) -> None: ...
    def endpoint_added(self, endpoint: FarEndpoint) -> None: ...

    def endpoint_removed(self, gid: bytes, node: str) -> None:
        """`node` is the key of its node: with transit, a gid may come by two ways."""

    def warn(self, text: str) -> None:
        """Report a problem to the user; the same text is reported once."""


class Reader(Protocol):
    """The route in from one far publisher, while its mirror has a subscription."""

    @property
    def lost(self) -> dict[str, int]:
        """Messages lost in the engine, by reason."""

    def taken(self, size: int) -> None:
        """Confirm that `size` bytes of payload were published here. A lossless writer waits for this."""

    def close(self) -> None:
        """Stop reading: no subscription is matched any more."""


class LinkStatus(msgspec.Struct, frozen=True):
    """One link, or one address that the engine tries to reach."""

    address: str
    state: Literal["up", "trying", "refused", "spare"]
    """`spare`: another address is used instead."""
    bus: str = ""
    text: str = ""
    """The reason why it is not up."""


class Engine(Protocol):
    """A carrier of messages. Made with its own options; opened once."""

    name: str
    """The users' name for it: `zenoh`, `ros2`."""
    has_numbers: bool
    """Whether messages of far publishers have numbers. With numbers, the bridge counts losses on the way."""
    only_bus: str
    """The id of the far bus if the engine never reaches more than one; otherwise "". Messages from there
    never go back there."""

    async def open(self, far: FarSide) -> None:
        """Start, and report everything found to `far`. Raises BridgeError. Cancellation: closed."""

    async def close(self) -> None:
        """End: the far side sees nothing of this bus any more. The bridge waits at most 0.3 s for it."""

    def announce_node(self, node: LocalNode) -> None: ...
    def withdraw_node(self, node: LocalNode) -> None: ...

    def announce_publisher(
        self,
        endpoint: LocalEndpoint,
        schema: MessageSchema,
        rule: RouteRule,
        on_change: Callable[[], None],
    ) -> Writer:
        """Show a publisher to the far side. `on_change` is called if `is_wanted` has changed, or `write` may
        have room.

        Raises BridgeError if the engine can't carry the type or the QoS, and NotCarried if it never carries
        this kind of endpoint.
        """

    def announce_subscription(self, endpoint: LocalEndpoint, schema: MessageSchema) -> Callable[[], None]:
        """Show a subscription to the far side; the result withdraws it. Raises like `announce_publisher`."""

    async def find_schema(self, endpoint: FarEndpoint) -> MessageSchema:
        """Ask the far side for the description of an endpoint's type. The bridge checks the description.

        Raises BridgeError if there is none. Cancellation leaves nothing behind.
        """

    def read(
        self,
        endpoint: FarEndpoint,
        schema: MessageSchema,
        on_batch: Callable[[Batch], None],
        *,
        restores: bool = False,
    ) -> Reader:
        """Read messages of a far publisher, with transient local first the messages that it keeps.

        `restores`: these are needed again, although they were read before: the mirror is a new one.

        Raises BridgeError.
        """

    def refuse(self, bus_id: str, reason: str, announcer: str = "") -> None:
        """Refuse a bus, or only its `announcer`, because it has sent false data or exceeded a limit.

        It is ignored until it, or the bridge of that bus, comes back.
        """

    def links(self) -> Sequence[LinkStatus]: ...

    def refusals(self) -> tuple[int, str]:
        """The number of connections refused before the other bus was known, and the reason of the last
        refusal."""
