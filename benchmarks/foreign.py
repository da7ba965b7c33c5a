"""One-way latency beside a process that only uses a CPU and knows no bus: a steady foreign load.

With two CPUs, a pair then has one CPU for itself, if the scheduler arranges that. The section also shows the
context switches of its processes, voluntary and forced. Each system is also measured alone.
"""

from functools import partial

from msgspec.structs import replace

from benchmarks import paced
from benchmarks.cases import Case, interleave
from benchmarks.plan import Plan
from benchmarks.report import Column, Comparison, Row, Section
from benchmarks.systems import (
    BUS,
    BUS_BLOCKING,
    ECAL,
    FLOOR,
    ICEORYX,
    PIPE,
    PYZMQ,
    PYZMQ_BLOCKING,
    System,
)
from benchmarks.versus import against, against_best
from benchmarks.work import Work
from bus_cli.bench.figures import bytes_text

NAME = "foreign"
_SIZE, _RATE = 64, 2500.0
_SYSTEMS = (BUS, BUS_BLOCKING, FLOOR, PIPE, PYZMQ, PYZMQ_BLOCKING, ICEORYX, ECAL)
_QUICK_SYSTEMS = (BUS, FLOOR, PIPE, ECAL)
_RIVALS = (PIPE, PYZMQ, ICEORYX, ECAL)
_PLAIN = (PIPE, PYZMQ_BLOCKING)
_COLUMNS = [
    *(column for column in paced.LATENCY_COLUMNS if column.key in ("p50", "p90", "p99", "p99.9", "max")),
    Column("taken_subscriber", "CPU taken away, per 1,000 messages: subscriber", "lower"),
    Column("taken_publisher", "publisher", "lower"),
    Column("given_subscriber", "CPU given up, per message: subscriber", "lower"),
    Column("given_publisher", "publisher", "lower"),
]
_NOTES = [
    "the neighbour is a loop that never sleeps; the scheduler chooses where everything runs",
    "each publisher sends as a plain program does and sleeps until the next is due, busd's by `bus.connect`",
    "given up, taken away: the kernel's counts of voluntary and other switches, of all threads of a process",
]


def run(plan: Plan) -> Section:
    """Measure a few systems, each alone and beside the neighbour."""
    systems = _QUICK_SYSTEMS if plan.quick else _SYSTEMS
    cases = [_case(plan, system, number) for number in (0, 1) for system in systems]
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    rivals, plain = ([_name(rival, 1) for rival in some] for some in (_RIVALS, _PLAIN))
    comparisons: list[Comparison] = []
    for key in ("p50", "p99"):
        comparisons += against_best(outcomes, _name(BUS, 1), rivals, key, at_most=1.0)
        comparisons += against_best(outcomes, _name(BUS_BLOCKING, 1), plain, key, at_most=1.0)
    for system in systems:
        comparisons += against(outcomes, _name(system, 1), _name(system, 0), "p99", label="alone")
    rows = [Row.of(outcomes[case.name]) for case in cases]
    title = f"Beside a process that uses a CPU: String of {bytes_text(_SIZE)} at {_RATE:,.0f}/s"
    return Section(NAME, title, _COLUMNS, rows, comparisons, _NOTES, "neighbours")


def _case(plan: Plan, system: System, number: int) -> Case:
    work = Work(size=_SIZE, count=plan.choose(600, 5_000), warm_up=200, rate=_RATE)
    work = replace(work, take_by=system.takes_by, gives_turns=False)
    measured = partial(paced.measure, paced.PLAIN.get(system.name, system), work, neighbours=number)
    rounds = plan.rounds(is_essential=number > 0)
    return Case(_name(system, number), measured, system.missing(), system.name, number, rounds)


def _name(system: System, number: int) -> str:
    return f"{system.name}, {'beside a busy process' if number else 'alone'}"
