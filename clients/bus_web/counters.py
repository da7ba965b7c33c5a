"""Counters of endpoints and of groups, from look to look: rates, recent losses, ages. Pure."""

from collections import deque
from collections.abc import Iterable, Mapping
from typing import Any

from bus.base.time_parts import PARTS
from bus.graph import EndpointStatistics, GraphEndpoint
from bus.qos import History, QoSProfile
from bus_plot.histogram import quantile
from bus_plot.loss_timeline import LossTimeline
from bus_web.rates import HISTORY_S, Meter, RateHistory
from bus_web.rows import Ages

__all__ = ["Counters", "Group", "age_parts_of", "ages_of", "depth_of", "lost_history_of"]

_NS = 1_000_000_000
_NOW_NS = 3 * _NS
"""Losses within that time count as present losses."""
_AGES_NS = 10 * _NS
"""A process reports about a hundred ages a second at most: p99 needs several seconds."""
_NOTHING = EndpointStatistics()


def depth_of(qos: QoSProfile) -> int | None:
    return qos.depth if qos.history is History.KEEP_LAST else None


class Counters:
    """Counters of one endpoint over several looks; `endpoint` and `statistics` are from the newest look."""

    __slots__ = (
        "age_reports",
        "aged",
        "dropped",
        "endpoint",
        "is_reported",
        "looked_ns",
        "losses",
        "lost",
        "lost_per_s",
        "meter",
        "new_losses",
        "rates",
        "since_ns",
        "statistics",
        "timeline",
    )

    def __init__(self) -> None:
        self.endpoint: GraphEndpoint
        self.statistics = _NOTHING
        self.aged: EndpointStatistics | None = None
        """The newest recent statistics with ages."""
        self.age_reports: deque[tuple[int, tuple[int, ...]]] = deque()
        """The reports of ages in the last ten seconds: their time and histogram."""
        self.meter = Meter()
        self.rates: tuple[float, ...] | None = None
        self.losses: list[tuple[int, int]] = []  # when, and how many in all: of the last seconds
        self.lost = -1
        self.lost_per_s = 0.0
        self.looked_ns = 0
        self.is_reported = False
        """Whether its process has ever reported counters."""
        self.dropped: Mapping[str, int] = {}
        """Messages lost, by reason. After a restart of busd these are the earlier figures, until the process
        reports its own."""
        self.new_losses: Mapping[str, int] = {}
        """The messages lost since `since_ns`."""
        self.since_ns = 0
        """The time of the look before; 0 if there was none."""
        self.timeline: LossTimeline | None = None
        """When they were lost; None if none was."""

    def take(self, endpoint: GraphEndpoint, now_ns: int, looked_ns: int = 0) -> None:
        """`looked_ns`: the time of the last look at the bus, without this endpoint; 0 if there was none."""
        self.endpoint = endpoint
        self.statistics = statistics = endpoint.statistics or _NOTHING
        if statistics.at_ns or not self.is_reported:
            self._note(statistics.dropped, now_ns, self.looked_ns or looked_ns)
            self.is_reported |= statistics.at_ns > 0
        else:
            self.new_losses = {}
        self.meter.add(statistics.at_ns, statistics.samples, statistics.bytes)
        self.rates = self.meter.rates(now_ns)
        if statistics.age_count:
            self.aged = statistics
            if not self.age_reports or self.age_reports[-1][0] < statistics.at_ns:
                self.age_reports.append((statistics.at_ns, statistics.age_parts))
            while self.age_reports[0][0] <= statistics.at_ns - _AGES_NS:
                self.age_reports.popleft()
        elif self.aged is not None and now_ns - self.aged.at_ns > _NOW_NS:
            self.aged = None
            self.age_reports.clear()
        lost = sum(self.dropped.values()) if self.dropped else 0
        if lost != self.lost or len(self.losses) != 1:
            self._lose(lost, now_ns)
        self.looked_ns = now_ns

    def _note(self, dropped: Mapping[str, int], now_ns: int, looked_ns: int) -> None:
        """Note the losses since the look at `looked_ns`. Lower counts than before are a new start."""
        before, self.dropped = self.dropped, dropped
        if dropped == before:
            self.new_losses = {}
            return
        lost = {reason: count - min(before.get(reason, 0), count) for reason, count in dropped.items()}
        if self.timeline is None:
            self.timeline = LossTimeline()
        self.new_losses, self.since_ns = lost, looked_ns
        _note_losses(self.timeline, lost, looked_ns, now_ns)

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


