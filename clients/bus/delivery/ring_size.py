"""Sizes of a publisher's rings: the first ring, the time for a larger one, and the larger one's size.

Sees a ring through its writer's counters. `clients/bus/shm/sizes.h` computes the sizes.
Must not know how rings are made, and not their readers.
"""

from collections.abc import Callable

from bus import shm

FOR_EVER = 1 << 60
"""A depth without bound."""

FIRST_CAPACITY = 4 << 10
"""Size of every first ring, because a program may have hundreds of publishers with few messages."""
FIRST_INDEX = 64

EARLY = 16
"""Number of publishers of a process that get a ring of the usual size at their first match."""

LAP_S = 1.0
"""If the records of a first ring go round in less time, a ring of the usual size replaces it."""

_GROW_AGAIN_NS = 1_000_000_000


class RingSize:
    """The sizes of one publisher's rings; `keeps_all`: its QoS is keep all."""

    def __init__(self, now_ns: Callable[[], int], *, keeps_all: bool) -> None:
        self._now_ns = now_ns
        self._keeps_all = keeps_all
        self._most_bytes = (
            0  # limit for depth: the usual size at least. A message that does not fit may exceed it
        )
        self._no_growth_ns = 0  # end of the pause after a failed growth

    def allow(self, ring_bytes: int) -> None:
        """Set the broker's limit for growth for depth."""
        self._most_bytes = ring_bytes

    def larger(
        self, writer: "shm.native.Writer", size: int, keep: int, *, must: bool
    ) -> tuple[int, int] | None:
        """Capacity and index length of the next ring, with room for a message of `size` bytes.

        `keep`: records that must stay. `must`: may exceed the limit for depth. None if the ring must not
        grow.
        """
        if not must and self._now_ns() < self._no_growth_ns:
            return None
        return shm.native.next_ring(
            writer.capacity, _held(writer), size, keep, self._most_bytes, keeps_all=self._keeps_all, must=must
        )

    def failed(self) -> None:
        """Pause growth for depth after a failure for lack of memory."""
        self._no_growth_ns = self._now_ns() + _GROW_AGAIN_NS


def is_filled_by_few(writer: "shm.native.Writer") -> bool:
    """Whether a few long messages fill the ring: a larger one lets both sides work at the same time."""
    return shm.native.is_filled_by_few(writer.capacity, _held(writer))


def laps_slowly(writer: "shm.native.Writer", now_ns: int) -> bool:
    """Whether the ring still has a record older than the shortest allowed time of a lap."""
    return writer.seq_since(now_ns - int(LAP_S * 1e9)) > writer.oldest


def _held(writer: "shm.native.Writer") -> int:
    return writer.latest - writer.oldest + 1
