"""The time until all endpoints of a large system are matched, and until a tool has listed the system.

Twenty running processes each declare a node and their share of the topics, all at the same time. This module
does not depend on the bus's method of discovery.
"""

import sys
from functools import partial
from statistics import median
from time import monotonic_ns

import msgspec

from benchmarks.adapters.discovering import Share
from benchmarks.cases import Case, Figures, interleave
from benchmarks.figures import ratios
from benchmarks.harness import START_S, Child, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Row, Section, compare
from benchmarks.systems import BUS, BUS_SOCKET, System

NAME = "discovery"
_PROCESSES = 20
_FEW, _SOME, _MANY = 250, 500, 1000
_LIMIT_S = 60.0
_LIST = (sys.executable, "-m", "bus_cli", "topic", "list")
_COLUMNS = [
    Column("matched_s", "s: all matched", "lower"),
    Column("declared_s", "all declared", "lower"),
    Column("us_per_endpoint", "µs per endpoint", "lower"),
    Column("cpu_s", "CPU s: processes", "lower"),
    Column("busd_cpu_s", "busd", "lower"),
    Column("list_ms", "ms: bus topic list", "lower"),
    Column("empty_ms", "on an empty bus", "lower"),
]
_NOTES = [
    f"{_PROCESSES} processes that have imported all run already; from the word to begin: connection, node, "
    "endpoints of the default QoS, until every publisher and every subscription is matched",
    "of each topic one publisher and one subscription, in different processes, and each process hears all "
    "others; in turn: as `await node.create_publisher(...)` one after the other does it",
]


def run(plan: Plan) -> Section:
    """Measure some sizes, and both ways to declare."""
    listings = plan.choose(3, 5)
    cases = []
    for system, at_once, topics in [
        *((BUS, False, topics) for topics in ((_FEW, _MANY) if plan.quick else (_FEW, _SOME, _MANY))),
        *(() if plan.quick else ((BUS, True, _MANY), (BUS_SOCKET, False, _MANY))),
    ]:
        series = f"{system.name}, {'at once' if at_once else 'in turn'}"
        measured = partial(measure, system, topics, at_once=at_once, listings=listings * (topics == _MANY))
        cases.append(Case(f"{topics} topics, {series}", measured, system.missing(), series, topics))
    outcomes = interleave(cases, plan.choose(1, 2), lambda text: plan.tell(f"{NAME} {text}"))
    series = cases[0].series
    few, many = (outcomes[f"{topics} topics, {series}"].repetitions for topics in (_FEW, _MANY))
    comparisons = [
        *compare(f"s until {_MANY} topics are matched", [one["matched_s"] for one in many], at_most=3.0),
        *compare(
            f"time per endpoint, {_MANY} topics / {_FEW}", ratios(many, few, "us_per_endpoint"), at_most=1.25
        ),
        *compare(
            f"bus topic list, {_MANY} topics / empty bus",
            ratios(many, many, "list_ms", "empty_ms"),
            at_most=2.0,
        ),
    ]
    rows = [Row.of(outcomes[case.name]) for case in cases]
    title = "Discovery: until a large system has found itself"
    return Section(NAME, title, _COLUMNS, rows, comparisons, _NOTES, "number of topics")


def measure(
    system: System, topics: int, *, processes: int = _PROCESSES, at_once: bool = False, listings: int = 0
) -> Figures:
    """Measure once, and list the topics `listings` times. Raises Failure if it does not end."""
    with Group() as group:
        (busd,) = system.start_servers(group)
        shares = [Share(index, processes, topics, at_once=at_once) for index in range(processes)]
        children = [_start(group, share) for share in shares]
        for child in children:
            group.expect(child, "ready", within_s=START_S)
        everybody = (*children, busd)
        before_ns = [child.cpu_ns() for child in everybody]
        begin_ns = monotonic_ns()
        for child in children:
            child.send("go")
        found = [group.expect(child, "matched", within_s=_LIMIT_S) for child in children]
        cpu_s = [(child.cpu_ns() - before) / 1e9 for child, before in zip(everybody, before_ns, strict=True)]
        listed = _list(group, listings)
    declared_s, matched_s = (
        (max(one[key] for one in found) - begin_ns) / 1e9 for key in ("declared_ns", "matched_ns")
    )
    return listed | {
        "matched_s": matched_s,
        "declared_s": declared_s,
        "us_per_endpoint": matched_s * 1e6 / (2 * topics),
        "cpu_s": sum(cpu_s[:-1]),
        "busd_cpu_s": cpu_s[-1],
    }


def _start(group: Group, share: Share) -> Child:
    work = msgspec.json.encode(share).decode()
    return group.start_python(f"process_{share.index}", "-m", "benchmarks.adapters.discovering", work)


def _list(group: Group, number: int) -> Figures:
    """Median times in ms of listings of the topics, in turn with listings of an empty bus.

    Each time is from the start of the process to its end.
    """
    if not number:
        return {}
    took_ms: dict[str, list[float]] = {"list_ms": [], "empty_ms": []}
    with Group() as empty:
        empty.start_busd()
        for _ in range(number + 1):
            for bus, times_ms in zip((group, empty), took_ms.values(), strict=True):
                begin_ns = monotonic_ns()
                bus.wait(bus.start("listing", *_LIST, ends=True), within_s=START_S)
                times_ms.append((monotonic_ns() - begin_ns) / 1e6)
    # The first listing of each bus had cold caches.
    return {key: median(times_ms[1:]) for key, times_ms in took_ms.items()}