def _note_losses(timeline: LossTimeline, lost: Mapping[str, int], since_ns: int, now_ns: int) -> None:
    """Add losses to a timeline; `since_ns` of 0: their begin is not known."""
    if since_ns:
        timeline.add(since_ns / _NS, now_ns / _NS, lost)
    else:
        timeline.add_earlier(lost)


def ages_of(counters: Iterable[Counters]) -> Ages | None:
    number = sum_ns = most_ns = 0
    known = [*counters]
    for one in known:
        if (aged := one.aged) is not None:
            number += aged.age_count
            sum_ns += aged.age_sum_ns
            most_ns = max(most_ns, aged.age_max_ns)
    if not number:
        return None
    parts = age_parts_of(known)
    p50, p99 = (quantile(parts, share) / _NS for share in (0.5, 0.99)) if any(parts) else (None, None)
    return Ages(sum_ns / number / _NS, most_ns / _NS, p50, p99)


def age_parts_of(counters: Iterable[Counters]) -> list[int]:
    """The histogram of the ages of the last ten seconds, in the parts of `bus.base.time_parts`."""
    total = [0] * PARTS
    for one in counters:
        for _, parts in one.age_reports:
            for part, number in enumerate(parts):
                total[part] += number
    return total


def lost_history_of(timelines: Iterable[LossTimeline | None], now_ns: int) -> tuple[float, ...]:
    """Messages lost in each of the last seconds; empty if none was."""
    end_s = now_ns // _NS + 1
    begin_s = end_s - HISTORY_S
    found = [one for one in timelines if one is not None and one.newest_s >= begin_s]
    bars = [one.bars(begin_s, end_s, HISTORY_S) for one in found]
    return tuple(map(sum, zip(*bars, strict=True))) if any(map(any, bars)) else ()


class Group:
    """The endpoints of a topic, or of a node, with their combined counters."""

    __slots__ = (
        "bytes_per_s",
        "fixed",
        "history",
        "hz",
        "is_hidden",
        "looked_ns",
        "publishers",
        "subscriptions",
        "timeline",
    )

    def __init__(
        self, history: RateHistory, timeline: LossTimeline | None = None, *, is_hidden: bool
    ) -> None:
        """`timeline`: the losses of a topic, also of its subscriptions that have left; None for a node."""
        self.publishers: list[Counters] = []
        self.subscriptions: list[Counters] = []
        self.is_hidden = is_hidden
        self.history = history
        self.timeline = timeline
        self.looked_ns = 0
        self.hz: float | None = None
        self.bytes_per_s: float | None = None
        self.fixed: dict[str, Any] | None = None
        """The fields of its row that change only with the graph."""

    @property
    def ends(self) -> list[GraphEndpoint]:
        return [one.endpoint for one in (*self.publishers, *self.subscriptions)]

    def add(self, now_ns: int) -> None:
        """Its endpoints have been looked at."""
        self.looked_ns = now_ns
        if self.timeline is not None:
            for one in self.subscriptions:
                if one.new_losses:
                    _note_losses(self.timeline, one.new_losses, one.since_ns, now_ns)
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
        queued, depth, lost_per_s = -1, None, 0.0
        for one in self.subscriptions:
            counters = one.statistics
            for reason, count in one.dropped.items():
                dropped[reason] = dropped.get(reason, 0) + count
            if counters.queued > queued:
                queued, depth = counters.queued, depth_of(one.endpoint.qos)
            lost_per_s += one.lost_per_s
        return {
            "hz": self.hz,
            "bytes_per_s": self.bytes_per_s,
            "history": self.history.values,
            "queued": max(queued, 0),
            "depth": depth,
            "age": ages_of(self.subscriptions),
            "lost_per_s": lost_per_s,
            "dropped": dropped,
            "lost_history": lost_history_of(self._timelines(), self.looked_ns),
            "lost_in_all": sum(one.total for one in self._timelines()),
        }

    def _timelines(self) -> list[LossTimeline]:
        if self.timeline is not None:
            return [self.timeline]
        return [one.timeline for one in self.subscriptions if one.timeline is not None]
