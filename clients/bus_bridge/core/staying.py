"""Times for which mirrors stay after their originals have gone, and times of retries for failed mirrors.
Pure.

If the link to a bus ends, the mirrors of its transient local publishers stay for a while. If the publishers
come back in that time, subscriptions do not get the same messages again.
"""

__all__ = ["NEVER_S", "Retry", "Stays"]

_LINGER_S = 60.0
"""Time for which such a mirror stays after the end of the link to its bus."""
_GONE_S = 0.5
"""Time for which it stays without news of the link: a publisher's end may be noticed before the link's."""
_RETURN_S = 5.0
"""Time for which it stays after the return of its bus. Within it, the bus must show the publisher again."""
_FIRST_RETRY_S, _LONGEST_RETRY_S = 1.0, 4.0
NEVER_S = float("inf")


class Stays:
    """The times until which mirrors of transient local publishers stay, for each bus."""

    def __init__(self) -> None:
        self._until_s: dict[str, float] = {}

    def bus_removed(self, bus: str, now_s: float) -> None:
        """Handle the end of the link to a bus."""
        self._until_s[bus] = now_s + _LINGER_S

    def bus_added(self, bus: str, now_s: float) -> None:
        """Handle a bus that has come, perhaps again."""
        if bus in self._until_s:
            self._until_s[bus] = min(self._until_s[bus], now_s + _RETURN_S)

    def until(self, bus: str, gone_s: float) -> float:
        """Time until which a publisher of that bus stays if it has gone at `gone_s`."""
        return max(self._until_s.get(bus, 0.0), self.least(gone_s))

    def least(self, gone_s: float) -> float:
        """Shortest time until which a publisher stays if it has gone at `gone_s`."""
        return gone_s + _GONE_S

    def next_end(self, now_s: float) -> float:
        """The earliest end of a bus's time; NEVER_S without one. Forgets each bus after its time."""
        self._until_s = {bus: until_s for bus, until_s in self._until_s.items() if until_s > now_s}
        return min(self._until_s.values(), default=NEVER_S)


class Retry:
    """Time of the next attempt after a failed one. The pause grows with each failure."""

    def __init__(self) -> None:
        self.failures = 0
        self.at_s = 0.0

    def fail(self, now_s: float) -> None:
        """Record a failed attempt."""
        self.failures += 1
        self.at_s = now_s + min(_FIRST_RETRY_S * 2 ** min(self.failures - 1, 8), _LONGEST_RETRY_S)

    def succeed(self) -> None:
        self.failures = 0

    def hurry(self) -> None:
        """Allow the next attempt at once."""
        self.at_s = 0.0
