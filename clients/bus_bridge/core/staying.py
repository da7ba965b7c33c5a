"""Which mirrors stay though their originals have gone, and when one that can't be made is tried again. Pure.

A transient local publisher stays for a while when the link to its bus ends. If it is back by then, those that
have its messages don't get them again.
"""

__all__ = ["NEVER_S", "Retry", "Stays"]

_LINGER_S = 60.0
"""How long a transient local publisher stays when the link to its bus ends."""
_GONE_S = 0.5
"""How long after one has gone it may turn out that the link to its bus has ended."""
_RETURN_S = 5.0
"""Once the bus is back, it has so long to show it."""
_FIRST_RETRY_S, _LONGEST_RETRY_S = 1.0, 4.0
NEVER_S = float("inf")


class Stays:
    """Of the transient local publishers of each bus: until when they stay though they have gone."""

    def __init__(self) -> None:
        self._until_s: dict[str, float] = {}

    def bus_went(self, bus: str, now_s: float) -> None:
        """The link to it has ended."""
        self._until_s[bus] = now_s + _LINGER_S

    def bus_came(self, bus: str, now_s: float) -> None:
        """It is there, perhaps again."""
        if bus in self._until_s:
            self._until_s[bus] = min(self._until_s[bus], now_s + _RETURN_S)

    def until(self, bus: str, gone_s: float) -> float:
        """Until when a publisher of that bus stays which has gone at `gone_s`."""
        return max(self._until_s.get(bus, 0.0), self.least(gone_s))

    def least(self, gone_s: float) -> float:
        """Until when a publisher stays at least which has gone at `gone_s`."""
        return gone_s + _GONE_S

    def next_end(self, now_s: float) -> float:
        """When the next bus has had its time; NEVER_S if there is none. Forgets those that have had it."""
        self._until_s = {bus: until_s for bus, until_s in self._until_s.items() if until_s > now_s}
        return min(self._until_s.values(), default=NEVER_S)


class Retry:
    """When something is tried again that has failed: less often the more often it has."""

    def __init__(self) -> None:
        self.failures = 0
        self.at_s = 0.0

    def fail(self, now_s: float) -> None:
        """It has failed once more."""
        self.failures += 1
        self.at_s = now_s + min(_FIRST_RETRY_S * 2 ** min(self.failures - 1, 8), _LONGEST_RETRY_S)

    def succeed(self) -> None:
        self.failures = 0

    def hurry(self) -> None:
        """What stood in the way has changed: it may be tried at once."""
        self.at_s = 0.0
