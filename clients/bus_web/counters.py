"""Counters of endpoints and of groups, from look to look: rates, recent losses, ages. Pure."""

from collections.abc import Iterable
from typing import Any

from bus.graph import EndpointStatistics, GraphEndpoint
from bus.qos import History, QoSProfile
from bus_web.rates import Meter, RateHistory
from bus_web.rows import Ages

__all__ = ["Counters", "Group", "ages_of", "depth_of"]

_NS = 1_000_000_000
_NOW_NS = 3 * _NS
"""Losses within that time count as present losses."""
_NOTHING = EndpointStatistics()


def depth_of(qos: QoSProfile) -> int | None:
    return qos.depth if qos.history is History.KEEP_LAST else None


class Counters:
    """Counters of one endpoint over several looks; `endpoint` and `statistics` are from the newest look."""

    __slots__ = (
        "aged",
        "endpoint",
        "looked_ns",
        "losses",
        "lost",
        "lost_per_s",
        "meter",
        "rates",
        "statistics",
    )

    def __init__(self) -> None:
        self.endpoint: GraphEndpoint
        self.statistics = _NOTHING
        self.aged: EndpointStatistics | None = None
        """The newest recent statistics with ages."""
        self.meter = Meter()
        self.rates: tuple[float, ...] | None = None
        self.losses: list[tuple[int, int]] = []  # when, and how many in all: of the last seconds
        self.lost = -1
        self.lost_per_s = 0.0
        self.looked_ns = 0

    def take(self, endpoint: GraphEndpoint, now_ns: int) -> None:
        self.endpoint = endpoint
        self.statistics = statistics = endpoint.statistics or _NOTHING
        self.meter.add(statistics.at_ns, statistics.samples, statistics.bytes)
        self.rates = self.meter.rates(now_ns)
        if statistics.age_count:
            self.aged = statistics
        elif self.aged is not None and now_ns - self.aged.at_ns > _NOW_NS:
            self.aged = None
        lost = sum(statistics.dropped.values()) if statistics.dropped else 0
        if lost != self.lost or len(self.losses) != 1:
            self._lose(lost, now_ns)
        self.looked_ns = now_ns

    def _lose(self, lost: int, now_ns: int) -> None:
        losses, self.lost = self.losses, lost
        if losses and losses[0][1] == lost:
            losses[:] = [(max(losses[0][0], now_ns - _NOW_NS), lost)]
            self.lost_per_s = 0.0
            return
        if losses and lost < losses[-1][1]:
            losses.clear()
        if len(losses) == 1:  # as many until the last look
            losses[0] = max(losses[0][0], self.looked_ns - _NOW_NS), losses[0][1]
        losses.append((now_ns, lost))
        while len(losses) > 2 and losses[1][0] <= now_ns - _NOW_NS:
            del losses[0]
        span_ns = now_ns - losses[0][0]
        self.lost_per_s = (lost - losses[0][1]) * _NS / span_ns if span_ns else 0.0


def ages_of(counters: Iterable[Counters]) -> Ages | None:
    number = sum_ns = most_ns = 0
    for one in counters:
        if (aged := one.aged) is not None:
            number += aged.age_count
            sum_ns += aged.age_sum_ns
            most_ns = max(most_ns, aged.age_max_ns)
    return Ages(sum_ns / number / _NS, most_ns / _NS) if number else None


class Group:
    """The endpoints of a topic, or of a node, with their combined counters."""

    __slots__ = ("bytes_per_s", "fixed", "history", "hz", "is_hidden", "publishers", "subscriptions")

    def __init__(self, history: RateHistory, *, is_hidden: bool) -> None:
        self.publishers: list[Counters] = []
        self.subscriptions: list[Counters] = []
        self.is_hidden = is_hidden
        self.history = history
        self.hz: float | None = None
        self.bytes_per_s: float | None = None
        self.fixed: dict[str, Any] | None = None
        """The fields of its row that change only with the graph."""

    @property
    def ends(self) -> list[GraphEndpoint]:
        return [one.endpoint for one in (*self.publishers, *self.subscriptions)]

    def add(self, now_ns: int) -> None:
        """Its endpoints have been looked at."""
        hz = bytes_per_s = None
        for one in self.publishers:
            if (rates := one.rates) is not None:
                hz, bytes_per_s = (hz or 0.0) + rates[0], (bytes_per_s or 0.0) + rates[1]
        self.hz, self.bytes_per_s = hz, bytes_per_s
        if hz is not None or self.history:  # an unknown rate is not zero
            self.history.add(now_ns, hz or 0.0)

    def counted(self) -> dict[str, Any]:
        """The fields that rows have in common and that change with every look."""
        dropped: dict[str, int] = {}
        queued, most, depth, lost_per_s = 0, -1, None, 0.0
        for one in self.subscriptions:
            counters = one.statistics
            for reason, count in counters.dropped.items():
                dropped[reason] = dropped.get(reason, 0) + count
            queued += counters.queued
            if counters.queued > most:
                most, depth = counters.queued, depth_of(one.endpoint.qos)
            lost_per_s += one.lost_per_s
        return {
            "hz": self.hz,
            "bytes_per_s": self.bytes_per_s,
            "history": self.history.values,
            "queued": queued,
            "depth": depth,
            "age": ages_of(self.subscriptions),
            "lost_per_s": lost_per_s,
            "dropped": dropped,
        }
