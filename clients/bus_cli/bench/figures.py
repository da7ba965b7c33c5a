"""Results of a measurement: percentiles, rates, losses and their tables. Knows no processes."""

import math
from collections.abc import Iterable, Sequence

import msgspec

from bus.base.time_parts import PARTS, part_of
from bus_cli.bench.task import Sent, Settled
from bus_cli.output import size_text, table
from bus_plot.histogram import bounds, histogram, lines

__all__ = ["PERCENTILES", "Ages", "Run", "ages", "bytes_text", "percentile", "plots", "tables"]

PERCENTILES = (50.0, 90.0, 99.0, 99.9, 100.0)
_COLUMNS = ("p50", "p90", "p99", "p99.9", "max")


class Ages(msgspec.Struct, frozen=True, rename={"p99_9": "p99.9"}):
    """Percentiles (nearest rank) of the ages of `samples` messages, in µs."""

    samples: int
    p50: float
    p90: float
    p99: float
    p99_9: float
    max: float
    histogram: list[tuple[float, float, int]]
    """Begin and end of each part with samples, in µs, and their number: two parts for each doubling."""


def percentile(ordered: Sequence[float], percent: float) -> float:
    """The smallest sample that at least `percent` % of the `ordered` samples don't exceed (nearest rank).

    The result is always a measured sample, never interpolated; 100 gives the largest.
    Raises ValueError if there are no samples, or if `percent` is not in 0..100.
    """
    if not ordered or not 0 <= percent <= 100:
        raise ValueError(f"no {percent:g}th percentile of {len(ordered)} samples")
    # 99.9 % of 1,000 is 999, but 999.0000000000001 in floating point.
    rank = math.ceil(round(percent * len(ordered) / 100, 9))
    return ordered[max(rank, 1) - 1]


def ages(samples_ns: Iterable[int]) -> Ages | None:
    """Percentiles of samples in ns; None if there are no samples."""
    ordered = sorted(samples_ns)
    if not ordered:
        return None
    parts = []
    for part, count in enumerate(histogram(ordered)):
        if count:
            begin_ns, end_ns = bounds(part)
            parts.append((begin_ns / 1000, end_ns / 1000, count))
    p50, p90, p99, p99_9, largest = [percentile(ordered, percent) / 1000 for percent in PERCENTILES]
    return Ages(len(ordered), p50, p90, p99, p99_9, largest, parts)


class Run(msgspec.Struct, frozen=True, kw_only=True):
    """One measurement with one size, at a pace or at full speed. Its fields are the keys of --json."""

    size: int
    """Bytes in the sized field of each message."""
    rate: float | None
    """Messages/s of each publisher by the schedule; None: at full speed."""
    route: str
    """shm, socket, or shm+socket."""
    seconds: float
    """Time from the publication of the first message to the arrival of the last."""
    published: int
    """Messages of all publishers."""
    expected: int
    """Expected deliveries: `published` times the number of subscribers."""
    delivered: int
    """Deliveries to all subscribers."""
    dropped: dict[str, int]
    """Missing deliveries by drop reason."""
    unaccounted: int
    """Missing deliveries without a drop reason."""
    published_per_s: float
    delivered_per_s: float
    bytes_per_s: float
    """Rate of the sized field's bytes, in all deliveries."""
    since_sent_us: Ages | None
    """Time from publishing a message to its arrival. A flood has it only for stamped messages."""
    since_due_us: Ages | None
    """Time from a message's place in the schedule to its arrival; None without a schedule."""
    last_us: Ages | None
    """Time from publishing a message to its arrival at the last subscriber; None with one subscriber."""

    @property
    def is_complete(self) -> bool:
        """Whether no message was lost."""
        return self.delivered == self.expected

    @classmethod
    def of(
        cls, size: int, rate: float, route: str, sent: Sequence[Sent], settled: Sequence[Settled]
    ) -> "Run":
        """Make the result from the reports of publishers and subscribers."""
        published = sum(one.count for one in sent)
        expected = published * len(settled)
        delivered = sum(one.delivered for one in settled)
        dropped: dict[str, int] = {}
        for one in settled:
            for reason, count in one.dropped.items():
                dropped[reason] = dropped.get(reason, 0) + count
        begin_ns = min(one.begin_ns for one in sent)
        publishing_s = (max(one.end_ns for one in sent) - begin_ns) / 1e9
        seconds = max((max(one.last_ns for one in settled) - begin_ns) / 1e9, publishing_s)
        due = (age + late for one in settled for age, late in zip(one.age_ns, one.late_ns, strict=True))
        return cls(
            size=size,
            rate=rate or None,
            route=route,
            seconds=seconds,
            published=published,
            expected=expected,
            delivered=delivered,
            dropped=dropped,
            unaccounted=max(0, expected - delivered - sum(dropped.values())),
            published_per_s=published / publishing_s,
            delivered_per_s=delivered / seconds,
            bytes_per_s=delivered * size / seconds,
            since_sent_us=ages(age for one in settled for age in one.age_ns),
            since_due_us=ages(due) if rate else None,
            last_us=ages(_last_ages(settled)) if len(settled) > 1 else None,
        )


