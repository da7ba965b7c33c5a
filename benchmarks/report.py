"""Results as a table for people and as JSON for programs. Knows nothing of how they were measured."""

import math
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from benchmarks.cases import Outcome
from benchmarks.figures import Spread
from benchmarks.machine import Machine

FORMAT = 1
"""Version of the JSON; a change that readers must know of counts it up."""


class Column(msgspec.Struct, frozen=True):
    """A figure that a table shows: its key, and the heading with the unit."""

    key: str
    heading: str


class Row(msgspec.Struct, frozen=True, omit_defaults=True):
    """One case. `trouble` says why it failed, or that it is missing; figures may stand beside it."""

    name: str
    figures: dict[str, Spread] = {}
    trouble: str = ""

    @classmethod
    def of(cls, outcome: Outcome) -> "Row":
        trouble = f"failed: {outcome.failure}" if outcome.failure else ""
        trouble = f"missing: {outcome.missing}" if outcome.missing else trouble
        return cls(name=outcome.name, figures=outcome.spreads(), trouble=trouble)


class Comparison(msgspec.Struct, frozen=True, omit_defaults=True):
    """A figure that was asked for: of each repetition, and within which bound it should lie."""

    name: str
    value: Spread
    at_most: float | None = None
    at_least: float | None = None

    @property
    def is_met(self) -> bool:
        """Whether the median is within the bound."""
        return (self.at_most is None or self.value.median <= self.at_most) and (
            self.at_least is None or self.value.median >= self.at_least
        )

    @property
    def has_goal(self) -> bool:
        return self.at_most is not None or self.at_least is not None


class Section(msgspec.Struct, frozen=True):
    """What one benchmark found."""

    name: str
    title: str
    columns: list[Column]
    rows: list[Row]
    comparisons: list[Comparison] = []
    notes: list[str] = []

    @property
    def has_failures(self) -> bool:
        return any(row.trouble.startswith("failed") for row in self.rows)


class Result(msgspec.Struct, frozen=True):
    """One run of some benchmarks."""

    format: int
    began: str
    is_quick: bool
    repetitions: int
    machine: Machine
    sections: list[Section]


def compare(
    name: str, values: Sequence[float], *, at_most: float | None = None, at_least: float | None = None
) -> list[Comparison]:
    """A comparison, where there is something to compare."""
    if not values:
        return []
    return [Comparison(name=name, value=Spread.of(values), at_most=at_most, at_least=at_least)]


def number(value: float) -> str:
    """Three digits that count, and k, M or G for what is long: 94.1, 1273, 755k, 1.02M."""
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
    """`median (min - max)`, or the one number where they are the same."""
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
    headings = ["median (min - max)", *(column.heading for column in section.columns)]
    rows = []
    for row in section.rows:
        found = [row.figures.get(column.key) for column in section.columns]
        rows.append([row.name, *("-" if one is None else spread(one) for one in found)])
    lines = [section.title, "=" * len(section.title), table(headings, rows)]
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
    """Sorts by time; what a quick run gave is told by its name."""
    stamp = result.began.replace(":", "").replace("-", "")
    commit = result.machine.commit.rstrip("+") or "unknown"
    return f"{stamp}-{commit}{'-quick' if result.is_quick else ''}.json"


def save(result: Result, path: Path) -> None:
    """Write `result` as JSON. Raises OSError."""
    data = msgspec.json.format(msgspec.json.encode(result), indent=1)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data + b"\n")


def load(path: Path) -> Result:
    """A result that was saved. Raises OSError, msgspec.DecodeError."""
    return msgspec.json.decode(path.read_bytes(), type=Result)


def _describe(one: Comparison) -> str:
    text = f"{one.name}: {spread(one.value)}"
    if not one.has_goal:
        return text
    bounds = [f"at most {number(one.at_most)}"] if one.at_most is not None else []
    bounds += [f"at least {number(one.at_least)}"] if one.at_least is not None else []
    return f"{text}   goal: {' and '.join(bounds)}, {'met' if one.is_met else 'NOT met'}"
