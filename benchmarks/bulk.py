"""Messages a second of one field of bytes, as a camera's: copied in and out, or written and read in place."""

from msgspec.structs import replace

from benchmarks.cases import interleave
from benchmarks.figures import bytes_text, ratios
from benchmarks.plan import Plan
from benchmarks.report import Comparison, Row, Section, compare
from benchmarks.systems import BUS_BYTES, BUS_SOCKET_BYTES, ICEORYX
from benchmarks.throughput import COLUMNS, case
from benchmarks.work import Work

NAME = "bulk"
_COUNTS = {1 << 16: (20_000, 150_000), 1 << 20: (2_000, 15_000)}
_LOANED, _COPIED, _SOCKET = (
    f"{BUS_BYTES.name}, loaned and viewed",
    f"{BUS_BYTES.name}, copied",
    f"{BUS_SOCKET_BYTES.name}, copied",
)
_RIVAL = f"{ICEORYX.name}, loaned and in place, polling"
_NOTES = [
    "reliable + keep all, a message with one field of bytes; loaned ones are filled by one copy of the same "
    "bytes; every run checked: all arrived, none dropped",
    "loaned and viewed: filled in the ring, read there; copied: publish() of bytes, bytes at the "
    "subscriber's, which looks at the first only; iceoryx2's uses a whole CPU to ask for the next one",
    "where there is no room the publisher waits in send(), so those few messages are copied in in any case",
]


def run(plan: Plan) -> Section:
    """Measure 64 KiB and 1 MiB."""
    cases = []
    for size, counts in _COUNTS.items():
        count, text = plan.choose(*counts), bytes_text(size)
        work = Work(size=size, count=count, warm_up=count // 10, publish_by="publish", take_by="callback")
        loaned = replace(work, publish_by="loan", take_by="views")
        cases.append(case(f"{text}, {_LOANED}", BUS_BYTES, loaned))
        cases.append(case(f"{text}, {_RIVAL}", ICEORYX, replace(work, take_by="polling")))
        cases.append(case(f"{text}, {_COPIED}", BUS_BYTES, work))
        fewer = replace(work, count=count // 4, warm_up=count // 40)
        cases.append(case(f"{text}, {_SOCKET}", BUS_SOCKET_BYTES, fewer))
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    comparisons: list[Comparison] = []
    for text in map(bytes_text, _COUNTS):
        rival = outcomes[f"{text}, {_RIVAL}"].repetitions
        for ours, goal in ((_LOANED, 1.0), (_COPIED, None)):
            values = ratios(outcomes[f"{text}, {ours}"].repetitions, rival, "bytes_per_s")
            comparisons += compare(f"{text}, {ours} / {_RIVAL}, bytes/s", values, at_least=goal)
    rows = [Row.of(outcomes[case.name]) for case in cases]
    return Section(NAME, "Throughput: bytes, lossless, 1 to 1", COLUMNS, rows, comparisons, _NOTES)
