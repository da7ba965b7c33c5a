"""Numbers over time as a line of bars, for terminals. Pure."""

from collections.abc import Sequence
from itertools import pairwise
from math import ceil, log2

__all__ = ["bars_text", "joined", "peaks_text"]

_BARS = "▁▂▃▄▅▆▇█"


def bars_text(values: Sequence[float], top: float | None = None) -> str:
    """A bar for each value, as high as its part of `top` (default: the highest value).

    Zero is the lowest bar, and everything above zero is higher than that.
    """
    top = max(values, default=0.0) if top is None else top
    if not top:
        return "▁" * len(values)
    most = len(_BARS) - 1
    return "".join(_BARS[min(max(1, round(one / top * most)), most)] if one else "▁" for one in values)


def joined(values: Sequence[float], number: int) -> list[float]:
    """The sums of `number` parts of the values, which are equally long except for rounding."""
    ends = [len(values) * place // number for place in range(number + 1)]
    return [sum(values[begin:end]) for begin, end in pairwise(ends)]


def peaks_text(values: Sequence[float], cells: int) -> str:
    """The largest value of each stretch, on a logarithmic scale from the least of them to the largest.

    A scale spans at least a factor of eight; otherwise noise would fill it.
    """
    step = max(1, ceil(len(values) / cells))
    heights = [log2(max(*values[at : at + step], 1e-9)) for at in range(0, len(values), step)]
    if not heights:
        return ""
    low, span = min(heights), max(max(heights) - min(heights), 3.0)
    return "".join(_BARS[min(len(_BARS) - 1, int((one - low) / span * len(_BARS)))] for one in heights)
