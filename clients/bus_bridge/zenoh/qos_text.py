"""QoS profiles as short texts, for key expressions. Pure.

An example is `rk10v`. The letters mean:

- reliability: `r` or `b` (best effort);
- history and depth: `k10`, or `a` for keep all;
- durability: `v`, `t` transient local, or `b` best available;
- durations that are not infinite: a letter and nanoseconds, with `d` deadline, `l` lifespan, `e` lease;
- manual liveliness: `m`.

Another example is `bk5vd20000000m`.
"""

import re

from bus.errors import ConfigurationError
from bus.qos import DURATIONS, Durability, History, Liveliness, QoSProfile, Reliability

__all__ = ["read", "write"]

_RELIABILITY = {Reliability.RELIABLE: "r", Reliability.BEST_EFFORT: "b"}
_DURABILITY = {Durability.VOLATILE: "v", Durability.TRANSIENT_LOCAL: "t", Durability.BEST_AVAILABLE: "b"}
_TIMES = "".join(f"(?:{one.letter}([0-9]{{1,19}}))?" for one in DURATIONS)
_TEXT = re.compile(rf"([rb])(?:k([0-9]{{1,10}})|(a))([vtb]){_TIMES}(m)?", re.ASCII)
_NS_PER_S = 1_000_000_000


def write(qos: QoSProfile) -> str:
    kept = "a" if qos.history is History.KEEP_ALL else f"k{qos.depth}"
    times = [(one.letter, one.ns(qos)) for one in DURATIONS]
    return "".join(
        [
            _RELIABILITY[qos.reliability],
            kept,
            _DURABILITY[qos.durability],
            *(f"{letter}{ns}" for letter, ns in times if ns),
            "m" if qos.liveliness is Liveliness.MANUAL_BY_TOPIC else "",
        ]
    )


def read(text: str) -> QoSProfile | None:
    """The profile of a text; None if the text is not a profile."""
    found = _TEXT.fullmatch(text)
    if found is None:
        return None
    reliability, depth, _, durability, *times, manual = found.groups()
    try:
        return QoSProfile(
            int(depth or 0),
            history=History.KEEP_LAST if depth else History.KEEP_ALL,
            reliability=_named(_RELIABILITY, reliability),
            durability=_named(_DURABILITY, durability),
            liveliness=Liveliness.MANUAL_BY_TOPIC if manual else Liveliness.AUTOMATIC,
            **{one.name: _seconds(time) for one, time in zip(DURATIONS, times, strict=True)},
        )
    except ConfigurationError:
        return None


def _named(table: dict[Reliability, str] | dict[Durability, str], letter: str) -> str:
    return next(name for name, one in table.items() if one == letter)


def _seconds(nanoseconds: str | None) -> float | None:
    return None if nanoseconds is None else int(nanoseconds) / _NS_PER_S
