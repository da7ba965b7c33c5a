"""The benchmarks of a run, and its thoroughness, which each of them gets."""

import sys
from typing import NamedTuple

BENCHMARKS = (
    "latency",
    "foreign",
    "facade",
    "throughput",
    "bulk",
    "fanout",
    "camera",
    "cost",
    "memory",
    "startup",
    "launching",
    "idle",
    "timers",
    "growth",
    "discovery",
    "look",
    "web",
    "check_cost",
    "codec",
    "c_client",
    "bags",
    "bridge",
    "fairness",
)
"""All benchmarks in their order; each is a module of this package."""
SIZES = (64, 1 << 10, 1 << 16, 1 << 20, 4 << 20)
"""Sizes of messages, in bytes."""
_QUICK_SIZES = (64, 1 << 20)


class Plan(NamedTuple):
    """`quick`: fewer and shorter measurements; `repetitions`: number of repetitions of each case."""

    quick: bool
    repetitions: int

    @property
    def sizes(self) -> tuple[int, ...]:
        """Sizes of messages, in bytes, from small to large."""
        return _QUICK_SIZES if self.quick else SIZES

    def rounds(self, *, is_essential: bool) -> int:
        """Number of repetitions of a case that a comparison uses (`is_essential`), or of any other case."""
        return self.repetitions if is_essential else max(1, self.repetitions // 4)

    def tell(self, text: str) -> None:
        """Print the current step on a terminal."""
        if sys.stderr.isatty():
            print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)

    def choose(self, quick: int, thorough: int) -> int:
        """One of two amounts of work."""
        return quick if self.quick else thorough
