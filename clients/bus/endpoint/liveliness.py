"""Liveliness of a subscription's publishers: the states of one publisher, and the numbers in each state.

busd reports the end of each publisher's own lease. If the subscription asks for a longer lease, the rest runs
here.
"""

import asyncio
from collections.abc import Callable, Mapping
from enum import Enum
from typing import Protocol

from bus.events import LivelinessChanged

__all__ = ["TRANSITIONS", "LivelinessWatch", "Sign", "Standing"]


class Standing(Enum):
    """What a subscription knows of one publisher."""

    __hash__ = object.__hash__  # Enum's own is a call in Python

    GONE = "gone"
    """There is no match."""
    UNPROVEN = "unproven"
    """It has given no sign of life since the match. It does not count, neither as alive nor as not alive."""
    ALIVE = "alive"
    """It is alive."""
    OVERDUE = "overdue"
    """Its own lease has ended, but not yet the subscription's longer lease: it counts as alive."""
    NOT_ALIVE = "not alive"
    """The lease of the subscription has ended, too."""


class Sign(Enum):
    """The events of one publisher."""

    __hash__ = object.__hash__

    MATCH = "match"
    """A match was made, and the publisher is alive."""
    MATCH_UNPROVEN = "match, unproven"
    """A match was made, and the publisher has to give a sign of life first."""
    LIFE = "life"
    """It gave a sign of life."""
    LAPSE = "lapse"
    """Its lease ended without a sign, and the subscription's ends with it."""
    LAPSE_EARLY = "lapse, early"
    """Its lease ended without a sign, and the subscription's is longer."""
    END = "end"
    """The subscription's lease ended without a sign."""
    UNMATCH = "unmatch"
    """The match ended."""


TRANSITIONS: Mapping[Standing, Mapping[Sign, Standing]] = {
    Standing.GONE: {Sign.MATCH: Standing.ALIVE, Sign.MATCH_UNPROVEN: Standing.UNPROVEN},
    Standing.UNPROVEN: {Sign.LIFE: Standing.ALIVE, Sign.UNMATCH: Standing.GONE},
    Standing.ALIVE: {
        Sign.LAPSE: Standing.NOT_ALIVE,
        Sign.LAPSE_EARLY: Standing.OVERDUE,
        Sign.UNMATCH: Standing.GONE,
    },
    Standing.OVERDUE: {
        Sign.LIFE: Standing.ALIVE,
        Sign.END: Standing.NOT_ALIVE,
        Sign.UNMATCH: Standing.GONE,
    },
    Standing.NOT_ALIVE: {Sign.LIFE: Standing.ALIVE, Sign.UNMATCH: Standing.GONE},
}
"""Any other event changes nothing."""

_COUNTED = {Standing.ALIVE: (1, 0), Standing.OVERDUE: (1, 0), Standing.NOT_ALIVE: (0, 1)}


class Later(Protocol):
    """The event loop's timers."""

    def later(self, delay_s: float, call: Callable[[], object], /) -> asyncio.TimerHandle: ...


class LivelinessWatch:
    """Keeps the standing of each matched publisher, by the broker's number, and calls `tell` on changes.

    `lease_ns` is the lease that the subscription asks for.
    """

    def __init__(self, loop: Later, lease_ns: int, tell: Callable[[LivelinessChanged], object]) -> None:
        self._loop = loop
        self._lease_ns = lease_ns
        self._tell = tell
        self._standings: dict[int, Standing] = {}
        self._timers: dict[int, asyncio.TimerHandle] = {}
        self._alive = 0
        self._not_alive = 0

    def match(self, publisher: int, *, is_proven: bool) -> None:
        """Note a new match. A publisher that is not proven counts from its next sign of life."""
        self._follow(publisher, Sign.MATCH if is_proven else Sign.MATCH_UNPROVEN)

    def life(self, publisher: int) -> None:
        """Note a sign of life, after the end of a lease or as the first since the match."""
        self._follow(publisher, Sign.LIFE)

    def lapse(self, publisher: int, lease_ns: int) -> None:
        """Note that the publisher's own lease, of `lease_ns`, ended without a sign of life."""
        rest_ns = self._lease_ns - lease_ns
        if rest_ns <= 0:
            self._follow(publisher, Sign.LAPSE)
        elif self._follow(publisher, Sign.LAPSE_EARLY):
            self._timers[publisher] = self._loop.later(rest_ns / 1e9, lambda: self._end_lease(publisher))

    def unmatch(self, publisher: int) -> None:
        """Note that the match ended."""
        self._follow(publisher, Sign.UNMATCH)

    def end(self) -> None:
        """End, with the subscription."""
        for timer in self._timers.values():
            timer.cancel()
        self._timers.clear()

    def _end_lease(self, publisher: int) -> None:
        self._follow(publisher, Sign.END)

    def _follow(self, publisher: int, sign: Sign) -> bool:
        """Go to the next state, and report it. Returns whether the state changed."""
        before = self._standings.get(publisher, Standing.GONE)
        after = TRANSITIONS[before].get(sign)
        if after is None:
            return False
        if (timer := self._timers.pop(publisher, None)) is not None:
            timer.cancel()
        self._standings[publisher] = after
        if after is Standing.GONE:
            del self._standings[publisher]
        was_alive, was_not = _COUNTED.get(before, (0, 0))
        is_alive, is_not = _COUNTED.get(after, (0, 0))
        alive_change, not_alive_change = is_alive - was_alive, is_not - was_not
        if alive_change or not_alive_change:
            self._alive += alive_change
            self._not_alive += not_alive_change
            self._tell(LivelinessChanged(self._alive, self._not_alive, alive_change, not_alive_change))
        return True
