"""Events of an endpoint other than messages, as values; names and counts follow ROS 2's status events.

Counts named `..._change` are since the last event of that kind.
"""

from collections.abc import Callable
from typing import NamedTuple

import msgspec

__all__ = [
    "DeadlineMissed",
    "IncompatibleQoS",
    "IncompatibleType",
    "LivelinessChanged",
    "LivelinessLost",
    "MatchedChange",
    "MessageLost",
    "PublisherEvents",
    "SubscriptionEvents",
]


class MatchedChange(NamedTuple):
    """A match was made or ended.

    For example:

        bus.PublisherEvents(matched=lambda change: print(change.node, change.current_count_change))
    """

    current_count: int
    """Matches now."""
    current_count_change: int
    """1 for a new match, -1 for an ended match."""
    total_count: int
    """Matches that were ever made."""
    total_count_change: int
    """1 for a match that was made, else 0."""
    node: str
    """The full name of the other side's node."""


class IncompatibleQoS(NamedTuple):
    """Another endpoint on this topic does not match because of its QoS.

    For example:

        bus.SubscriptionEvents(incompatible_qos=lambda event: print(event.policy, event.text))
    """

    total_count: int
    """Endpoints that did not match because of their QoS."""
    total_count_change: int
    """The part of `total_count` that is new in this event."""
    policy: str
    """The last policy that differs, as rclpy's QoSPolicyKind names it: `RELIABILITY`."""
    text: str
    """All reasons, in ROS's words."""
    node: str
    """The full name of the other's node."""


class IncompatibleType(NamedTuple):
    """Another endpoint uses this topic's name for another type.

    For example:

        bus.PublisherEvents(incompatible_type=lambda event: print(event.node, event.text))
    """

    total_count: int
    """Endpoints that did not match because of their type."""
    total_count_change: int
    """The part of `total_count` that is new in this event."""
    text: str
    """What differs."""
    node: str
    """The full name of the other's node."""


class DeadlineMissed(NamedTuple):
    """No message within the deadline of the QoS.

    For example:

        bus.SubscriptionEvents(deadline_missed=lambda event: print(event.total_count))
    """

    total_count: int
    """Deadlines missed until now."""
    total_count_change: int
    """The part of `total_count` that is new in this event."""


class LivelinessChanged(NamedTuple):
    """A matched publisher became alive, lost its liveliness, took it up again, or left.

    The subscription's QoS needs a liveliness lease. With liveliness manual by topic, a publisher counts from
    its first sign of life: until then it is neither alive nor not alive.

    For example:

        bus.SubscriptionEvents(liveliness_changed=lambda event: print(event.alive_count))
    """

    alive_count: int
    """Matched publishers that are alive."""
    not_alive_count: int
    """Matched publishers without a sign of life within their lease."""
    alive_count_change: int
    """The change of `alive_count`."""
    not_alive_count_change: int
    """The change of `not_alive_count`."""


class LivelinessLost(NamedTuple):
    """This publisher did not assert its liveliness within its lease.

    For example:

        bus.PublisherEvents(liveliness_lost=lambda event: print(event.total_count))
    """

    total_count: int
    """How often that happened."""
    total_count_change: int
    """The part of `total_count` that is new in this event."""


class MessageLost(NamedTuple):
    """Messages were dropped before they could be taken.

    For example:

        bus.SubscriptionEvents(message_lost=lambda event: print(event.total_count_change, event.reasons))
    """

    total_count: int
    """Messages that this subscription lost until now."""
    total_count_change: int
    """Messages lost since the last event."""
    reasons: dict[str, int]
    """The total by reason, as `SubscriptionStatistics.dropped`."""


class PublisherEvents(msgspec.Struct, frozen=True, kw_only=True):
    """Callbacks of a publisher: plain functions, called on the event loop, of one argument.

    Given to `Node.create_publisher`. An exception in one is handled like one in any other callback.

        events = bus.PublisherEvents(matched=lambda change: print(change.current_count))
    """

    matched: Callable[[MatchedChange], object] | None = None
    """A match was made or ended."""
    incompatible_qos: Callable[[IncompatibleQoS], object] | None = None
    """A subscription asks for more than this publisher offers; without a callback the log warns."""
    incompatible_type: Callable[[IncompatibleType], object] | None = None
    """A subscription has another type; without a callback the log warns."""
    deadline_missed: Callable[[DeadlineMissed], object] | None = None
    """Nothing was published within the deadline."""
    liveliness_lost: Callable[[LivelinessLost], object] | None = None
    """Liveliness was not asserted within the lease."""


class SubscriptionEvents(msgspec.Struct, frozen=True, kw_only=True):
    """Callbacks of a subscription: plain functions, called on the event loop, of one argument.

    Given to `Node.create_subscription`. An exception in one is handled like one in any other callback.

        events = bus.SubscriptionEvents(message_lost=lambda event: print(event.reasons))
    """

    matched: Callable[[MatchedChange], object] | None = None
    """A match was made or ended."""
    incompatible_qos: Callable[[IncompatibleQoS], object] | None = None
    """A publisher offers less than this subscription asks for; without a callback the log warns."""
    incompatible_type: Callable[[IncompatibleType], object] | None = None
    """A publisher has another type; without a callback the log warns."""
    deadline_missed: Callable[[DeadlineMissed], object] | None = None
    """Nothing came within the deadline."""
    liveliness_changed: Callable[[LivelinessChanged], object] | None = None
    """A publisher became alive or not alive. Called only if the QoS has a liveliness lease."""
    message_lost: Callable[[MessageLost], object] | None = None
    """Messages were dropped."""
