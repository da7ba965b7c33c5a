"""QoS profiles as texts in rmw_zenoh's tokens. Pure.

    RELIABILITY:DURABILITY:HISTORY,DEPTH:DEADLINE:LIFESPAN:LIVELINESS,LEASE

A duration is `SECONDS,NANOSECONDS`. Policies are rmw's numbers. A policy with rmw_zenoh's default is empty:
reliable, volatile, keep last 42, no durations, automatic liveliness. Depth 10 with defaults is
`::,10:,:,:,,`.
"""

import re
from typing import Final

from bus.errors import ConfigurationError
from bus.qos import Durability, History, Liveliness, QoSProfile, Reliability

__all__ = ["DEFAULT_DEPTH", "read", "write"]

DEFAULT_DEPTH: Final = 42
_BEST_EFFORT: Final = "2"
_TRANSIENT_LOCAL: Final = "1"
_KEEP_ALL: Final = "2"
_MANUAL_BY_TOPIC: Final = "3"
_NS_PER_S: Final = 1_000_000_000
_INFINITE_NS: Final = 2**63 - 1
_NUMBER: Final = r"([0-9]{0,20})"
_TEXT: Final = re.compile(
    rf"{_NUMBER}:{_NUMBER}:{_NUMBER},{_NUMBER}:{_NUMBER},{_NUMBER}:{_NUMBER},{_NUMBER}"
    rf":{_NUMBER},{_NUMBER},{_NUMBER}",
    re.ASCII,
)


def write(qos: QoSProfile) -> str:
    """The text of a profile. Liveliness is automatic: assertions of publishers don't cross a bridge."""
    reliability = _BEST_EFFORT if qos.reliability is Reliability.BEST_EFFORT else ""
    durability = _TRANSIENT_LOCAL if qos.durability is Durability.TRANSIENT_LOCAL else ""
    history = _KEEP_ALL if qos.history is History.KEEP_ALL else ""
    depth = "" if qos.depth in (0, DEFAULT_DEPTH) else str(qos.depth)
    times = [_duration(one) for one in (qos.deadline_ns, qos.lifespan_ns, qos.lease_ns)]
    return f"{reliability}:{durability}:{history},{depth}:{times[0]}:{times[1]}:,{times[2]}"


def read(text: str) -> QoSProfile | None:
    """The profile of a text; None if the text is not a profile. Unknown numbers of policies count as the
    default."""
    found = _TEXT.fullmatch(text)
    if found is None:
        return None
    reliability, durability, history, depth, *times, lease_s, lease_ns = found.groups()
    liveliness = times.pop()
    keep_all = history == _KEEP_ALL
    try:
        return QoSProfile(
            0 if keep_all else min(int(depth or DEFAULT_DEPTH) or DEFAULT_DEPTH, 2**31 - 1),
            history=History.KEEP_ALL if keep_all else History.KEEP_LAST,
            reliability=Reliability.BEST_EFFORT if reliability == _BEST_EFFORT else Reliability.RELIABLE,
            durability=Durability.TRANSIENT_LOCAL if durability == _TRANSIENT_LOCAL else Durability.VOLATILE,
            deadline=_seconds(times[0], times[1]),
            lifespan=_seconds(times[2], times[3]),
            liveliness=Liveliness.MANUAL_BY_TOPIC if liveliness == _MANUAL_BY_TOPIC else Liveliness.AUTOMATIC,
            liveliness_lease_duration=_seconds(lease_s, lease_ns),
        )
    except ConfigurationError:
        return None


def _duration(duration_ns: int | None) -> str:
    if not duration_ns or duration_ns >= _INFINITE_NS:
        return ","
    seconds, nanoseconds = divmod(duration_ns, _NS_PER_S)
    return f"{seconds},{nanoseconds}"


def _seconds(seconds: str, nanoseconds: str) -> float | None:
    """Without numbers, or with zeros, the duration is infinite."""
    if not seconds and not nanoseconds:
        return None
    whole_ns = int(seconds or 0) * _NS_PER_S + int(nanoseconds or 0)
    return None if not 0 < whole_ns < _INFINITE_NS else whole_ns / _NS_PER_S
