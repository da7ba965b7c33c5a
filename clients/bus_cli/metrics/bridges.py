"""What bridges count, added up by topic: sums that only grow, also when routes or bridges go. Pure."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from bus.vocabulary import DropReason
from bus_bridge.core.status import RouteState
from bus_cli.metrics.sums import Labels, Sums

if TYPE_CHECKING:  # asking takes a node
    from bus_cli.bridge.remote import Answer

__all__ = ["BridgeTotals", "links", "waiting"]

_MOST_GONE = 16_384
"""Routes that are gone and remembered: they come back with their totals."""


class BridgeTotals:
    """What all routes have counted, `most` rows of each kind; by bridge, direction and topic."""

    def __init__(self, most: int) -> None:
        self.taken, self.sent, self.bytes, self.lost = Sums(most), Sums(most), Sums(most), Sums(most)
        self.dropped = Sums(most)
        """By reason besides. What was lost before it came to the bridge is not in it."""
        self.refused = Sums(most)
        """Connections, by bridge."""
        self._heard: dict[Labels, RouteState] = {}
        self._refused: dict[str, int] = {}

    def take(self, bridges: "Mapping[str, Answer]") -> None:
        """What all bridges say at one moment, by name. Counters that have fallen began anew, at 0."""
        amounts: dict[str, dict[Labels, int]] = {"taken": {}, "sent": {}, "bytes": {}, "lost": {}}
        dropped: dict[Labels, int] = {}
        heard: dict[Labels, RouteState] = {}
        for bridge, status in bridges.items():
            for route in status.routes:
                key = (bridge, route.direction, route.gid, route.topic)
                before = self._heard.get(key) or RouteState()
                if before.taken > route.taken:
                    before = RouteState()
                heard[key] = route
                labels = (bridge, route.direction, route.topic)
                for name in ("taken", "sent", "bytes"):
                    _add(amounts[name], labels, getattr(route, name) - getattr(before, name))
                _add(amounts["lost"], labels, _grown(route, before, DropReason.LOST_ON_THE_WAY))
                for reason in route.dropped:
                    if reason != DropReason.LOST_ON_THE_WAY:
                        _add(dropped, (*labels, reason), _grown(route, before, reason))
        now = {bridge: status.refused for bridge, status in bridges.items()}
        before_now = {bridge: self._refused.get(bridge, 0) for bridge in now}
        self.refused.add(
            {(one,): now[one] - (before_now[one] if before_now[one] <= now[one] else 0) for one in now}
        )
        self._refused = now
        gone = [(key, route) for key, route in self._heard.items() if key not in heard]
        self._heard = {**dict(gone[-_MOST_GONE:]), **heard}
        for name, rows in amounts.items():
            getattr(self, name).add(rows)
        self.dropped.add(dropped)


def waiting(bridges: "Mapping[str, Answer]") -> dict[Labels, float]:
    """Messages that wait in bridges, by bridge, direction and topic."""
    return _count(bridges, lambda one: [((r.direction, r.topic), r.waiting) for r in one.routes if r.waiting])


def links(bridges: "Mapping[str, Answer]") -> dict[Labels, float]:
    """How many links bridges have, by bridge and state."""
    return _count(bridges, lambda one: [((link.state,), 1) for link in one.links])


def _count(
    bridges: "Mapping[str, Answer]", rows_of: Callable[["Answer"], list[tuple[Labels, int]]]
) -> dict[Labels, float]:
    found: dict[Labels, float] = {}
    for bridge, status in bridges.items():
        for labels, number in rows_of(status):
            found[(bridge, *labels)] = found.get((bridge, *labels), 0) + number
    return found


def _add(amounts: dict[Labels, int], labels: Labels, amount: int) -> None:
    amounts[labels] = amounts.get(labels, 0) + max(0, amount)


def _grown(route: RouteState, before: RouteState, reason: str) -> int:
    return route.dropped.get(reason, 0) - before.dropped.get(reason, 0)
