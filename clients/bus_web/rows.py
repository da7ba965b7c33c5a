"""Rows that `bus top` and the page show: topics, nodes and endpoints with their counters. Pure."""

from collections.abc import Mapping

import msgspec

from bus.names import is_hidden_node, is_hidden_topic
from bus.qos import QoSProfile

__all__ = ["Ages", "EndpointRow", "NodeRow", "Pair", "Sums", "TopicRow"]


class Ages(msgspec.Struct, frozen=True):
    """How old messages were when programs took them, of late: seconds since they were published."""

    mean: float
    """Over the last half second."""
    most: float
    """The same."""
    p50: float | None = None
    """Half of the messages of the last ten seconds were not older; None if a process does not report it."""
    p99: float | None = None
    """The same for 99 %."""

    @property
    def usual(self) -> float:
        """p50; without it, the mean."""
        return self.mean if self.p50 is None else self.p50


class Pair(msgspec.Struct, frozen=True):
    """A publisher and a subscription of one topic: they match by a `route`, or don't for a `reason`."""

    publisher: int
    """Its id in the graph."""
    subscription: int
    route: str = ""
    """`shm`, `socket`, ...; empty if the endpoints don't match."""
    reason: str = ""
    """A sentence in busd's words; empty if the endpoints match."""


class EndpointRow(msgspec.Struct, frozen=True, kw_only=True):
    """A publisher or a subscription, with its counters."""

    id: int
    """The id in the graph."""
    kind: str
    """`publisher` or `subscription`."""
    topic: str
    node: str
    """Its full name."""
    node_id: int
    pid: int
    type_name: str
    qos: QoSProfile
    messages: int
    """Published, or delivered."""
    bytes: int
    hz: float | None
    """Messages a second; None until that is known."""
    bytes_per_s: float | None
    queued: int
    """Messages that wait."""
    depth: int | None
    """How many may wait; None if the endpoint keeps all."""
    dropped: Mapping[str, int]
    """Messages lost, by reason, all in all."""
    lost_per_s: float
    """The recent rate."""
    routes: tuple[str, ...]
    """Routes of the matches, each route once."""
    age: Ages | None
    """Ages of messages that a subscription took; None if it took none recently."""
    lost_history: tuple[float, ...] = ()
    """Messages that it lost in each of the last 60 seconds, the newest last; empty if none was."""
    advice: str = ""
    """A sentence about the depth of a subscription, if its figures support one."""

    @property
    def lost(self) -> int:
        """All in all."""
        return sum(self.dropped.values())

    @property
    def is_hidden(self) -> bool:
        """Whether the node belongs to a tool."""
        return is_hidden_node(self.node.rpartition("/")[2])


class _Row(msgspec.Struct, frozen=True, kw_only=True):
    """The combined counters of some endpoints."""

    hz: float | None
    """Messages a second of all publishers; None until that is known of one."""
    bytes_per_s: float | None
    history: tuple[float, ...]
    """Hz in each of the last 60 seconds, the newest last."""
    publishers: int
    subscriptions: int
    routes: tuple[str, ...]
    """Routes of the matches, each route once."""
    queued: int
    """Messages that wait for subscriptions."""
    depth: int | None
    """Depth of the subscription with most queued messages; None if there is none, or it keeps all."""
    age: Ages | None
    """Ages of messages that subscriptions took; None if they took none recently."""
    lost_per_s: float
    """Messages that subscriptions lose, of late."""
    dropped: Mapping[str, int]
    """Messages that subscriptions have lost, by reason."""
    lost_history: tuple[float, ...]
    """Messages lost in each of the last 60 seconds, the newest last; empty if none was."""
    lost_in_all: int
    """Messages lost; for a topic also by subscriptions that have left since the first look."""
    mismatches: int
    """Pairs that don't match."""

    @property
    def lost(self) -> int:
        return sum(self.dropped.values())

    @property
    def why(self) -> str:
        """The reason of most losses; empty if no message was lost."""
        return max(self.dropped, key=self.dropped.__getitem__) if self.lost else ""


class TopicRow(_Row, frozen=True, kw_only=True):
    """A topic, with the combined counters of its endpoints."""

    topic: str
    types: tuple[str, ...]
    """More than one is a conflict."""

    @property
    def is_hidden(self) -> bool:
        return is_hidden_topic(self.topic)


class NodeRow(_Row, frozen=True, kw_only=True):
    """A node, with the combined counters of its endpoints."""

    node: str
    """Its full name."""
    id: int
    """The id in the graph."""
    pid: int

    @property
    def is_hidden(self) -> bool:
        """Whether the node belongs to a tool."""
        return is_hidden_node(self.node.rpartition("/")[2])


class Sums(msgspec.Struct, frozen=True):
    """Sums of all rows shown."""

    nodes: int
    topics: int
    hz: float
    bytes_per_s: float
    lost_per_s: float
    lost: int
