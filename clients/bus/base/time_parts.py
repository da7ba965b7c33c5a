"""The parts of a histogram of times: two for each doubling, from 1 µs to 17 s. Pure.

The native reader counts ages in the same parts (`bus.shm`, py_take.c).
"""

PARTS = 50
"""Number of parts. The first one is of times below 1.024 µs, the last one of times from 17.2 s on."""
FIRST_BITS = 10


def part_of(time_ns: int) -> int:
    """The part that a time in nanoseconds belongs to."""
    bits = time_ns.bit_length() if time_ns > 0 else 0
    if bits <= FIRST_BITS:
        return 0
    return min(2 * (bits - FIRST_BITS) - 1 + (time_ns >> (bits - 2) & 1), PARTS - 1)


def bounds(part: int) -> tuple[int, int]:
    """The lowest time of a part, and of the next one, in nanoseconds. The last part has no end: it counts as
    twice as long as its begin."""
    return _begin(part), _begin(part + 1) if part < PARTS - 1 else 2 * _begin(part)


def _begin(part: int) -> int:
    return (2 + (part - 1) % 2) << (FIRST_BITS - 1 + (part - 1) // 2) if part else 0


def trimmed(counts: list[int]) -> tuple[int, ...]:
    """The counts up to the last one above 0."""
    last = len(counts)
    while last and not counts[last - 1]:
        last -= 1
    return tuple(counts[:last])
