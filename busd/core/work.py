"""Costs of the broker's work, and long work in pieces.

A unit is about a microsecond on a present-day machine. The prices were measured once and rounded; only their
proportions matter. Knows no clock.
"""

from collections import deque
from collections.abc import Callable, Generator, Iterator
from itertools import islice
from typing import Generic, TypeAlias, TypeVar

from busd.core.timers import Timers

S = TypeVar("S")
T = TypeVar("T")

FRAME = 3
"""A control frame, whatever it says."""
MATCH = 24
"""A match is made, or found incompatible, and both ends are told."""
UNMATCH = 16
TELL = 2
"""One more peer gets a message."""
RECORD = 2
"""A node, an endpoint or a match in an answer about the graph."""
ENDPOINT = 20
"""An endpoint is made or taken out."""
SAMPLES_PER_UNIT = 64
STAMPS_PER_UNIT = 8
"""Samples checked for their age."""
RUNS_PER_UNIT = 2
"""Runs that are dropped."""
RUNS_AT_ONCE = 128
"""Runs that are dropped between two looks at other work."""
QUEUES_PER_UNIT = 2
"""Queues that a run is appended to."""
LOOKS_PER_UNIT = 16
"""Entries of a table that are only looked at."""
RULES_PER_UNIT = 2
"""Rules of access that are compared with a topic."""

Work: TypeAlias = Generator[int, int, None]
"""Long work in pieces: yields the cost of the last piece, and is sent the present time in ns.

While it waits, other peers are served: each piece must leave the tables whole, and must read again the values
that it read before its last yield.
"""

UNLIMITED = 1 << 62


class Meter:
    """The work that may still be done in this turn. The core subtracts the work done; the shell sets it."""

    __slots__ = ("left",)

    def __init__(self, left: int = UNLIMITED) -> None:
        self.left = left


class Rounds(Generic[S, T]):
    """Rounds through many things, `few` at a time: the first at once, the others between other work.

    One round ends before the next one begins. `visit(now_ns, subject, thing)` is called for each thing, at
    the cost `price`. A thing may have gone since its round began.
    """

    def __init__(
        self, timers: Timers, meter: Meter, visit: Callable[[int, S, T], None], *, few: int, price: int
    ) -> None:
        self._timers = timers
        self._meter = meter
        self._visit = visit
        self._few = few
        self._price = price
        self._rounds: deque[tuple[S, Iterator[T]]] = deque()

    def begin(self, now_ns: int, subject: S, things: Iterator[T]) -> None:
        """A round through `things`, after the rounds already begun."""
        self._rounds.append((subject, things))
        if len(self._rounds) == 1:
            self._go_on(now_ns)

    def _go_on(self, now_ns: int) -> None:
        subject, things = self._rounds[0]
        few = list(islice(things, self._few))
        for thing in few:
            self._visit(now_ns, subject, thing)
        self._meter.left -= self._price * len(few)
        if len(few) < self._few:
            self._rounds.popleft()
        if self._rounds:
            self._timers.add(now_ns, self._go_on)
