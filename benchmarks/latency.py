"""One-way latency of paced messages, from the call that publishes to the message in the subscriber's hands.

Next to busd, in turns, the floors of its two routes and the rivals. Where the processes run is the
scheduler's choice; who polls and does not wait for events says so.
"""

from msgspec.structs import replace

from benchmarks import paced
from benchmarks.cases import interleave
from benchmarks.figures import ratios
from benchmarks.plan import Plan
from benchmarks.report import Row, Section, compare
from benchmarks.systems import BUS, BUS_SOCKET, FLOOR, ICEORYX, PIPE, PYZMQ, TWO_HOPS
from benchmarks.work import Work

NAME = "latency"
_RATE = 1000.0
_BUSY_POLL_S = 0.002
_OURS, _SOCKET, _POLLING = BUS.name, BUS_SOCKET.name, f"{BUS.name}, busy polling"
_EVENT, _ICEORYX_POLLING = f"{ICEORYX.name}, event-driven", f"{ICEORYX.name}, busy polling"
_GOALS = [
    # ours, theirs, percentile, at most
    (_OURS, FLOOR.name, "p50", 1.3),
    (_OURS, FLOOR.name, "p99", 1.5),
    (_OURS, PYZMQ.name, "p50", 1.0),
    (_OURS, _EVENT, "p50", 1.0),
    (_POLLING, _ICEORYX_POLLING, "p50", 1.0),
    (_SOCKET, TWO_HOPS.name, "p50", 2.0),
]
_NOTES = [
    *paced.LATENCY_NOTES,
    "into a subscriber on uvloop, with a callback where nothing else is said; iceoryx2 has no event loop and "
    "blocks in its listener; busy polling uses a whole CPU while messages come",
]


def run(plan: Plan) -> Section:
    """Measure 64 B at 1,000/s."""
    work = Work(size=64, count=plan.choose(1_000, 6_000), warm_up=200, rate=_RATE, take_by="callback")
    cases = [
        paced.case(_OURS, BUS, work),
        paced.case(FLOOR.name, FLOOR, work),
        paced.case(f"{_OURS}, async for", BUS, replace(work, take_by="async for")),
        paced.case(_SOCKET, BUS_SOCKET, work),
        paced.case(TWO_HOPS.name, TWO_HOPS, work),
        paced.case(PYZMQ.name, PYZMQ, work),
        paced.case(PIPE.name, PIPE, work),
        paced.case(_EVENT, ICEORYX, replace(work, take_by="event")),
        paced.case(_POLLING, BUS, replace(work, busy_poll_s=_BUSY_POLL_S)),
        paced.case(_ICEORYX_POLLING, ICEORYX, replace(work, take_by="polling")),
    ]
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    comparisons = []
    for ours, theirs, key, goal in _GOALS:
        values = ratios(outcomes[ours].repetitions, outcomes[theirs].repetitions, key)
        comparisons += compare(f"{ours} / {theirs}, {key}", values, at_most=goal)
    floor = outcomes[FLOOR.name].repetitions
    for name in (PYZMQ.name, _EVENT, PIPE.name, _SOCKET):
        values = ratios(outcomes[name].repetitions, floor, "p50")
        comparisons += compare(f"{name} / {FLOOR.name}, p50", values)
    rows = [Row.of(outcomes[case.name]) for case in cases]
    title = f"Latency: String of 64 B at {_RATE:,.0f}/s"
    return Section(NAME, title, paced.LATENCY_COLUMNS, rows, comparisons, _NOTES)
