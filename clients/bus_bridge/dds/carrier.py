"""The interface between the engine and the carrier of topics: cyclonedds, or our RTPS. Values and protocols
only."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, Protocol

from bus_bridge.batch import Batch
from bus_bridge.dds.graph import NodeEntities
from bus_bridge.engine import EndpointKind, FarEndpoint, LocalEndpoint, Reader, Writer
from bus_bridge.ros2.known_types import KnownType
from bus_bridge.rtps.policies import Policies

__all__ = ["Carrier", "Discovered", "Listener", "NodeTopic", "TopicReader", "TopicWriter"]


class Discovered(NamedTuple):
    """A far endpoint, as discovery describes it."""

    handle: int
    """The carrier's number for it."""
    participant: bytes
    kind: EndpointKind
    gid: bytes
    topic: str
    """In DDS: `rt/chatter`"""
    type_name: str
    policies: Policies
    user_data: Mapping[str, str]


class NodeTopic(Protocol):
    """The topic on which participants list their nodes, as discovery needs it."""

    def writer_added(self, handle: int, participant: bytes, is_humble: bool) -> None: ...
    def writer_removed(self, handle: int) -> None: ...
    def ignore(self, handle: int) -> None:
        """The writer belongs to another busd."""


class Listener(Protocol):
    """The receiver of a carrier's news. Handles of endpoints that it reports may not change."""

    def participant_added(self, participant: bytes, user_data: Mapping[str, str]) -> None: ...
    def participant_removed(self, participant: bytes) -> None: ...
    def endpoint_added(self, found: Discovered) -> None:
        """Called for a changed description, too."""

    def endpoint_removed(self, gid: bytes, handle: int) -> None: ...
    def nodes_said(self, participant: bytes, nodes: list[NodeEntities]) -> None: ...
    def changed(self) -> None:
        """Called after each piece of news, or several."""

    def is_marked(self, handle: int) -> bool:
        """Whether the endpoint belongs to another busd, or to a refused participant."""

    def is_mirrored(self, gid: bytes) -> bool:
        """Whether the endpoint of a topic was reported to the bridge."""

    def is_far(self, handle: int) -> bool:
        """Whether the endpoint is known, and belongs to no busd."""


class TopicWriter(Writer, Protocol):
    """The route out of a publisher."""

    gid: bytes

    def update(self) -> None:
        """Update whether it is wanted: discovery has changed."""


class TopicReader(Protocol):
    """A reader for a subscription of this bus."""

    @property
    def gid(self) -> bytes: ...


class Carrier(Protocol):
    """One participant in a domain, which carries topics. Made with the options."""

    has_numbers: bool
    """As of an Engine."""

    def open(
        self,
        listener: Listener,
        nodes: Callable[[], Sequence[NodeEntities]],
        warn: Callable[[str], None],
    ) -> NodeTopic:
        """Report everything found to `listener`, from the next turn of the event loop on.

        `nodes` returns our nodes. `warn` gets texts for the user.
        """

    def say_nodes(self) -> None:
        """List our nodes again, soon: they have changed."""

    def make_writer(
        self,
        endpoint: LocalEndpoint,
        known: KnownType,
        policies: Policies,
        on_change: Callable[[], None],
        on_close: Callable[[TopicWriter], object],
    ) -> TopicWriter:
        """Make a writer; `on_close` gets it at its end. Raises BridgeError."""

    def make_reader(self, endpoint: LocalEndpoint, known: KnownType, policies: Policies) -> TopicReader:
        """Make a reader. Raises BridgeError."""

    def retire_reader(self, reader: TopicReader) -> None:
        """End a reader, without a loss for the readers that stay."""

    def read(
        self,
        endpoint: FarEndpoint,
        handle: int,
        known: KnownType,
        on_batch: Callable[[Batch], None],
        *,
        restores: bool,
    ) -> Reader:
        """Pass on the messages of a far publisher. `restores`: also those that were passed on before, if they
        come again."""

    def update(self) -> None:
        """Discovery has changed: update the routes in."""

    def leave(self) -> None:
        """End everything, after the writers; threads may still tell other participants."""

    def close(self) -> None:
        """End those threads. A second call has no effect."""
