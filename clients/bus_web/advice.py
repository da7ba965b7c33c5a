"""Advice about losses by the depth, from counters: which depth would have held the messages. Pure.

It only speaks if the figures support it:

- Only messages with the reason `replaced` count: the subscription's depth was too small for them.
- `most_missed` is the most messages that were lost in a row, without one taken in between. With a depth
  higher by that number, none of them would have been lost.
- A program that loses a large part of all messages does not stand still now and then: it is too slow, and
  every depth overflows. In between, the figures do not say which of the two it is, so the advice has a
  condition.
"""

from bus.base.counted import counted
from bus.graph import EndpointStatistics
from bus.qos import History, QoSProfile
from bus.vocabulary import DropReason

__all__ = ["advice"]

_STALLS = 0.1
"""Up to this part of lost messages, stalls explain them."""
_TOO_SLOW = 0.5
"""Above this part, the program is too slow."""
_MOST_DEPTH = 1000
"""Higher depths are no advice: the program stands still for too long."""
_ENOUGH = 100
"""With fewer messages, a part of them says nothing."""
_LEAST_HZ = 0.1


def advice(qos: QoSProfile, statistics: EndpointStatistics, hz: float | None = None) -> str:
    """One sentence about a subscription; empty if there is no advice.

    `hz`: messages that are published to it a second, if that is known.
    """
    replaced = statistics.dropped.get(DropReason.REPLACED, 0)
    if qos.history is not History.KEEP_LAST or not replaced or statistics.expected < _ENOUGH:
        return ""
    part = replaced / statistics.expected
    if part > _TOO_SLOW:
        return (
            f"{replaced} of {counted(statistics.expected, 'message')} were replaced: the program takes too "
            "few, and no depth helps; do less for each message, or publish fewer"
        )
    missed, depth = statistics.most_missed, qos.depth
    if not missed:
        return ""
    needed = depth + missed
    condition = "" if part <= _STALLS else ", if the program keeps up between its stalls"
    known = hz if hz is not None and hz >= _LEAST_HZ else None
    if needed > _MOST_DEPTH:
        stall = f"{_span(needed / known)}, " if known else ""
        missing = counted(missed, "message")
        return f"the longest stall was {stall}{missing} too long for depth {depth}: find its cause"
    if known is None:
        return f"depth {depth} was once too small by {counted(missed, 'message')}: depth {needed}{condition}"
    return (
        f"depth {depth} at {_rate(known)} Hz holds {_span(depth / known)}; "
        f"the longest stall was {_span(needed / known)}: depth {needed}{condition}"
    )


def _rate(hz: float) -> str:
    return f"{hz:.0f}" if hz >= 10 else f"{hz:.2g}"


def _span(seconds: float) -> str:
    if seconds >= 1:
        return f"{seconds:.1f} s"
    return f"{seconds * 1000:.0f} ms" if seconds >= 0.01 else f"{seconds * 1000:.1f} ms"
