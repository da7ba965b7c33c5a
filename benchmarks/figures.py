"""Figures from samples: percentiles, spreads over repetitions, ratios. Pure; knows no processes."""

from collections.abc import Iterable, Mapping, Sequence
from statistics import median

import msgspec

from bus_cli.bench.figures import PERCENTILES, percentile


class Spread(msgspec.Struct, frozen=True):
    """One figure over all repetitions: its median, and its least and greatest value."""

    median: float
    min: float
    max: float

    @classmethod
    def of(cls, values: Iterable[float]) -> "Spread":
        """The spread of values. Raises ValueError if there are none."""
        held = list(values)
        if not held:
            raise ValueError("no values to make a spread of")
        return cls(median=median(held), min=min(held), max=max(held))


def percentiles(samples: Iterable[float], *, prefix: str = "", scale: float = 1.0) -> dict[str, float]:
    """`p50`, `p90`, `p99`, `p99.9` and `max` of `samples`, each multiplied by `scale`."""
    ordered = sorted(samples)
    return {
        prefix + ("max" if percent == 100 else f"p{percent:g}"): percentile(ordered, percent) * scale
        for percent in PERCENTILES
    }


def per_100k(seconds: float, messages: int) -> float:
    """CPU seconds per 100,000 messages."""
    return seconds * 100_000 / messages


def ratios(
    ours: Sequence[dict[str, float]], theirs: Sequence[dict[str, float]], key: str, their_key: str = ""
) -> list[float]:
    """The ratio of `key` of one case to `key` (or `their_key`) of the other, repetition by repetition.

    It compares pairs, not medians, because neighbours in time had the same load on the machine.
    """
    return [
        our[key] / their[their_key or key]
        for our, their in zip(ours, theirs, strict=False)
        if our.get(key) and their.get(their_key or key)
    ]


def best(found: Mapping[str, Sequence[Mapping[str, float]]], key: str, *, is_least: bool) -> str:
    """The system with the least (or greatest) median of `key` over its repetitions; empty if none has it."""
    medians = {
        name: median(held)
        for name, repetitions in found.items()
        if (held := [one[key] for one in repetitions if key in one])
    }
    return (min if is_least else max)(medians, key=lambda name: medians[name], default="")
