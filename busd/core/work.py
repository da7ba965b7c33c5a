"""What the broker's work costs, and long work that can be left and taken up again.

A unit is about a microsecond on a present-day machine. The prices were measured once and are rounded; that
they are in proportion is what matters. Knows no clock.
"""

from collections.abc import Generator
from typing import TypeAlias

FRAME = 3
"""A control frame, whatever it says."""
MATCH = 24
"""A match is made, or found incompatible, and both are told."""
UNMATCH = 16
TELL = 2
"""One more peer is told something."""
RECORD = 2
"""A node, an endpoint or a match in an answer about the graph."""
ENDPOINT = 20
"""An endpoint is made or taken out."""
SAMPLES_PER_UNIT = 64
RUNS_PER_UNIT = 4
"""Runs that are dropped."""
QUEUES_PER_UNIT = 2
"""Queues that a run is appended to."""
LOOKS_PER_UNIT = 16
"""Entries of a table that are only looked at."""

Work: TypeAlias = Generator[int, int, None]
"""Long work in pieces: yields what the last piece cost, and is sent the present time in ns.

While it stands still, other peers are served: each piece must leave the tables whole, and must not rely on
what it saw before its last yield.
"""

UNLIMITED = 1 << 62


class Meter:
    """The work that may still be done in this turn. The core takes off what it does; the shell sets it."""

    __slots__ = ("left",)

    def __init__(self, left: int = UNLIMITED) -> None:
        self.left = left
