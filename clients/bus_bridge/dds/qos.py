"""Converts QoS profiles to policies of DDS, and back.

Owns: the policy for each setting. Values only: `participant` makes cyclonedds' own objects.
"""

from collections.abc import Collection
from typing import Final, NamedTuple

from bus.errors import ConfigurationError
from bus.qos import Durability, History, Liveliness, QoSProfile, Reliability
from bus_bridge.rtps.parameters import FOREVER_NS
from bus_bridge.rtps.policies import AUTOMATIC, MANUAL_BY_TOPIC, TRANSIENT_LOCAL, VOLATILE, Policies

__all__ = [
    "DEPTH",
    "ReaderKind",
    "kinds_for",
    "of_publisher",
    "of_subscription",
    "profile_of",
    "strength",
]

DEPTH: Final = 10
"""The depth of a far endpoint that does not report it. Discovery of Fast DDS leaves it out; then it looks
like 1."""

_NS_PER_S: Final = 1_000_000_000


def of_publisher(profile: QoSProfile, depth: int) -> Policies:
    """The policies that the writer for a publisher of this bus offers; it keeps at least `depth` messages.

    Liveliness is automatic: assertions of the publisher itself don't cross a bridge. With transient local,
    the history has the publisher's depth, because late joiners get all of it.
    """
    transient_local = profile.durability is Durability.TRANSIENT_LOCAL
    return Policies(
        reliable=profile.reliability is Reliability.RELIABLE,
        durability=TRANSIENT_LOCAL if transient_local else VOLATILE,
        keep_all=profile.history is History.KEEP_ALL,
        depth=profile.depth if transient_local else max(profile.depth, depth),
        deadline_ns=profile.deadline_ns or FOREVER_NS,
        lifespan_ns=profile.lifespan_ns or FOREVER_NS,
        lease_ns=profile.lease_ns or FOREVER_NS,
    )


class ReaderKind(NamedTuple):
    """The policies of a far publisher that decide which reader gets most of its messages."""

    transient_local: bool
    reliable: bool


def kinds_for(profile: QoSProfile, far: Collection[ReaderKind]) -> set[ReaderKind]:
    """The kinds of readers for a subscription of this bus, with these far publishers.

    Most subscriptions have one reader. A subscription with the best available durability has one for each
    durability of the publishers. In DDS, only reliable readers get the messages that a publisher keeps for
    late joiners. So a best-effort subscription that wants them reads reliably from reliable publishers.
    """
    reliable = profile.reliability is Reliability.RELIABLE
    if profile.durability is Durability.VOLATILE:
        return {ReaderKind(False, reliable)}
    if profile.durability is Durability.TRANSIENT_LOCAL:
        far = [kind for kind in far if kind.transient_local] or [ReaderKind(True, reliable)]
    return {
        ReaderKind(kind.transient_local, reliable or (kind.transient_local and kind.reliable)) for kind in far
    } or {ReaderKind(False, reliable)}


def of_subscription(profile: QoSProfile, depth: int, kind: ReaderKind) -> Policies:
    """The policies that a reader of that kind requests for a subscription of this bus."""
    return Policies(
        reliable=kind.reliable,
        durability=TRANSIENT_LOCAL if kind.transient_local else VOLATILE,
        keep_all=profile.is_lossless,
        depth=max(profile.depth, depth),
        deadline_ns=profile.deadline_ns or FOREVER_NS,
        liveliness=MANUAL_BY_TOPIC if profile.liveliness is Liveliness.MANUAL_BY_TOPIC else AUTOMATIC,
        lease_ns=profile.lease_ns or FOREVER_NS,
    )


def profile_of(policies: Policies) -> QoSProfile:
    """The profile of a far endpoint. Raises ConfigurationError if the bus can't have one of its durations."""
    keep_all = policies.keep_all
    depth = policies.depth if policies.depth > 1 else DEPTH
    return QoSProfile(
        0 if keep_all else depth,
        reliability=Reliability.RELIABLE if policies.reliable else Reliability.BEST_EFFORT,
        durability=Durability.TRANSIENT_LOCAL if policies.transient_local else Durability.VOLATILE,
        history=History.KEEP_ALL if keep_all else History.KEEP_LAST,
        deadline=_seconds("deadline", policies.deadline_ns),
        lifespan=_seconds("lifespan", policies.lifespan_ns),
        liveliness=Liveliness.MANUAL_BY_TOPIC if policies.manual else Liveliness.AUTOMATIC,
        liveliness_lease_duration=_seconds("lease", policies.lease_ns),
    )


def strength(policies: Policies) -> tuple[bool, bool, bool, int]:
    """Sort key of readers: the higher, the more messages of a far writer reach the reader."""
    return policies.transient_local, policies.reliable, policies.keep_all, policies.depth


def _seconds(what: str, duration_ns: int) -> float | None:
    if duration_ns >= FOREVER_NS:
        return None
    if duration_ns <= 0:
        raise ConfigurationError(f"its {what} is {duration_ns} nanoseconds")
    return duration_ns / _NS_PER_S