def _last_ages(settled: Sequence[Settled]) -> Iterable[int]:
    """Ages of stamped messages at the last subscriber, for messages that all subscribers received."""
    found: dict[tuple[int, int], list[int]] = {}
    for one in settled:
        for sent_ns, late_ns, age_ns in zip(one.sent_ns, one.late_ns, one.age_ns, strict=True):
            found.setdefault((sent_ns, late_ns), []).append(age_ns)
    return (max(some) for some in found.values() if len(some) == len(settled))


def tables(runs: Sequence[Run]) -> str:
    """A table of rates and losses, and a table of ages."""
    kinds = [(*_kind(run), run) for run in runs]
    rates = table(
        ("size", "pace", "route", "published/s", "delivered/s", "bytes/s", "lost"),
        [
            (
                *(size, pace, run.route, _rate_text(run.published_per_s), _rate_text(run.delivered_per_s)),
                *(size_text(run.bytes_per_s), _lost_text(run)),
            )
            for size, pace, run in kinds
        ],
    )
    rows = []
    for size, pace, run in kinds:
        for since, found in _ages_of(run):
            values = (found.p50, found.p90, found.p99, found.p99_9, found.max)
            rows.append((size, pace, since, *map(_us_text, values)))
    return f"{rates}\n{table(('size', 'pace', 'µs since', *_COLUMNS), rows)}"


def plots(runs: Sequence[Run], cells: int) -> list[str]:
    """Lines with a histogram of each row of ages. The longest bar has `cells` characters."""
    found = []
    for run in runs:
        for since, ages_us in _ages_of(run):
            counts = [0] * PARTS
            for begin_us, _, count in ages_us.histogram:
                counts[part_of(round(begin_us * 1000))] = count
            found += ["", f"{', '.join(_kind(run))}, since {since}:", *lines(counts, cells)]
    return found


def _kind(run: Run) -> tuple[str, str]:
    """The size and the pace in words."""
    return bytes_text(run.size), f"{run.rate:,g}/s" if run.rate else "flood"


def _ages_of(run: Run) -> list[tuple[str, Ages]]:
    """The beginning of the ages in words, and the ages."""
    known = (("sent", run.since_sent_us), ("due", run.since_due_us), ("sent, to the last", run.last_us))
    return [(since, found) for since, found in known if found is not None]


def _lost_text(run: Run) -> str:
    if run.is_complete:
        return "0"
    lost = run.dropped | ({"unaccounted": run.unaccounted} if run.unaccounted else {})
    reasons = ", ".join(f"{reason}: {count:,}" for reason, count in sorted(lost.items()))
    return f"{run.expected - run.delivered:,} of {run.expected:,}" + (f" ({reasons})" if reasons else "")


def _rate_text(value: float) -> str:
    return f"{value:.3g}" if value < 10 else f"{value:,.0f}"


def _us_text(value: float) -> str:
    return f"{value:.1f}" if value < 1000 else f"{value:,.0f}"


def bytes_text(size: int) -> str:
    """A size as text: `64 B`, `1 KiB`, `2 MiB`. A unit is only used if the size is a multiple of it."""
    for unit, factor in (("MiB", 1 << 20), ("KiB", 1 << 10)):
        if size >= factor and not size % factor:
            return f"{size // factor} {unit}"
    return f"{size} B"
