"""The growth of counters that may restart at 0, for example after a restart of their process. Pure."""

from collections.abc import Mapping

from bus_cli.metrics.sums import Labels

__all__ = ["Growth"]


class Growth:
    """Counters by name, for things identified by their labels.

    If the counter `leading` of a thing is lower than before, all its counters have restarted at 0. Growth
    remembers the last `most_gone` things that are gone, because they may come back with their counters.
    """

    def __init__(self, leading: str, most_gone: int) -> None:
        self._leading = leading
        self._most_gone = most_gone
        self._before: dict[Labels, Mapping[str, int]] = {}

    def take(self, now: Mapping[Labels, Mapping[str, int]]) -> dict[Labels, dict[str, int]]:
        """Takes the counters of all present things; returns their growth since the last call."""
        grown: dict[Labels, dict[str, int]] = {}
        for thing, counters in now.items():
            before = self._before.get(thing, {})
            if before.get(self._leading, 0) > counters[self._leading]:
                before = {}
            grown[thing] = {name: max(0, count - before.get(name, 0)) for name, count in counters.items()}
        gone = [(thing, counters) for thing, counters in self._before.items() if thing not in now]
        self._before = {**dict(gone[-self._most_gone :]), **now}
        return grown
