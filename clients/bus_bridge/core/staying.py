"""How long mirrors stay after their originals have gone, and when a mirror is tried again that failed. Pure.

If the link to a bus ends, the mirrors of its transient local publishers stay for a while. If the publishers
are back by then, subscriptions that have their messages don't get them again.
"""

__all__ = ["NEVER_S", "Retry", "Stays"]

_LINGER_S = 60.0
"""How long such a mirror stays after the link to its bus has ended."""
_GONE_S = 0.5
"""How long it stays without news of the link: a publisher may be seen to go before the link is."""
_RETURN_S = 5.0
"""How long it stays once the bus is back, which has to show the publisher by then."""
_FIRST_RETRY_S, _LONGEST_RETRY_S = 1.0, 4.0
NEVER_S = float("inf")


class Stays:
    """How long the mirrors of transient local publishers stay, for each bus."""

    def __init__(self) -> None:
        self._until_s: dict[str, float] = {}

    def bus_removed(self, bus: str, now_s: float) -> None:
        """The link to it has ended."""
        self._until_s[bus] = now_s + _LINGER_S

    def bus_added(self, bus: str, now_s: float) -> None:
        """The bus is there, perhaps again."""
        if bus in self._until_s:
            self._until_s[bus] = min(self._until_s[bus], now_s + _RETURN_S)

    def until(self, bus: str, gone_s: float) -> float:
        """Until when a publisher of that bus stays which has gone at `gone_s`."""
        return max(self._until_s.get(bus, 0.0), self.least(gone_s))

    def least(self, gone_s: float) -> float:
        """Until when a publisher stays at least which has gone at `gone_s`."""
        return gone_s + _GONE_S

    def next_end(self, now_s: float) -> float:
        """When the time of the next bus ends; NEVER_S without one. Forgets each bus after its time."""
        self._until_s = {bus: until_s for bus, until_s in self._until_s.items() if until_s > now_s}
        return min(self._until_s.values(), default=NEVER_S)


class Retry:
    """When a failed attempt is repeated. The pause grows with each failure."""

    def __init__(self) -> None:
        self.failures = 0
        self.at_s = 0.0

    def fail(self, now_s: float) -> None:
        """An attempt has failed."""
        self.failures += 1
        self.at_s = now_s + min(_FIRST_RETRY_S * 2 ** min(self.failures - 1, 8), _LONGEST_RETRY_S)

    def succeed(self) -> None:
        self.failures = 0

    def hurry(self) -> None:
        """The next attempt may be made at once."""
        self.at_s = 0.0
