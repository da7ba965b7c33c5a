"""Sums of the bridges' counters by topic. They only grow, also if routes or bridges go. Pure."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from bus.vocabulary import DropReason
from bus_cli.metrics.growth import Growth
from bus_cli.metrics.sums import Labels, Sums

if TYPE_CHECKING:  # the module imports the node, which is slow
    from bus_cli.bridge.remote import Answer

__all__ = ["BridgeTotals", "links", "waiting"]

_MOST_GONE = 16_384
"""Most routes and bridges that are gone but remembered, because they come back with their totals."""
_COUNTERS = ("taken", "sent", "bytes", "lost")


class BridgeTotals:
    """Sums of the counters of all routes by bridge, direction and topic; at most `most` rows of each kind."""

    def __init__(self, most: int) -> None:
        self.taken, self.sent, self.bytes, self.lost = Sums(most), Sums(most), Sums(most), Sums(most)
        self.dropped = Sums(most)
        """Drops, also by reason. Messages lost before they reached the bridge are not included."""
        self.refused = Sums(most)
        """Refused connections, by bridge."""
        self._routes = Growth("taken", _MOST_GONE)
        self._bridges = Growth("refused", _MOST_GONE)

    def take(self, bridges: "Mapping[str, Answer]") -> None:
        """Add the growth of all counters. `bridges` has the status of all bridges at one moment, by name."""
        amounts: dict[str, dict[Labels, int]] = {name: {} for name in _COUNTERS}
        dropped: dict[Labels, int] = {}
        for (bridge, direction, _, topic), grown in self._routes.take(_routes(bridges)).items():
            labels = (bridge, direction, topic)
            for name, amount in grown.items():
                if name in amounts:
                    _add(amounts[name], labels, amount)
                else:
                    _add(dropped, (*labels, name), amount)
        for name, rows in amounts.items():
            getattr(self, name).add(rows)
        self.dropped.add(dropped)
        refused: dict[Labels, dict[str, int]] = {
            (bridge,): {"refused": status.refused} for bridge, status in bridges.items()
        }
        self.refused.add({bridge: one["refused"] for bridge, one in self._bridges.take(refused).items()})


def _routes(bridges: "Mapping[str, Answer]") -> dict[Labels, dict[str, int]]:
    """The counters of each route: its own ones, and its drops by reason."""
    found: dict[Labels, dict[str, int]] = {}
    for bridge, status in bridges.items():
        for route in status.routes:
            # Put the reasons first: then no reason can replace one of the route's own counters.
            dropped = {
                reason: count
                for reason, count in route.dropped.items()
                if reason != DropReason.LOST_ON_THE_WAY
            }
            found[(bridge, route.direction, route.gid, route.topic)] = {
                **dropped,
                "taken": route.taken,
                "sent": route.sent,
                "bytes": route.bytes,
                "lost": route.dropped.get(DropReason.LOST_ON_THE_WAY, 0),
            }
    return found


def waiting(bridges: "Mapping[str, Answer]") -> dict[Labels, float]:
    """Messages queued in bridges, by bridge, direction and topic."""
    return _count(bridges, lambda one: [((r.direction, r.topic), r.waiting) for r in one.routes if r.waiting])


def links(bridges: "Mapping[str, Answer]") -> dict[Labels, float]:
    """The number of links, by bridge and state."""
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
    amounts[labels] = amounts.get(labels, 0) + amount
