"""Growth of a quantity: a straight line through samples over time, and the rule. Pure.

A leak rises during the whole run. Memory also rises in steps that end (a queue that was longer than ever
before, an allocator's arena). Neighbours in time are similar, so a line fits noise better than it should. So
a quantity grows only if it meets four conditions:

- it was watched for `LEAST_S` after the warm-up, which is the first third;
- the line rises by more than the quantity's `step` from its beginning to its end;
- it rises by more than its `per_hour`, even at the lower end of the confidence interval (`SURE` standard
  errors, widened for similar neighbours);
- it rises all the time: from each quarter's median to the next one's, by at least a quarter of the line's
  rise in that time.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from statistics import median
from typing import Literal, NamedTuple

Verdict = Literal["flat", "grows", "too short"]

WARM_UP = 1 / 3
"""The part at the beginning of a run that is left out."""
LEAST_S = 60.0
"""A shorter run, without the warm-up, is not judged."""
SURE = 3.0
_STEADY = 0.25
_LEAST_SAMPLES = 8
_QUARTERS = 4
_HOUR_S = 3600.0


class Quantity(NamedTuple):
    """Something that must not grow: its name, and its allowed step and growth per hour."""

    name: str
    step: float
    per_hour: float
    digits: int = 0


class Line(NamedTuple):
    """The line through samples: its `slope` per hour, the slope's standard `error`, and the values at both
    ends.

    `least_rise`: the smallest rise from quarter to quarter, relative to the line's.
    """

    slope: float
    error: float
    first: float
    last: float
    least_rise: float
    seconds: float

    def verdict(self, quantity: Quantity) -> Verdict:
        """Apply the rule of this module."""
        if self.seconds < LEAST_S:
            return "too short"
        rises = self.last - self.first > quantity.step and self.least_rise > _STEADY
        return "grows" if rises and self.slope - SURE * self.error > quantity.per_hour else "flat"


def after_warm_up(times_s: Sequence[float]) -> int:
    """The index of the first sample after the warm-up."""
    if not times_s:
        return 0
    begin = times_s[0] + (times_s[-1] - times_s[0]) * WARM_UP
    return next(index for index, at in enumerate(times_s) if at >= begin)


def fit(times_s: Sequence[float], values: Sequence[float]) -> Line:
    """Fit by least squares. With too few samples, or with equal times, the line says nothing (0 s)."""
    count = len(values)
    if count < _LEAST_SAMPLES or times_s[-1] <= times_s[0]:
        first, last = (values[0], values[-1]) if values else (0.0, 0.0)
        return Line(0.0, math.inf, first, last, 0.0, 0.0)
    middle_s, mean = sum(times_s) / count, sum(values) / count
    squares = sum((at - middle_s) ** 2 for at in times_s)
    slope = sum((at - middle_s) * (value - mean) for at, value in zip(times_s, values, strict=True)) / squares
    rest = [value - mean - slope * (at - middle_s) for at, value in zip(times_s, values, strict=True)]
    variance = sum(one * one for one in rest) / (count - 2)
    error = math.sqrt(variance / squares * _widening(rest))
    first, last = (mean + slope * (at - middle_s) for at in (times_s[0], times_s[-1]))
    least_rise = _least_rise(values) * _QUARTERS / (last - first) if last > first else 0.0
    return Line(slope * _HOUR_S, error * _HOUR_S, first, last, least_rise, times_s[-1] - times_s[0])


def _least_rise(values: Sequence[float]) -> float:
    """The smallest rise from a quarter's median to the next one's."""
    ends = [len(values) * part // _QUARTERS for part in range(_QUARTERS + 1)]
    medians = [median(values[begin:end]) for begin, end in pairwise(ends)]
    return min(after - before for before, after in pairwise(medians))


def _widening(rest: Sequence[float]) -> float:
    """The factor by which the variance is larger than for independent samples (first order)."""
    total = sum(one * one for one in rest)
    if not total:
        return 1.0
    likeness = sum(one * other for one, other in pairwise(rest)) / total
    likeness = min(max(likeness, 0.0), 0.95)
    return (1 + likeness) / (1 - likeness)
