"""One-way latency of messages of 1 MiB, from before they are copied to when the subscriber has them."""

from msgspec.structs import replace

from benchmarks import paced
from benchmarks.cases import interleave
from benchmarks.figures import ratios
from benchmarks.plan import Plan
from benchmarks.report import Row, Section, compare
from benchmarks.systems import BUS, BUS_BYTES, BUS_SOCKET_BYTES, ICEORYX
from benchmarks.work import Work

NAME = "latency_large"
_RATE = 100.0
_EVENT = f"{ICEORYX.name}, event-driven"
_LOANED, _COPIED, _TEXT = (f"{BUS.name}, {way}" for way in ("loaned and viewed", "bytes", "String"))
_NOTES = [
    *paced.LATENCY_NOTES,
    "from before the first of the 1 MiB is copied from the publisher's own memory; loaned and viewed, and "
    "iceoryx2: copied once, into shared memory, and read there; bytes: copied in and out; String: encoded, "
    "decoded and checked to be UTF-8",
]


def run(plan: Plan) -> Section:
    """Measure 1 MiB at 100/s."""
    work = Work(size=1 << 20, count=plan.choose(100, 400), warm_up=80, rate=_RATE, take_by="callback")
    cases = [
        paced.case(_LOANED, BUS_BYTES, replace(work, publish_by="loan", take_by="views")),
        paced.case(_EVENT, ICEORYX, replace(work, take_by="event")),
        paced.case(_COPIED, BUS_BYTES, work),
        paced.case(_TEXT, BUS, work),
        paced.case(f"{BUS_SOCKET_BYTES.name}, bytes", BUS_SOCKET_BYTES, work),
    ]
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    comparisons = []
    for ours, goal in ((_LOANED, 1.0), (_COPIED, None), (_TEXT, None)):
        values = ratios(outcomes[ours].repetitions, outcomes[_EVENT].repetitions, "p50")
        comparisons += compare(f"{ours} / {_EVENT}, p50", values, at_most=goal)
    rows = [Row.of(outcomes[case.name]) for case in cases]
    title = f"Latency of large messages: 1 MiB at {_RATE:,.0f}/s"
    return Section(NAME, title, paced.LATENCY_COLUMNS, rows, comparisons, _NOTES)
