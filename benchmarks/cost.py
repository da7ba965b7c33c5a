"""What CPU time messages cost that come one by one, so that every process sleeps between any two."""

from msgspec.structs import replace

from benchmarks import paced
from benchmarks.cases import interleave
from benchmarks.figures import ratios
from benchmarks.plan import Plan
from benchmarks.report import Column, Row, Section, compare
from benchmarks.systems import BUS, BUS_SOCKET, FLOOR, ICEORYX, PIPE, PYZMQ
from benchmarks.work import Work

NAME = "cost"
_RATE = 5000.0
_COLUMNS = [
    Column("cpu", "CPU s per 100k: all"),
    Column("cpu_publisher", "publisher"),
    Column("cpu_broker", "broker"),
    Column("cpu_subscriber", "subscriber"),
    Column("p50", "µs: p50"),
]
_NOTES = [
    "the kernel's clock of each process, from the first message to the last, for String of 64 B; the "
    "publisher's sleep until the next message is due is in it",
    "publishers give their event loop a turn after each message, but for the Pipe's and the floor's, which "
    "are plain programs; the Pipe's subscriber blocks in recv()",
]


def run(plan: Plan) -> Section:
    """Measure 64 B at 5,000/s."""
    work = Work(size=64, count=plan.choose(4_000, 20_000), warm_up=500, rate=_RATE, take_by="callback")
    plain = replace(work, take_by="blocking", gives_turns=False)
    cases = [
        paced.case(BUS.name, BUS, work),
        paced.case(PIPE.name, PIPE, plain),
        paced.case(FLOOR.name, FLOOR, plain),
        paced.case(BUS_SOCKET.name, BUS_SOCKET, work),
        paced.case(PYZMQ.name, PYZMQ, work),
        paced.case(f"{ICEORYX.name}, event-driven", ICEORYX, replace(work, take_by="event")),
    ]
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    ours = outcomes[BUS.name].repetitions
    comparisons = []
    for theirs, goal in ((PIPE, 1.0), (FLOOR, None)):
        values = ratios(ours, outcomes[theirs.name].repetitions, "cpu")
        comparisons += compare(f"{BUS.name} / {theirs.name}, CPU", values, at_most=goal)
    rows = [Row.of(outcomes[case.name]) for case in cases]
    return Section(NAME, f"CPU time: String of 64 B at {_RATE:,.0f}/s", _COLUMNS, rows, comparisons, _NOTES)
