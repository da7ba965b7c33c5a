"""The results of a soak: intervals, totals, and their evaluation. Pure."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import msgspec

from benchmarks.soaking.histogram import Histogram, Percentiles
from benchmarks.soaking.slope import Line, Quantity, Verdict, after_warm_up, fit


class Interval(msgspec.Struct, frozen=True):
    """The events up to `at_s` since the start, and the resources of the processes then (as in
    `usage.Usage`)."""

    at_s: float
    latency: dict[str, Percentiles]
    usage: dict[str, tuple[float, ...]]


class Totals(msgspec.Struct, frozen=True):
    """Final counters of one permanent subscription."""

    topic: str
    kind: str
    delivered: int
    queued: int
    dropped: dict[str, int]

    @property
    def lost(self) -> int:
        return sum(self.dropped.values())


class Judged(NamedTuple):
    """One quantity of one process over the run."""

    process: str
    quantity: Quantity
    line: Line
    begin: float
    end: float

    @property
    def verdict(self) -> Verdict:
        return self.line.verdict(self.quantity)


class Record:
    """Collects results while the soak runs. `failures` has texts about forbidden events."""

    def __init__(self) -> None:
        self.intervals: list[Interval] = []
        self.ages: dict[str, Histogram] = {}
        self.published: dict[str, int] = {}
        self.totals: dict[str, Totals] = {}
        self.visits = self.visited = self.queries = 0
        self.failures: list[str] = []

    def note_interval(
        self,
        at_s: float,
        ages: Mapping[str, Sequence[Histogram]],
        usage: Mapping[str, tuple[float, ...]],
    ) -> Interval:
        """Add an interval. Each group of latencies has the histograms of several processes."""
        latency = {}
        for group, parts in ages.items():
            merged = Histogram()
            for part in parts:
                merged.merge(part)
            self.ages.setdefault(group, Histogram()).merge(merged)
            if found := merged.percentiles():
                latency[group] = found
        self.intervals.append(Interval(at_s, latency, dict(usage)))
        return self.intervals[-1]

    def open_accounts(self) -> list[str]:
        """Texts about subscriptions for which published differs from delivered + dropped, or with forbidden
        losses."""
        found = []
        for name, one in self.totals.items():
            published = self.published.get(one.topic, 0)
            counted = f"{published} published, {one.delivered} delivered, {one.queued} queued, {one.dropped}"
            if one.delivered + one.lost != published or one.queued:
                found.append(f"the account of {name} is open: {counted}")
            elif one.kind == "lossless" and one.lost:
                found.append(f"{name} lost messages: {counted}")
        return found

    def drops(self) -> dict[str, int]:
        """Drops by reason, of all subscriptions."""
        found: dict[str, int] = {}
        for one in self.totals.values():
            for reason, count in one.dropped.items():
                found[reason] = found.get(reason, 0) + count
        return found

    def judge(self, quantities: Sequence[Quantity]) -> list[Judged]:
        """Judge every quantity of every process; the warm-up is left out."""
        times_s = [one.at_s for one in self.intervals]
        first = after_warm_up(times_s)
        found = []
        for process in self.intervals[-1].usage if self.intervals else ():
            for index, quantity in enumerate(quantities):
                values = [one.usage[process][index] for one in self.intervals]
                line = fit(times_s[first:], values[first:])
                found.append(Judged(process, quantity, line, values[0], values[-1]))
        return found
