"""`python -m benchmarks.compare A.json B.json`: the differences of two results that are larger than noise.

Only knows results. `judge` has the rule for noise.
"""

import argparse
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple, get_args

from benchmarks.figures import Spread
from benchmarks.machine import Machine
from benchmarks.report import Result, Section, Unreadable, load, number, spread, table

THRESHOLD = 0.05
"""The smallest relative change that is shown for figures with a spread."""
SINGLE_FACTOR = 5
"""The factor on the threshold for figures that were measured only once, and so have no spread."""

Verdict = Literal["better", "worse", "changed", "same"]
_RULE = f"""
What counts as a change: figures are medians with the smallest and the largest repetition. Both intervals
are widened at either end by half their width, because the extremes of a few repetitions lie closer together
than those of many. Where they still overlap, or where the medians differ by less than the threshold, the
figures are the same within noise. A figure without a spread, of one repetition, must differ by
{SINGLE_FACTOR} times the threshold. Between two machines other things have changed as well: see the lines
at the top.
"""


class Change(NamedTuple):
    """One figure in both results. `ratio` is the ratio of the medians, after / before; inf if before is 0."""

    section: str
    row: str
    figure: str
    before: Spread
    after: Spread
    ratio: float
    verdict: Verdict

    @property
    def size(self) -> float:
        """The size of the change in either direction."""
        return abs(math.log(self.ratio)) if 0 < self.ratio < math.inf else math.inf


class Difference(NamedTuple):
    """All differences of two results. `only`: rows in one of them; `goals`: changes between met and not
    met."""

    warnings: list[str]
    changes: list[Change]
    only: list[str]
    failed: list[str]
    goals: list[str]


def differ(before: Result, after: Result, threshold: float = THRESHOLD) -> Difference:
    """Compare the figures with the same section, row and column."""
    changes: list[Change] = []
    goals: list[str] = []
    for section in after.sections:
        old = before.section(section.name)
        if old is not None:
            changes += _changes(old, section, threshold)
            goals += _goals(old, section)
    names = [_rows(before), _rows(after)]
    only = [f"only in A: {name}" for name in names[0] if name not in names[1]]
    only += [f"only in B: {name}" for name in names[1] if name not in names[0]]
    failed = [f"{side}: {line}" for side, one in (("A", before), ("B", after)) for line in _troubles(one)]
    return Difference(list(_warnings(before, after)), changes, only, failed, goals)


def judge(before: Spread, after: Spread, better: str, threshold: float = THRESHOLD) -> tuple[float, Verdict]:
    """The ratio of the medians, and whether it is significant; see --help."""
    if before.median == after.median:
        return 1.0, "same"
    ratio = after.median / before.median if before.median else math.inf
    has_spread = before.min < before.max and after.min < after.max
    least = threshold if has_spread else threshold * SINGLE_FACTOR
    change = abs(math.log(ratio)) if 0 < ratio < math.inf else math.inf
    if change < math.log1p(least) or _overlap(before, after):
        return ratio, "same"
    if not better:
        return ratio, "changed"
    return ratio, "better" if (ratio > 1) == (better == "higher") else "worse"


def render(found: Difference, *, show_all: bool = False) -> str:
    """A text for people: warnings first, then the changes of each section, the largest first."""
    lines = [f"! {text}" for text in found.warnings]
    lines = [*(lines or ["the same machine and versions, and as thorough"]), ""]
    shown = [one for one in found.changes if show_all or one.verdict != "same"]
    for section in dict.fromkeys(one.section for one in shown):
        part = sorted((one for one in shown if one.section == section), key=lambda one: -one.size)
        cells = [
            [
                f"{one.row}; {one.figure}",
                spread(one.before),
                spread(one.after),
                _times(one.ratio),
                one.verdict,
            ]
            for one in part
        ]
        lines += [table([section, "A", "B", "B / A", ""], cells), ""]
    counts = {verdict: sum(one.verdict == verdict for one in found.changes) for verdict in get_args(Verdict)}
    for title, texts in (("goals", found.goals), ("rows", found.only), ("troubles", found.failed)):
        lines += [f"{title}:", *(f"  {text}" for text in texts), ""] if texts else []
    lines.append(
        f"{len(found.changes)} figures: {counts['better']} better, {counts['worse']} worse, "
        f"{counts['changed']} changed, {counts['same']} the same within noise"
    )
    return "\n".join(lines) + "\n"


