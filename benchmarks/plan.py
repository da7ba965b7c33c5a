"""How thoroughly a run measures. Handed to every benchmark."""

import sys
from typing import NamedTuple


class Plan(NamedTuple):
    """`quick`: fewer and shorter; `repetitions`: how often each case is measured."""

    quick: bool
    repetitions: int

    def tell(self, text: str) -> None:
        """Say on a terminal what is being done."""
        if sys.stderr.isatty():
            print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)

    def choose(self, quick: int, thorough: int) -> int:
        """One of two amounts of work."""
        return quick if self.quick else thorough
