"""Stretches of a bag: its times with messages, and the gaps between them. Pure. Times are nanoseconds."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

__all__ = ["Stretch", "gaps_between", "split"]


class Stretch(NamedTuple):
    """A time with messages, from the first one to the last one; or a gap, from its beginning to its end."""

    start: int
    end: int


def split(times: Iterable[int], least: int) -> Iterator[Stretch]:
    """The stretches of messages with these ascending times: a gap of more than `least` parts two of them."""
    start = end = None
    for time in times:
        if start is None or end is None:
            start = time
        elif time - end > least:
            yield Stretch(start, end)
            start = time
        end = time
    if start is not None and end is not None:
        yield Stretch(start, end)


def gaps_between(stretches: Iterable[Stretch], least: int) -> list[Stretch]:
    """The gaps of more than `least` that no stretch covers, in order. The stretches may overlap."""
    gaps: list[Stretch] = []
    end: int | None = None
    for stretch in sorted(stretches):
        if end is not None and stretch.start - end > least:
            gaps.append(Stretch(end, stretch.start))
        end = stretch.end if end is None else max(end, stretch.end)
    return gaps
