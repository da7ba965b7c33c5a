"""The CPU time and memory for single messages with pauses, so that every process sleeps between two of
them."""

from msgspec.structs import replace

from benchmarks import paced
from benchmarks.cases import interleave
from benchmarks.goals import reached
from benchmarks.plan import Plan
from benchmarks.report import Column, Row, Section
from benchmarks.systems import (
    BUS,
    BUS_BLOCKING,
    BUS_SOCKET,
    ECAL_SHIPPED,
    ESSENTIAL,
    FLOOR,
    FLOORS,
    PIPE,
    PYZMQ_BLOCKING,
    RCLPY,
    RIVALS,
    ROS,
)
from benchmarks.versus import against, against_best
from benchmarks.work import Work
from bus_cli.bench.figures import bytes_text

NAME = "cost"
_RATE = 5000.0
_SIZE = 64
_COLUMNS = [
    Column("cpu", "CPU s per 100k: all", "lower"),
    *(Column(f"cpu_{part}", part, "lower") for part in paced.PARTS),
    *(
        Column(f"mib_{part}", f"MiB: {part}" if not index else part, "lower")
        for index, part in enumerate(paced.PARTS)
    ),
    Column("p50", "µs: p50", "lower"),
]
_NOTES = [
    "the kernel's clock of each process, from the first message to the last; the publisher's sleep until "
    "the next message is due is in it",
    "publishers that need an event loop give it a turn after each message; those whose library blocks "
    "(all but busd, and clients of asyncio) are plain programs here and do not",
    "MiB: of the whole process after the stream, with its part of the pages that it shares (PSS)",
]


def run(plan: Plan) -> Section:
    """Measure all systems with 64 B at 5,000/s."""
    work = Work(size=_SIZE, count=plan.choose(1_000, 5_000), warm_up=500, rate=_RATE)
    cases = [
        paced.case(
            system.name,
            system,
            replace(work, take_by=system.takes_by, gives_turns=system.gives_turns),
            rounds=plan.rounds(is_essential=system.name in ESSENTIAL),
        )
        for system in (BUS, BUS_BLOCKING, BUS_SOCKET, *FLOORS, *RIVALS, ECAL_SHIPPED, RCLPY)
    ]
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    text = bytes_text(_SIZE)
    ours, socket = (f"{text}, {system.name}" for system in (BUS, BUS_SOCKET))
    rivals = [f"{text}, {rival.name}" for rival in RIVALS]
    brokered = [f"{text}, {rival.name}" for rival in RIVALS if rival.kind == "brokered"]
    plain = [f"{text}, {rival.name}" for rival in (PIPE, PYZMQ_BLOCKING)]
    comparisons = reached(NAME, outcomes)
    comparisons += against_best(outcomes, ours, rivals, "cpu", at_most=1.0, what="CPU")
    comparisons += against_best(
        outcomes, f"{text}, {BUS_BLOCKING.name}", plain, "cpu", at_most=1.0, what="CPU"
    )
    comparisons += against_best(outcomes, socket, brokered, "cpu", what="CPU")
    comparisons += against(outcomes, ours, f"{text}, {FLOOR.name}", "cpu", what="CPU")
    comparisons += against(
        outcomes, f"{text}, {RCLPY.name}", f"{text}, {ROS.name}", "cpu", at_most=1.0, what="CPU"
    )
    rows = [Row.of(outcomes[case.name]) for case in cases]
    title = f"CPU time and memory: String of {text} at {_RATE:,.0f}/s"
    return Section(NAME, title, _COLUMNS, rows, comparisons, _NOTES, "size in B")
