"""Numbers over time as a line of bars, for terminals. Pure."""

from collections.abc import Sequence
from itertools import pairwise

__all__ = ["bars_text", "joined"]

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
