"""Messages a second with one field of bytes, like a camera's: copied in and out, or written and read in
place."""

from functools import partial

from benchmarks import copying
from benchmarks.cases import Case, interleave
from benchmarks.goals import reached
from benchmarks.plan import Plan
from benchmarks.report import Comparison, Row, Section
from benchmarks.systems import BUS_BYTES, BUS_SOCKET_BYTES, ICEORYX, Speed
from benchmarks.throughput import COLUMNS, case, copying_case, least_s, work_of
from benchmarks.versus import against
from bus_cli.bench.figures import bytes_text

NAME = "bulk"
_SIZES = (1 << 16, 1 << 20, 4 << 20)
_COMPARED = 1 << 20
"""The size that the goals use."""
_LOANED, _COPIED, _SOCKET = (
    f"{BUS_BYTES.name}, loaned and viewed",
    f"{BUS_BYTES.name}, copied",
    f"{BUS_SOCKET_BYTES.name}, copied",
)
_RIVAL = f"{ICEORYX.name}, loaned and in place"
_POLLING, _RIVAL_POLLING = (f"{way}, busy polling" for way in (_LOANED, _RIVAL))
_BUSY_POLL_S = 0.002
_IN_PLACE = Speed(300_000, 20e9)
_GOALS = [
    # ours, theirs, sizes, least ratio
    (_LOANED, _RIVAL, _SIZES, 1.0),
    (_POLLING, _RIVAL_POLLING, (1 << 16, 4 << 20), 1.0),
    (_COPIED, _RIVAL, _SIZES, None),
    (_COPIED, copying.NAME, (1 << 20,), None),
]
_NOTES = [
    "reliable + keep all, a message with one field of bytes; loaned ones are filled by one copy of the same "
    "bytes; every run checked: all arrived, none dropped",
    "loaned and viewed: filled in the ring, read there; copied: publish() of bytes, bytes at the "
    "subscriber's, which looks at the first only",
    "busy polling: the subscriber uses a whole CPU to look for the next one; iceoryx2's all the time, busd's "
    f"for {_BUSY_POLL_S * 1e3:g} ms after each; the others wait for events",
    "where there is no room the publisher waits in send(), so those few messages are copied in in any case",
]


def run(plan: Plan) -> Section:
    """Measure the long sizes of the plan."""
    sizes = [size for size in _SIZES if size in plan.sizes]
    cases = [one for size in sizes for one in _cases(plan, size)]
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    comparisons: list[Comparison] = reached(NAME, outcomes)
    for size in sizes:
        text = bytes_text(size)
        for ours, theirs, of_sizes, goal in _GOALS:
            if size in of_sizes:
                comparisons += against(
                    outcomes,
                    f"{text}, {ours}",
                    f"{text}, {theirs}",
                    "bytes_per_s",
                    at_least=goal,
                    what="bytes/s",
                )
    rows = [Row.of(outcomes[case.name]) for case in cases]
    title = "Throughput: bytes, lossless, 1 to 1"
    return Section(NAME, title, COLUMNS, rows, comparisons, _NOTES, "size in B")


def _cases(plan: Plan, size: int) -> list[Case]:
    rounds = plan.rounds(is_essential=size == _COMPARED)
    work = partial(work_of, plan, _IN_PLACE, size, publish_by="loan")
    ways = [
        (_LOANED, BUS_BYTES, work(take_by="views")),
        (_RIVAL, ICEORYX, work(take_by="event")),
        (_POLLING, BUS_BYTES, work(take_by="views", busy_poll_s=_BUSY_POLL_S)),
        (_RIVAL_POLLING, ICEORYX, work(take_by="polling")),
        (_COPIED, BUS_BYTES, work_of(plan, BUS_BYTES.guess, size)),
        (_SOCKET, BUS_SOCKET_BYTES, work_of(plan, BUS_SOCKET_BYTES.guess, size)),
    ]
    cases = [case(series, system, work, least_s(plan), rounds) for series, system, work in ways]
    return [*cases, copying_case(plan, size)]
