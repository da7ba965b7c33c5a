"""Texts about gaps of a bag: times without a message, which a replay waits for or skips. Pure.

Clocks of robots without a battery begin in 1970. A bag with such messages has a gap of half a century.
"""

from collections.abc import Iterator, Sequence

from bus.base.counted import counted
from bus_bag.play.player import Span
from bus_bag.storage import Stretch

__all__ = ["LONG_NS", "gaps_in", "lines"]

_S = 1_000_000_000
_LONG_S = 60
LONG_NS = _LONG_S * _S
"""Longer gaps are reported before the replay."""
_MOST = 5
"""Number of gaps reported one by one."""
_UNITS = (("years", 31_557_600), ("days", 86_400), ("hours", 3_600), ("minutes", 60))


def gaps_in(gaps: Sequence[Stretch], span: Span) -> list[Stretch]:
    """The gaps that are played: their ends are inside the played part of the bag."""
    return [gap for gap in gaps if gap.end > span.start and not span.is_before(gap.end)]


def lines(
    gaps: Sequence[Stretch], span: Span, skipped_ns: int | None, *, is_in_page: bool = False
) -> Iterator[str]:
    """A line for each gap of `gaps`; `skipped_ns`: the value of `--skip-gaps`. `is_in_page`: the page's bar
    controls the replay."""
    if not gaps:
        return
    if skipped_ns is not None:
        total = sum(gap.end - max(gap.start, span.start) for gap in gaps)
        count = counted(len(gaps), "gap")
        yield f"Skipping {count} of more than {skipped_ns / _S:g} s: {_text(total)} in total."
        return
    way = (
        "The bar of the page can seek past it." if is_in_page else f"To skip such gaps: --skip-gaps {_LONG_S}"
    )
    for gap in gaps[:_MOST]:
        start = max(gap.start, span.start)
        pause, offset = _text(gap.end - start), (start - span.start) / _S
        yield f"No messages for {pause} after {offset:.2f} s. {way}"
    if len(gaps) > _MOST:
        yield f"{len(gaps) - _MOST} more gaps of more than {_LONG_S} s"


def _text(duration_ns: int) -> str:
    """A duration in the largest unit that fits."""
    seconds = duration_ns / _S
    for name, size in _UNITS:
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {name}"
    return f"{seconds:.3g} s"
