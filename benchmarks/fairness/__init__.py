"""Whether a process slows down others: a paced pair beside hostile programs, and many that start at once.

For the pair by socket, the reference is a process that only uses a CPU: no bus can protect the pair from
that. With shared memory, busd does not take part in the exchange, so the reference is the pair alone.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import msgspec

from benchmarks import discovery
from benchmarks.adapters.arriving import Programs
from benchmarks.cases import Case, Figures, Outcome, interleave
from benchmarks.fairness import beside, crowds
from benchmarks.fairness.neighbours import BUSY, ESSENTIAL, NEIGHBOURS, QUIET
from benchmarks.figures import Spread, ratios
from benchmarks.plan import Plan
from benchmarks.report import Column, Comparison, Row, Section, compare
from benchmarks.systems import BUS, BUS_SOCKET, System, with_busd

NAME = "fairness"
_GOAL = 3.0
_FEW, _MANY = 100, 190
_LINEAR = 4.0
_ARRIVING = Programs(100, 0.04)
_SLOWEST_S = 5.0
_STORM = "connections with garbage"
_TOPICS = 1000
_WAYS = {"socket": "socket", "shm": "shared memory"}
_SLOWER = 1.1
_COLUMNS = [
    Column("socket_p50", "ms by socket: p50", "lower"),
    Column("socket_p99", "p99", "lower"),
    Column("socket_max", "max", "lower"),
    Column("socket_quiet", "its p99: / quiet", "lower"),
    Column("socket_busy", "/ busy loop", "lower"),
    Column("silence", "ms: busd silent", "lower"),
    Column("shm_p50", "ms by shared memory: p50", "lower"),
    Column("shm_p99", "p99", "lower"),
    Column("shm_max", "max", "lower"),
    Column("shm_quiet", "its p99: / quiet", "lower"),
    Column("shm_busy", "/ busy loop", "lower"),
    Column("busd_cpu", "% of a CPU: busd"),
    Column("neighbour_cpu", "neighbours"),
    Column("asked_per_s", "asked/s"),
    Column("refused_per_s", "refused/s"),
    Column("back_s", "s: matches are back", "lower"),
    Column("matched_s", "all matched", "lower"),
    Column("declared_s", "all declared", "lower"),
    Column("busd_cpu_s", "CPU s: busd", "lower"),
    Column("got_in", "programs that got in", "higher"),
    Column("arrived_p50", "s until one is in: p50", "lower"),
    Column("arrived_max", "the slowest", "lower"),
]
_NOTES = [
    f"String of 64 B at {beside.RATE:,.0f}/s from one process to another, first by socket, then by shared "
    "memory; the neighbour is one more process on the same bus, which does one thing as fast as busd lets it",
    "asked: samples, frames, endpoints, connections, whatever its kind asks; ms of a busy loop; 100 kB by a "
    "socket. Refused: also connections that busd cut",
    "busd silent: the longest that busd took to answer the ping of a third process",
    "no goal, as they ask nothing of busd: a process that uses a CPU, or two; and two that wake each other "
    "up",
    f"matches are back: one program with {_FEW} or {_MANY} publishers and as many subscriptions of one "
    "topic, from when another busd listens after one was killed, until both ends know of all matches",
    f"in: connected, with a node and a publisher; {_ARRIVING.number} programs start in "
    f"{_ARRIVING.number * _ARRIVING.pause_s:g} s, forked from one that has imported all",
]


class Version(NamedTuple):
    """A busd to measure; `program`: from another checkout. `label` is part of the names of its rows."""

    label: str = ""
    program: str = ""

    def name(self, what: str) -> str:
        return f"{what}, {self.label}" if self.label else what


class _Line(NamedTuple):
    """A row for each version. `measure` runs it once with the busd of a program; `missing` as in a Case."""

    name: str
    measure: Callable[[str], Figures]
    missing: str = ""


def run(plan: Plan) -> Section:
    """Measure the pairs once beside the essential neighbours, and many programs that start at once.

    `python -m benchmarks.fairness` has the time to measure all neighbours.
    """
    once = plan._replace(repetitions=plan.rounds(is_essential=False))
    return measure(
        once, [Version()], lambda name: name in ESSENTIAL or not (plan.quick or name in NEIGHBOURS)
    )


def measure(plan: Plan, versions: Sequence[Version], is_wanted: Callable[[str], bool]) -> Section:
    """Measure the wanted cases, with each version in turn. For a neighbour, also measure its references."""
    said: set[str] = set()
    every = _lines(plan, len(versions) > 1, said)
    wanted = {line.name for line in every if is_wanted(line.name)}
    if wanted & NEIGHBOURS.keys():
        wanted |= {QUIET, BUSY}
    lines = [line for line in every if line.name in wanted]
    cases = [
        Case(version.name(line.name), partial(line.measure, version.program), line.missing)
        for line in lines
        for version in versions
    ]
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    names = [line.name for line in lines]
    comparisons: list[Comparison] = []
    for version in versions:
        comparisons += _beside(names, outcomes, version)
        comparisons += _crowds(outcomes, version)
    for other in versions[1:]:
        comparisons += _versions(outcomes, versions[0], other)
    rows = [_row(name, outcomes, version) for name in names for version in versions]
    notes = [*_NOTES, *(f"who did not get in: {text}" for text in sorted(said))]
    title = "Fairness: a pair beside a program that asks too much, and many that come at once"
    return Section(NAME, title, _COLUMNS, rows, comparisons, notes)


def _lines(plan: Plan, compares: bool, said: set[str]) -> list[_Line]:
    """All rows; the row of `discovery` only if it `compares` versions."""
    seconds = 0.5 if plan.quick else 2.5
    found = [
        _Line(name, partial(beside.measure, neighbour, seconds), beside.why_not(neighbour))
        for name, neighbour in NEIGHBOURS.items()
    ]
    found += [_Line(_back(each), partial(crowds.come_back, each)) for each in (_FEW, _MANY)]
    (storm,) = NEIGHBOURS[_STORM].attacks
    found += [
        _Line(_arrival(place), partial(crowds.arrive, _ARRIVING, attack, said))
        for place, attack in ((QUIET, None), (_STORM, storm))
    ]
    if compares:
        found += [
            _Line(_discovery(system), partial(_discover, system), system.missing())
            for system in (BUS, BUS_SOCKET)
        ]
    return found


def _back(each: int) -> str:
    return f"{each**2:,} matches come back"


def _arrival(place: str) -> str:
    return f"{_ARRIVING.number} programs start: {place}"


def _discovery(system: System) -> str:
    return f"{_TOPICS:,} topics with {2 * _TOPICS:,} endpoints: {system.name}"


def _discover(system: System, program: str) -> Figures:
    return discovery.measure(with_busd(system, program), _TOPICS)


def _row(name: str, outcomes: Mapping[str, Outcome], version: Version) -> Row:
    """The row with two more figures: ratios to the quiet case, and to the case with the busy loop."""
    row = Row.of(outcomes[version.name(name)])
    if name not in NEIGHBOURS:
        return row
    found = {}
    for way in _WAYS:
        for key, reference in (("quiet", QUIET), ("busy", BUSY)):
            if values := _ratios(name, reference, outcomes, version, f"{way}_p99"):
                found[f"{way}_{key}"] = Spread.of(values)
    return msgspec.structs.replace(row, figures=row.figures | found)


def _ratios(
    name: str, reference: str, outcomes: Mapping[str, Outcome], version: Version, key: str
) -> list[float]:
    ours, theirs = (outcomes[version.name(one)].repetitions for one in (name, reference))
    return ratios(ours, theirs, key)


def _beside(names: Sequence[str], outcomes: Mapping[str, Outcome], version: Version) -> list[Comparison]:
    """The ratio to the busy loop for the pair by socket, and to the pair alone for shared memory."""
    found = []
    for name in names:
        if name in NEIGHBOURS and not NEIGHBOURS[name].is_floor:
            for way, reference in (("socket", BUSY), ("shm", QUIET)):
                values = _ratios(name, reference, outcomes, version, f"{way}_p99")
                text = f"{version.name(name)}: p99 by {_WAYS[way]} / {reference}"
                found += compare(text, values, at_most=_GOAL)
    return found


def _crowds(outcomes: Mapping[str, Outcome], version: Version) -> list[Comparison]:
    def figures(name: str) -> list[Figures]:
        outcome = outcomes.get(version.name(name))
        return outcome.repetitions if outcome is not None else []

    few, many = figures(_back(_FEW)), figures(_back(_MANY))
    arrived, place = figures(_arrival(_STORM)), version.name(_arrival(_STORM))
    slowest_s = [one["arrived_max"] for one in arrived if "arrived_max" in one]
    return [
        *compare(f"{version.name(_back(_MANY))} / {_FEW**2:,}", ratios(many, few, "back_s"), at_most=_LINEAR),
        *compare(f"{place}: in", [one["got_in"] for one in arrived], at_least=_ARRIVING.number),
        *compare(f"{place}: s of the slowest", slowest_s, at_most=_SLOWEST_S),
    ]


def _versions(outcomes: Mapping[str, Outcome], one: Version, other: Version) -> list[Comparison]:
    found = []
    for system in (BUS, BUS_SOCKET):
        name = _discovery(system)
        if one.name(name) in outcomes:
            ours, theirs = (outcomes[version.name(name)].repetitions for version in (one, other))
            text = f"{one.name(name)} / {other.label}, all matched"
            found += compare(text, ratios(ours, theirs, "matched_s"), at_most=_SLOWER)
    return found
