"""Sizes of a publisher's rings: the first ring, the time for a larger one, and the larger one's size.

Sees a ring through its writer's counters. Must not know how rings are made, and not their readers.
"""

from collections.abc import Callable

from bus import shm
from bus.shm.segments import RING_HEAD_BYTES

FOR_EVER = 1 << 60
"""A depth without bound."""

FIRST_CAPACITY = 4 << 10
"""Size of every first ring, because a program may have hundreds of publishers with few messages."""
FIRST_INDEX = 64

EARLY = 16
"""Number of publishers of a process that get a ring of the usual size at their first match."""

LAP_S = 1.0
"""If the records of a first ring go round in less time, a ring of the usual size replaces it."""

_CAPACITY = 64 << 10
_LONG_CAPACITY = 1 << 20
_LONG_CAPACITY_MOST = 8 << 20
_FEW_RECORDS = 64
_LEAST_RECORD_BYTES = 64
_GROW_AGAIN_NS = 1_000_000_000


class RingSize:
    """The sizes of one publisher's rings; `keeps_all`: its QoS is keep all."""

    def __init__(self, now_ns: Callable[[], int], *, keeps_all: bool) -> None:
        self._now_ns = now_ns
        self._usual_capacity = _LONG_CAPACITY if keeps_all else _CAPACITY
        self._most_bytes = self._usual_capacity  # limit for depth; a message that does not fit may exceed it
        self._no_growth_ns = 0  # end of the pause after a failed growth

    def allow(self, ring_bytes: int) -> None:
        """Set the broker's limit for growth for depth."""
        self._most_bytes = max(ring_bytes, self._usual_capacity)

    def larger(
        self, writer: "shm.native.Writer", size: int, keep: int, *, must: bool
    ) -> tuple[int, int] | None:
        """Capacity and index length of the next ring, with room for a message of `size` bytes.

        `keep`: records that must stay. `must`: may exceed the limit for depth. None if the ring must not
        grow.
        """
        capacity = max(2 * writer.capacity, _power_of_two(4 * (size + RING_HEAD_BYTES)), self._usual_capacity)
        if not must:
            if capacity > self._most_bytes or self._now_ns() < self._no_growth_ns:
                return None
            capacity = max(capacity, self._capacity_for(writer, keep))
        usual, most = capacity >> 7, capacity // _LEAST_RECORD_BYTES
        return capacity, max(usual, most if keep >= most else _power_of_two(keep + 1))

    def failed(self) -> None:
        """Pause growth for depth after a failure for lack of memory."""
        self._no_growth_ns = self._now_ns() + _GROW_AGAIN_NS

    def _capacity_for(self, writer: "shm.native.Writer", keep: int) -> int:
        """Bytes for the whole depth, if messages keep their present size; 0: not known.

        With it the ring grows once, and not several times by doubling: each growth delays messages.
        """
        held = writer.latest - writer.oldest + 1
        if keep == FOR_EVER or held < 1:
            return 0
        capacity = _power_of_two(writer.capacity * keep // held)
        while capacity > self._most_bytes:
            capacity >>= 1
        return capacity


def is_filled_by_few(writer: "shm.native.Writer") -> bool:
    """Whether a few long messages fill the ring: a larger one lets both sides work at the same time."""
    return writer.latest - writer.oldest < _FEW_RECORDS and 2 * writer.capacity <= _LONG_CAPACITY_MOST


def laps_slowly(writer: "shm.native.Writer", now_ns: int) -> bool:
    """Whether the ring still has a record older than the shortest allowed time of a lap."""
    return writer.seq_since(now_ns - int(LAP_S * 1e9)) > writer.oldest


def _power_of_two(number: int) -> int:
    """The smallest power of two that is not less than `number`."""
    return 1 << (number - 1).bit_length()
