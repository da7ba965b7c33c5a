"""A soak's record as text. Pure."""

from collections.abc import Sequence

from benchmarks.report import number, table
from benchmarks.soaking.record import Judged, Record
from bus_cli.bench.figures import bytes_text
from bus_plot.bars import peaks_text

_CELLS = 24
_MOST_FAILURES = 30


def latency_table(record: Record) -> str:
    """Percentiles of the whole run, and the course of two of them over time, from the least to the largest
    value."""
    rows = []
    for group in sorted(record.ages, key=order):
        found = record.ages[group].percentiles()
        if found is None:
            continue
        over_time = [one.latency[group] for one in record.intervals if group in one.latency]
        figures = (found.p50, found.p99, found.p99_9, found.max)
        courses = ([one.p50 for one in over_time], [one.p99 for one in over_time])
        bars = [peaks_text(one, _CELLS) for one in courses]
        rows.append([label(group), *map(number, figures), f"{found.samples:,}", *bars])
    headings = ["µs", "p50", "p99", "p99.9", "max", "messages", "p50 over time", "p99 over time"]
    return table(headings, rows)


def usage_table(judged: Sequence[Judged]) -> str:
    """A row for each process: the final value of each quantity, and its slope per hour with its
    uncertainty."""
    quantities = list(dict.fromkeys(one.quantity for one in judged))
    headings = ["process"]
    for quantity in quantities:
        headings += [quantity.name, "/h"]
    rows = []
    for process in dict.fromkeys(one.process for one in judged):
        mine = [one for one in judged if one.process == process]
        cells = [cell for one in mine for cell in (f"{one.end:.{one.quantity.digits}f}", slope_text(one))]
        rows.append([process, *cells, _verdict(mine)])
    return table([*headings, "verdict"], rows)


def account_table(record: Record) -> str:
    """A row for each subscription."""
    rows = [
        [
            name,
            f"{record.published.get(one.topic, 0):,}",
            f"{one.delivered:,}",
            f"{one.lost:,}",
            ", ".join(f"{reason}: {count:,}" for reason, count in sorted(one.dropped.items())),
        ]
        for name, one in record.totals.items()
    ]
    return table(["subscription", "published", "delivered", "dropped", "by reason"], rows)


def failures_text(failures: Sequence[str]) -> str:
    """A line for each failure, but limited in number."""
    lines = [f"FAILED: {one}" for one in failures[:_MOST_FAILURES]]
    if len(failures) > _MOST_FAILURES:
        lines.append(f"... and {len(failures) - _MOST_FAILURES} more")
    return "\n".join(lines)


def slope_text(one: Judged) -> str:
    """`+0.12 ± 0.30`: the uncertainty is one standard error. Empty if it was not judged."""
    if one.verdict == "too short":
        return "-"
    slope, error = (0.0 if abs(value) < 5e-4 else value for value in one.line[:2])
    return "0" if not slope and not error else f"{slope:+.2f} ± {error:.2f}"


def label(group: str) -> str:
    """The name of a group for people, such as of `shm 100`."""
    route, size = group.split()
    return f"{route} {bytes_text(int(size))}"


def _verdict(judged: Sequence[Judged]) -> str:
    growing = [one.quantity.name for one in judged if one.verdict == "grows"]
    if growing:
        return f"GROWS: {', '.join(growing)}"
    return "flat" if any(one.verdict == "flat" for one in judged) else "too short"


def order(group: str) -> tuple[str, int]:
    """A sort key for groups: by route, and then by size."""
    route, size = group.split()
    return route, int(size)
