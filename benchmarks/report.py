"""Results as a table for people and as JSON for programs. Knows nothing of the measurements."""

import math
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import msgspec

from benchmarks.cases import Outcome
from benchmarks.figures import Spread
from benchmarks.machine import Machine

FORMAT = 2
"""Version of the JSON. Increase it for each incompatible change."""
WIDTH = 120
"""Width of a table on a terminal. A wider table is shown in parts."""


class Column(msgspec.Struct, frozen=True):
    """A figure in a table: its key, the heading with the unit, and which direction is `better`."""

    key: str
    heading: str
    better: Literal["", "lower", "higher"] = ""


class Row(msgspec.Struct, frozen=True, omit_defaults=True):
    """One case. `trouble` is the reason why it failed or is missing; it may still have figures.

    `series` and `at` as in `cases.Case`.
    """

    name: str
    figures: dict[str, Spread] = {}
    trouble: str = ""
    series: str = ""
    at: float = 0.0

    @property
    def has_failed(self) -> bool:
        return self.trouble.startswith("failed")

    @classmethod
    def of(cls, outcome: Outcome) -> "Row":
        trouble = f"failed: {outcome.failure}" if outcome.failure else ""
        trouble = f"missing: {outcome.missing}" if outcome.missing else trouble
        figures = outcome.spreads()
        return cls(name=outcome.name, figures=figures, trouble=trouble, series=outcome.series, at=outcome.at)


class Comparison(msgspec.Struct, frozen=True, omit_defaults=True):
    """A ratio with its values from each repetition, and its bounds.

    `headline`: its name among the goals at the beginning of a report (`benchmarks.goals`); empty for others.
    """

    name: str
    value: Spread
    at_most: float | None = None
    at_least: float | None = None
    headline: str = ""

    @property
    def is_met(self) -> bool:
        """Whether the median is within the bounds."""
        return (self.at_most is None or self.value.median <= self.at_most) and (
            self.at_least is None or self.value.median >= self.at_least
        )

    @property
    def has_goal(self) -> bool:
        return self.at_most is not None or self.at_least is not None


class Section(msgspec.Struct, frozen=True):
    """The results of one benchmark. `axis` is the meaning of `Row.at`, with its unit: "size in B".

    `took_s`: the duration of the measurement, in s. `load`: the load average at its start.
    """

    name: str
    title: str
    columns: list[Column]
    rows: list[Row]
    comparisons: list[Comparison] = []
    notes: list[str] = []
    axis: str = ""
    took_s: int = 0
    load: float = 0.0

    @property
    def has_failures(self) -> bool:
        return any(row.has_failed for row in self.rows)

    def lines(self, key: str) -> dict[str, dict[float, Spread]]:
        """The figure `key` of each series, by `Row.at`, for a picture. Rows without a series are left out."""
        found: dict[str, dict[float, Spread]] = {}
        for row in self.rows:
            if row.series and key in row.figures:
                found.setdefault(row.series, {})[row.at] = row.figures[key]
        return {series: dict(sorted(points.items())) for series, points in found.items()}

    def headings(self) -> dict[str, str]:
        """Each column's heading by its key, with the unit that it shares with the columns before it.

        In a table "CPU s: publisher" is followed by "broker", which is "CPU s: broker" here.
        """
        found: dict[str, str] = {}
        group = ""
        for column in self.columns:
            begin, colon, _ = column.heading.partition(": ")
            group = begin + colon if colon else "" if _names_unit(column.heading) else group
            found[column.key] = column.heading if colon else group + column.heading
        return found


class _Head(msgspec.Struct):
    format: int


class Result(msgspec.Struct, frozen=True):
    """One run of some benchmarks."""

    format: int
    began: str
    is_quick: bool
    repetitions: int
    machine: Machine
    sections: list[Section]

    def section(self, name: str) -> Section | None:
        """The section of the benchmark `name`, if it was run."""
        return next((one for one in self.sections if one.name == name), None)


def compare(
    name: str, values: Sequence[float], *, at_most: float | None = None, at_least: float | None = None
) -> list[Comparison]:
    """A comparison, if there are values to compare."""
    if not values:
        return []
    return [Comparison(name=name, value=Spread.of(values), at_most=at_most, at_least=at_least)]


def number(value: float) -> str:
    """A number with three significant digits, and k, M or G for large ones: 94.1, 1273, 755k, 1.02M."""
    if value == 0:
        return "0"
    value = float(f"{value:.3g}") if abs(value) >= 1e4 else value
    size = abs(value)
    for limit, suffix in ((1e9, "G"), (1e6, "M"), (1e4, "k")):
        if size >= limit:
            scale = 1e3 if suffix == "k" else limit
            return number(value / scale) + suffix
    digits = max(0, 2 - math.floor(math.log10(size)))
    return f"{value:.{min(digits, 9)}f}"