def main() -> int:
    """Print the changes; returns 0, or 2 if a file can't be read. A change is not a failure."""
    options = _parser().parse_args()
    try:
        results = load(options.before), load(options.after)
    except Unreadable as error:
        print(error, file=sys.stderr)
        return 2
    for side, result in zip("AB", results, strict=True):
        print(f"{side}: {result.began}, commit {result.machine.commit or 'unknown'}")
    print(render(differ(*results, threshold=options.threshold / 100), show_all=options.all), end="")
    return 0


def _changes(before: Section, after: Section, threshold: float) -> Iterator[Change]:
    rows = {row.name: row for row in before.rows}
    headings = after.headings()
    for row in after.rows:
        old = rows[row.name].figures if row.name in rows else {}
        for column in after.columns:
            if column.key in old and column.key in row.figures:
                pair = old[column.key], row.figures[column.key]
                ratio, verdict = judge(*pair, column.better, threshold)
                yield Change(after.name, row.name, headings[column.key], *pair, ratio, verdict)


def _goals(before: Section, after: Section) -> Iterator[str]:
    was = {one.name: one for one in before.comparisons if one.has_goal}
    for one in after.comparisons:
        old = was.get(one.name)
        if old is not None and one.has_goal and old.is_met != one.is_met:
            word = "met now" if one.is_met else "NOT met any more"
            yield f"{after.name}: {one.name}: {spread(old.value)}, then {spread(one.value)}: {word}"


def _warnings(before: Result, after: Result) -> Iterator[str]:
    kinds = ["quick" if one.is_quick else "full" for one in (before, after)]
    if kinds[0] != kinds[1]:
        yield f"A is a {kinds[0]} run, B a {kinds[1]} one"
    if before.repetitions != after.repetitions:
        yield f"repetitions: {before.repetitions} in A, {after.repetitions} in B"
    facts = [_facts(one.machine) for one in (before, after)]
    for name in facts[0] | facts[1]:
        values = [side.get(name, "missing") for side in facts]
        if values[0] != values[1]:
            yield f"{name}: {values[0] or 'unknown'} in A, {values[1] or 'unknown'} in B"


def _facts(machine: Machine) -> dict[str, str]:
    return {
        "processor": machine.processor,
        "CPUs": str(machine.cpus),
        "GiB of memory": f"{machine.memory_gib:g}",
        "virtual": "yes" if machine.is_virtual else "no",
        "kernel": machine.kernel,
        "governor": machine.governor,
        "clock": machine.clock,
        "Python": machine.python,
        **machine.packages,
        **machine.servers,
    }


def _rows(result: Result) -> dict[str, None]:
    return {f"{section.name}: {row.name}": None for section in result.sections for row in section.rows}


def _troubles(result: Result) -> Iterator[str]:
    for section in result.sections:
        yield from (f"{section.name}: {row.name}: {row.trouble}" for row in section.rows if row.trouble)


def _overlap(one: Spread, other: Spread) -> bool:
    low, high = sorted((one, other), key=lambda value: value.median)
    return high.min - (high.max - high.min) / 2 <= low.max + (low.max - low.min) / 2


def _times(ratio: float) -> str:
    return "-" if ratio == math.inf else f"{number(ratio)}x"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.compare",
        description="Show what changed from result A to result B, noise left out.",
        epilog=_RULE,
    )
    parser.add_argument("before", type=Path, metavar="A.json")
    parser.add_argument("after", type=Path, metavar="B.json")
    parser.add_argument("--all", action="store_true", help="also what is the same within noise")
    parser.add_argument(
        "--threshold",
        type=float,
        default=THRESHOLD * 100,
        metavar="PERCENT",
        help="the smallest change of a median that is shown (default: %(default)g)",
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
