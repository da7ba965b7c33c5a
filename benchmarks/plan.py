"""How thoroughly a run measures. Handed to every benchmark."""

import sys
from typing import NamedTuple

SIZES = (64, 1 << 10, 1 << 16, 1 << 20, 4 << 20)
"""Of messages, in bytes."""
_QUICK_SIZES = (64, 1 << 20)


class Plan(NamedTuple):
    """`quick`: fewer and shorter; `repetitions`: how often each case is measured."""

    quick: bool
    repetitions: int

    @property
    def sizes(self) -> tuple[int, ...]:
        """Of messages, in bytes, from small to large."""
        return _QUICK_SIZES if self.quick else SIZES

    def rounds(self, *, is_essential: bool) -> int:
        """How often to measure what a comparison rests on, and what only stands beside it."""
        return self.repetitions if is_essential else max(1, self.repetitions // 4)

    def tell(self, text: str) -> None:
        """Say on a terminal what is being done."""
        if sys.stderr.isatty():
            print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)

    def choose(self, quick: int, thorough: int) -> int:
        """One of two amounts of work."""
        return quick if self.quick else thorough
