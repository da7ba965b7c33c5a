"""What can happen to an endpoint besides messages, as values; names and counts follow ROS 2's status events.

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
    """A match was made or ended; `node` is the other side's."""

    current_count: int
    current_count_change: int
    total_count: int
    total_count_change: int
    node: str


class IncompatibleQoS(NamedTuple):
    """`node` has an endpoint on this topic that does not match; `policy` is the last one that differs."""

    total_count: int
    total_count_change: int
    policy: str
    text: str
    node: str


class IncompatibleType(NamedTuple):
    """`node` uses this topic's name for another type."""

    total_count: int
    total_count_change: int
    text: str
    node: str


class DeadlineMissed(NamedTuple):
    """No message within the deadline."""

    total_count: int
    total_count_change: int


class LivelinessChanged(NamedTuple):
    """A matched publisher's liveliness was lost or taken up again."""

    alive_count: int
    not_alive_count: int
    alive_count_change: int
    not_alive_count_change: int


class LivelinessLost(NamedTuple):
    """This publisher did not assert its liveliness within its lease."""

    total_count: int
    total_count_change: int


class MessageLost(NamedTuple):
    """Messages were dropped before they could be taken; `reasons` are this subscription's totals."""

    total_count: int
    total_count_change: int
    reasons: dict[str, int]


class PublisherEvents(msgspec.Struct, frozen=True, kw_only=True):
    """Callbacks of a publisher; plain functions, called on the event loop."""

    matched: Callable[[MatchedChange], object] | None = None
    incompatible_qos: Callable[[IncompatibleQoS], object] | None = None
    incompatible_type: Callable[[IncompatibleType], object] | None = None
    deadline_missed: Callable[[DeadlineMissed], object] | None = None
    liveliness_lost: Callable[[LivelinessLost], object] | None = None


class SubscriptionEvents(msgspec.Struct, frozen=True, kw_only=True):
    """Callbacks of a subscription; plain functions, called on the event loop."""

    matched: Callable[[MatchedChange], object] | None = None
    incompatible_qos: Callable[[IncompatibleQoS], object] | None = None
    incompatible_type: Callable[[IncompatibleType], object] | None = None
    deadline_missed: Callable[[DeadlineMissed], object] | None = None
    liveliness_changed: Callable[[LivelinessChanged], object] | None = None
    message_lost: Callable[[MessageLost], object] | None = None
