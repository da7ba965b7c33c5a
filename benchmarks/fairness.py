"""What a paced pair notices of a client that asks too much: latency beside a flood, over that without.

The flood's own work and busd's for it use CPU time that the pair has to share with them. What that costs by
itself those show that know nothing of the bus: busy loops, and two processes that talk by a socket.
"""

import sys
from functools import partial
from time import monotonic

import msgspec

from benchmarks import paced
from benchmarks.adapters.flooding import Flood, Kind
from benchmarks.cases import Case, Figures, interleave
from benchmarks.harness import START_S, Child, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Row, Section
from benchmarks.systems import BUS, BUS_SOCKET, System
from benchmarks.versus import against
from benchmarks.work import Arrivals, Work

NAME = "fairness"
GOAL = 3.0
_ADAPTER = "benchmarks.adapters.flooding"
_QUIET = "quiet"
_RATE, _WARM_UP = 1000.0, 100
FLOODS: dict[str, tuple[Kind, ...]] = {
    _QUIET: (),
    "a busy loop": ("busy loop",),
    "two busy loops": ("busy loop", "busy loop"),
    "two that talk by a socket": ("socket",),
    "a flood of samples": ("samples",),
    "a flood of declarations": ("declarations",),
    "a flood of queries": ("queries",),
    "a flood of connections": ("connections",),
    "a flood by shared memory": ("shared memory",),
}
"""Who floods beside the pair."""
FLOORS = frozenset[Kind](("busy loop", "socket"))
"""Those that know nothing of the bus."""
_ESSENTIAL = (
    _QUIET,
    "two that talk by a socket",
    "a flood of samples",
    "a flood of declarations",
    "a flood of queries",
    "a flood of connections",
)
"""Those of a quick run, and of the pair by socket, which is there for information."""
_COLUMNS = [
    Column("p50", "µs: p50", "lower"),
    Column("p99", "p99", "lower"),
    Column("p99.9", "p99.9", "lower"),
    Column("max", "max", "lower"),
    Column("busd_cpu", "% of a CPU: busd"),
    Column("flooder_cpu", "flooders"),
    Column("asked_per_s", "asked/s"),
    Column("refused_per_s", "refused/s"),
]
_NOTES = [
    f"String of 64 B at {_RATE:,.0f}/s from one process to another; the flooder is one more process on the "
    "same bus, which does one thing as fast as busd lets it",
    "samples: to a subscription of its own that keeps all and reads nothing; declarations: publishers "
    "created and destroyed; queries: the graph with statistics; connections: come, say Hello, go; by shared "
    "memory: to a subscription of its own process",
    "asked: samples, declarations, queries, connections; ms of a busy loop; 100 kB by a socket",
    "no goal, as they know nothing of the bus: a process that uses a CPU, or two; and two that wake each "
    "other up on one, as the flooder and busd do, so that neither uses up what the scheduler gives it",
]


def run(plan: Plan) -> Section:
    """Measure the pair beside each flood; quickly, only by shared memory."""
    systems = (BUS,) if plan.quick else (BUS, BUS_SOCKET)
    work = Work(size=64, count=plan.choose(500, 2000), warm_up=_WARM_UP, rate=_RATE, take_by=BUS.takes_by)
    cases = [
        _case(system, work, beside)
        for system in systems
        for beside in (_ESSENTIAL if plan.quick or system is not BUS else FLOODS)
    ]
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    comparisons = []
    for system in systems:
        goal = GOAL if system is BUS else None
        for beside, kinds in FLOODS.items():
            if beside != _QUIET:
                is_floor = bool(FLOORS.intersection(kinds))
                comparisons += against(
                    outcomes,
                    f"{system.name}, {beside}",
                    f"{system.name}, {_QUIET}",
                    "p99",
                    at_most=None if is_floor else goal,
                    label=_QUIET,
                )
    rows = [Row.of(outcomes[case.name]) for case in cases]
    title = f"Fairness: String of 64 B at {_RATE:,.0f}/s beside a client that floods"
    return Section(NAME, title, _COLUMNS, rows, comparisons, _NOTES)


def _case(system: System, work: Work, beside: str) -> Case:
    why_not = system.missing() or (BUS.missing() if "shared memory" in FLOODS[beside] else "")
    return Case(f"{system.name}, {beside}", partial(measure, system, work, FLOODS[beside]), why_not)


def measure(system: System, work: Work, floods: tuple[Kind, ...]) -> Figures:
    """Do it once. Raises Failure where it did not come to its end."""
    with Group() as group:
        (busd,) = system.start_servers(group)
        publisher, subscriber = system.start_pair(group, work)
        flooders = [start_flooder(group, index, kind) for index, kind in enumerate(floods)]
        for child in flooders:
            group.expect(child, "ready", within_s=START_S)
            _report(group, child)
        watched = (busd, *flooders)
        begin_s, before_ns = monotonic(), [child.cpu_ns() for child in watched]
        publisher.tell("go")
        group.expect(subscriber, "complete", within_s=2 * work.total / work.rate + START_S)
        seconds = monotonic() - begin_s
        used_ns = [child.cpu_ns() - before for child, before in zip(watched, before_ns, strict=True)]
        done = [_report(group, child) for child in flooders]
        subscriber.tell("report")
        event = group.expect(subscriber, "received", within_s=START_S)
    figures = paced.summary(msgspec.convert(event, Arrivals))
    figures["busd_cpu"] = used_ns[0] / 1e7 / seconds
    if flooders:
        figures["flooder_cpu"] = sum(used_ns[1:]) / 1e7 / seconds
        figures["asked_per_s"] = sum(asked for asked, _ in done) / seconds
        figures["refused_per_s"] = sum(refused for _, refused in done) / seconds
    return figures


def start_flooder(group: Group, index: int, kind: Kind) -> Child:
    """Start one and don't wait for it."""
    # By whichever route the pair talks.
    environ = {"BUS_ROUTE": ""}
    flood = msgspec.json.encode(Flood(kind)).decode()
    return group.start(f"flooder_{index}", sys.executable, "-m", _ADAPTER, flood, environ=environ)


def _report(group: Group, child: Child) -> tuple[int, int]:
    """What it did since the last time."""
    child.tell("report")
    event = group.expect(child, "flooded", within_s=START_S)
    return event["asked"], event["refused"]
