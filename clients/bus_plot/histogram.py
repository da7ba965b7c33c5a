"""Times in a histogram whose parts grow with the time: two for each doubling, from 1 µs to 17 s. Pure.

Its parts are in `bus.base.time_parts`, because the library counts the ages of messages in them.
"""

from collections.abc import Iterable, Sequence

from bus.base.time_parts import PARTS, bounds, part_of

__all__ = ["bounds", "histogram", "lines", "quantile"]

_BAR_CELLS = 40


def histogram(times_ns: Iterable[int]) -> list[int]:
    """How many times each part has."""
    counts = [0] * PARTS
    for time_ns in times_ns:
        counts[part_of(time_ns)] += 1
    return counts


def quantile(counts: Sequence[int], share: float) -> float:
    """The time in nanoseconds below which `share` of all times are. Inside its part it is estimated: it is
    wrong by a quarter at most, above 1 µs. 0.0 for an empty histogram."""
    total = sum(counts)
    wanted, seen = share * total, 0
    for part, count in enumerate(counts):
        if count and seen + count >= wanted:
            begin, end = bounds(part)
            return begin + (end - begin) * max(0.0, wanted - seen) / count
        seen += count
    return 0.0


def lines(counts: Sequence[int], cells: int = _BAR_CELLS) -> list[str]:
    """A line for each part from the first to the last with a time: its bounds, a bar, the number."""
    used = [part for part, count in enumerate(counts) if count]
    if not used:
        return []
    most = max(counts)
    texts = {part: _bounds_text(part) for part in range(used[0], used[-1] + 1)}
    width = max(map(len, texts.values()))
    return [
        f"{text.rjust(width)} {_bar(counts[part] / most, cells)} {counts[part]}"
        for part, text in texts.items()
    ]


def _bar(share: float, cells: int) -> str:
    return ("▇" * (max(1, round(share * cells)) if share else 0)).ljust(cells)


def _bounds_text(part: int) -> str:
    begin, end = bounds(part)
    return f"{_text(begin)} ... {_text(end)}" if part < PARTS - 1 else f"{_text(begin)} ..."


def _text(time_ns: int) -> str:
    for size, unit in ((10**9, "s"), (10**6, "ms"), (10**3, "µs")):
        if time_ns >= size:
            return f"{time_ns / size:.3g} {unit}"
    return f"{time_ns} ns" if time_ns else "0"
