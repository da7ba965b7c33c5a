"""Whether something grows: a straight line through samples over time, and the rule. Pure.

A leak rises for as long as one looks. Memory also rises in steps that end (a queue that was once longer than
ever, an allocator's arena), and neighbours in time resemble each other, so that a line fits noise better than
it deserves. So what grows must meet four conditions:

- it was watched for `LEAST_S` after the warm-up, which is the first third;
- the line rises by more than the quantity's `step` from its beginning to its end;
- it rises by more than its `per_hour`, also at the lower end of what is certain (`SURE` standard errors,
  widened for neighbours that resemble each other);
- it rises all the time: from each quarter's median to the next one's, by a quarter of the line's rise in
  such a time at least.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from statistics import median
from typing import Literal, NamedTuple

Verdict = Literal["flat", "grows", "too short"]

WARM_UP = 1 / 3
"""The part of a run at its beginning that is left out."""
LEAST_S = 60.0
"""What was watched for less, without the warm-up, is not judged."""
SURE = 3.0
_STEADY = 0.25
_LEAST_SAMPLES = 8
_QUARTERS = 4
_HOUR_S = 3600.0


class Quantity(NamedTuple):
    """Something that must not grow: how it is called, and by how much it may seem to."""

    name: str
    step: float
    per_hour: float
    digits: int = 0


class Line(NamedTuple):
    """What a line through samples says: its `slope` an hour, the standard `error` of that, and both ends.

    `least_rise`: the least of the rises from quarter to quarter, as a part of the line's.
    """

    slope: float
    error: float
    first: float
    last: float
    least_rise: float
    seconds: float

    def verdict(self, quantity: Quantity) -> Verdict:
        """The rule of this module."""
        if self.seconds < LEAST_S:
            return "too short"
        rises = self.last - self.first > quantity.step and self.least_rise > _STEADY
        return "grows" if rises and self.slope - SURE * self.error > quantity.per_hour else "flat"


def after_warm_up(times_s: Sequence[float]) -> int:
    """The index of the first sample that counts."""
    if not times_s:
        return 0
    begin = times_s[0] + (times_s[-1] - times_s[0]) * WARM_UP
    return next(index for index, at in enumerate(times_s) if at >= begin)


def fit(times_s: Sequence[float], values: Sequence[float]) -> Line:
    """Least squares. Of fewer than a few samples, or of none that differ in time, nothing is said (0 s)."""
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
    """From one quarter's median to the next one's."""
    ends = [len(values) * part // _QUARTERS for part in range(_QUARTERS + 1)]
    medians = [median(values[begin:end]) for begin, end in pairwise(ends)]
    return min(after - before for before, after in pairwise(medians))


def _widening(rest: Sequence[float]) -> float:
    """By how much the variance is larger than of samples that know nothing of each other (first order)."""
    total = sum(one * one for one in rest)
    if not total:
        return 1.0
    likeness = sum(one * other for one, other in pairwise(rest)) / total
    likeness = min(max(likeness, 0.0), 0.95)
    return (1 + likeness) / (1 - likeness)
