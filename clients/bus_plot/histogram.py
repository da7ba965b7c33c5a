"""Times in a histogram whose parts grow with the time: two for each doubling, from 1 µs to 17 s. Pure.

busd's library counts the ages of messages in the same parts (`bus.delivery.ages`).
"""

from collections.abc import Iterable, Sequence

__all__ = ["PARTS", "bounds", "histogram", "lines", "part_of", "quantile"]

PARTS = 50
"""Number of parts. The first one is of times below 1.024 µs, the last one of times from 17.2 s on."""
_FIRST_BITS = 10
_BAR_CELLS = 40


def part_of(time_ns: int) -> int:
    """The part that a time belongs to."""
    bits = time_ns.bit_length() if time_ns > 0 else 0
    if bits <= _FIRST_BITS:
        return 0
    return min(2 * (bits - _FIRST_BITS) - 1 + (time_ns >> (bits - 2) & 1), PARTS - 1)


def bounds(part: int) -> tuple[int, int]:
    """The lowest time of a part, and of the next one, in nanoseconds. The last part has no end: it counts as
    twice as long as its begin."""
    return _begin(part), _begin(part + 1) if part < PARTS - 1 else 2 * _begin(part)


def _begin(part: int) -> int:
    return (2 + (part - 1) % 2) << (_FIRST_BITS - 1 + (part - 1) // 2) if part else 0


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