def spread(value: Spread) -> str:
    """`median (min - max)`, or one number if they are the same."""
    middle, low, high = number(value.median), number(value.min), number(value.max)
    return middle if low == high else f"{middle} ({low} - {high})"


def table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Aligned columns under a line: the first to the left, the others to the right."""
    lines = [list(headings), *([str(cell) for cell in row] for row in rows)]
    width = len(headings)
    padded = [line + [""] * (width - len(line)) for line in lines]
    widths = [max(len(line[index]) for line in padded) for index in range(width)]
    out = []
    for line in padded:
        cells = [line[0].ljust(widths[0])]
        cells += [cell.rjust(space) for cell, space in zip(line[1:], widths[1:], strict=True)]
        out.append("  ".join(cells).rstrip())
    out.insert(1, "  ".join("-" * space for space in widths))
    return "\n".join(out)


def render(section: Section) -> str:
    """A section as text: table, troubles, comparisons with their goals, notes."""
    lines = [section.title, "=" * len(section.title), "\n\n".join(_tables(section))]
    lines += [f"{row.name}: {row.trouble}" for row in section.rows if row.trouble]
    if section.comparisons:
        lines.append("")
    lines += [_describe(one) for one in section.comparisons]
    lines += [f"* {note}" for note in section.notes]
    return "\n".join(lines) + "\n"


def began_now() -> str:
    """The time for `Result.began`, in UTC."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def file_name(result: Result) -> str:
    """A file name that sorts by time; the name shows a quick run."""
    stamp = result.began.replace(":", "").replace("-", "")
    commit = result.machine.commit.rstrip("+") or "unknown"
    return f"{stamp}-{commit}{'-quick' if result.is_quick else ''}.json"


def save(result: Result, path: Path) -> None:
    """Write `result` as JSON. If that fails, an older file at `path` stays. Raises OSError."""
    data = msgspec.json.format(msgspec.json.encode(result), indent=1)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.part")
    part.write_bytes(data + b"\n")
    part.replace(path)


class Unreadable(Exception):
    """The reason why a file is not a usable result, as a text for people."""


def load(path: Path) -> Result:
    """Read a saved result. Raises Unreadable."""
    try:
        data = path.read_bytes()
        version = msgspec.json.decode(data, type=_Head).format
        if version != FORMAT:
            raise Unreadable(f"{path}: is of format {version}, and only {FORMAT} can be read")
        return msgspec.json.decode(data, type=Result)
    except OSError as error:
        raise Unreadable(f"{path}: {error.strerror}") from None
    except msgspec.DecodeError as error:
        raise Unreadable(f"{path}: is no result of a benchmark: {error}") from None


def goal(one: Comparison) -> str:
    """The bounds of a comparison as text: "at most 1.50"; empty without bounds."""
    bounds = [f"at most {number(one.at_most)}"] if one.at_most is not None else []
    bounds += [f"at least {number(one.at_least)}"] if one.at_least is not None else []
    return " and ".join(bounds)


def _tables(section: Section) -> list[str]:
    """The table, split into parts of at most WIDTH, each with the names of its rows.

    A part of a split table leaves out rows without figures in it.
    """
    names = [row.name for row in section.rows]
    first = ["median (min - max)", *names]
    in_full = section.headings()
    parts: list[list[list[str]]] = [[first]]
    for column in section.columns:
        figures = [row.figures.get(column.key) for row in section.rows]
        cells = [column.heading, *("-" if one is None else spread(one) for one in figures)]
        if len(parts[-1]) > 1 and _width([*parts[-1], cells]) > WIDTH:
            parts.append([first])
            cells[0] = in_full[column.key]
        parts[-1].append(cells)
    lines = [list(zip(*part, strict=True)) for part in parts]
    if len(parts) > 1:  # rows may be of several kinds with different columns
        lines = [[head, *(line for line in rest if set(line[1:]) != {"-"})] for head, *rest in lines]
        lines = [part for part in lines if len(part) > 1]
    return [table(head, rest) for head, *rest in lines]


def _names_unit(heading: str) -> bool:
    return any(unit in heading for unit in ("/s", " per ", "%"))


def _width(columns: Sequence[Sequence[str]]) -> int:
    return sum(max(map(len, cells)) + 2 for cells in columns) - 2


def _describe(one: Comparison) -> str:
    text = f"{one.name}: {spread(one.value)}"
    if not one.has_goal:
        return text
    return f"{text}   goal: {goal(one)}, {'met' if one.is_met else 'NOT met'}"
