"""One-way latency of paced messages, from the call that publishes to the message in the subscriber's hands.

Next to it, in turns, the floor: two bare hops over UNIX sockets with uvloop's protocols. Processes wait for
events and never poll; where they run is the scheduler's choice.
"""

import msgspec

from benchmarks.cases import Case, Figures, interleave
from benchmarks.figures import percentiles, ratios
from benchmarks.harness import START_S, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Row, Section, compare
from benchmarks.systems import BUS, TWO_HOPS, System
from benchmarks.work import Arrivals, Work

NAME = "latency"
GOAL = 2.0
_RATE = 1000.0

_COLUMNS = [
    Column("p50", "µs: p50"),
    Column("p90", "p90"),
    Column("p99", "p99"),
    Column("p99.9", "p99.9"),
    Column("max", "max"),
    Column("due_p99", "since due: p99"),
    Column("late_p50", "sender late: p50"),
]
_NOTES = [
    "one way, by CLOCK_MONOTONIC in the message; warm-up left out; percentiles are of each repetition; the "
    "scheduler chooses the CPUs",
    "the schedule is fixed: a message that could not be sent when it was due is sent late, and its delay "
    "counts in `since due`, which is the age from when it should have been sent",
]


def run(plan: Plan) -> Section:
    """Measure busd with a callback and with `async for`, and the floor."""
    work = Work(size=64, count=plan.choose(3_000, 15_000), warm_up=300, rate=_RATE, take_by="callback")
    iterating = msgspec.structs.replace(work, take_by="async for")
    cases = [
        Case("busd, callback", lambda: measure(BUS, work)),
        Case("two bare hops", lambda: measure(TWO_HOPS, work)),
        Case("busd, async for", lambda: measure(BUS, iterating)),
    ]
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"latency {text}"))
    floor = outcomes["two bare hops"].repetitions
    comparisons = []
    for name, goal in (("busd, callback", GOAL), ("busd, async for", None)):
        ours = outcomes[name].repetitions
        comparisons += compare(f"{name} / two bare hops, p50", ratios(ours, floor, "p50"), at_most=goal)
        comparisons += compare(f"{name} / two bare hops, p99", ratios(ours, floor, "p99"))
    rows = [Row.of(outcomes[case.name]) for case in cases]
    return Section(NAME, f"Latency: String of 64 B at {_RATE:,.0f}/s", _COLUMNS, rows, comparisons, _NOTES)


def measure(system: System, work: Work) -> Figures:
    """One paced stream. Raises Failure where it did not come to its end."""
    with Group() as group:
        system.start_servers(group)
        subscriber = system.start_role(group, "subscriber", work)
        publisher = system.start_role(group, "publisher", work)
        publisher.tell("go")
        limit_s = 2 * (work.warm_up + work.count) / work.rate + START_S
        event = group.expect(subscriber, "received", within_s=limit_s)
    return summary(msgspec.convert(event, Arrivals))


def summary(found: Arrivals) -> Figures:
    """Percentiles in µs."""
    due_ns = [late + age for late, age in zip(found.late_ns, found.age_ns, strict=True)]
    return (
        percentiles(found.age_ns, scale=1e-3)
        | percentiles(due_ns, prefix="due_", scale=1e-3)
        | percentiles(found.late_ns, prefix="late_", scale=1e-3)
    )
