"""The QoS of played topics: one publisher replaces all recorded ones. Pure."""

from collections.abc import Iterable, Sequence

from msgspec.structs import replace

from bus.qos import MAX_DEPTH, Durability, History, QoSProfile

__all__ = ["MIXED", "kept_for_late_joiners", "offered_profile"]

MIXED = (
    "Not all original publishers on topic {topic} offered the same QoS profiles. "
    "Rosbag2 cannot yet choose an adapted profile to offer for this mixed case. "
    "Falling back to the rosbag2_storage default publisher offer."
)


def offered_profile(profiles: Sequence[QoSProfile]) -> tuple[QoSProfile, bool]:
    """The profile to offer, and whether it is none of the recorded ones because they differ.

    As in rosbag2, differences of history and lifespan don't count, and a policy that differs gets its
    default. Each transient local publisher kept its own messages for late joiners: the depth is enough for
    all of them.
    """
    if not profiles:
        return QoSProfile(), False
    first = profiles[0]
    if any(_matching(one) != _matching(first) for one in profiles[1:]):
        return QoSProfile(), True
    if depth := kept_for_late_joiners(profiles):
        if any(one.history is History.KEEP_ALL for one in profiles):
            return replace(first, history=History.KEEP_ALL), False
        return replace(first, depth=depth), False
    return first, False


def kept_for_late_joiners(profiles: Iterable[QoSProfile]) -> int:
    """The total number of messages that publishers with these profiles keep for late joiners."""
    lasting = [one for one in profiles if one.durability is Durability.TRANSIENT_LOCAL]
    if any(one.history is History.KEEP_ALL for one in lasting):
        return MAX_DEPTH
    return min(sum(one.depth for one in lasting), MAX_DEPTH)


def _matching(profile: QoSProfile) -> QoSProfile:
    """The policies that decide whether a subscription matches."""
    return replace(profile, history=History.KEEP_LAST, depth=1, lifespan=None)
