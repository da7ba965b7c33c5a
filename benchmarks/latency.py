"""One-way latency of paced messages, from the call that publishes to the message in the subscriber's hands.

Measures every system at every size, in turns: busd by both routes, the floors, the rivals. All wait for
events, except the ones marked as polling. The scheduler chooses the CPUs of processes.
"""

import os
from collections.abc import Mapping
from functools import partial

from msgspec.structs import replace

from benchmarks import paced
from benchmarks.cases import Case, Outcome, interleave
from benchmarks.goals import reached
from benchmarks.plan import Plan
from benchmarks.report import Comparison, Row, Section
from benchmarks.systems import (
    BUS,
    BUS_BLOCKING,
    BUS_BYTES,
    BUS_SOCKET,
    BUS_SOCKET_BYTES,
    ECAL,
    ECAL_SHIPPED,
    ESSENTIAL,
    FLOOR,
    FLOORS,
    ICEORYX,
    PIPE,
    PYZMQ,
    PYZMQ_BLOCKING,
    PYZMQ_PROXY,
    RCLPY,
    RIVALS,
    ROS,
    ROS_LARGE,
    TUNED,
    TWO_HOPS,
    ZENOH,
    System,
    tuned,
)
from benchmarks.versus import against, against_best
from benchmarks.work import Work
from bus_cli.bench.figures import bytes_text

NAME = "latency"
_SMALL = 64
_BUSY_POLL_S = 0.002


_STREAMS = {
    _SMALL: paced.Stream(2500, 200, (600, 5000)),
    1 << 10: paced.Stream(2500, 200, (300, 5000)),  # with 1,000, one pause of the machine was the whole p99
    1 << 16: paced.Stream(1000, 100, (200, 1000)),
    1 << 20: paced.Stream(200, 10, (40, 500)),
    4 << 20: paced.Stream(20, 4, (15, 20)),
}
_PLACED = (BUS, FLOOR, ECAL)
_ON_ONE, _ON_TWO = "on one CPU", "on two CPUs"
_POLLED = (_SMALL, 1 << 16, 1 << 20)
_BY_FACADE = (_SMALL, 1 << 20)
_LARGE = (1 << 20, 4 << 20)
_COMPARED = (_SMALL, 1 << 16, 1 << 20)
"""The sizes that are measured in more than one round."""
_TUNED_AT = 1 << 20
_QUICK_TUNED = (BUS, PIPE, PYZMQ, ICEORYX, ECAL)
_TUNED = (BUS, BUS_BLOCKING, BUS_SOCKET, PIPE, PYZMQ, PYZMQ_BLOCKING, PYZMQ_PROXY, ICEORYX, ZENOH, ECAL)
_AS_BYTES = 1 << 20
_LOANED, _COPIED = f"{BUS.name}, loaned and viewed", f"{BUS.name}, bytes"
_POLLING, _RIVAL_POLLING = f"{BUS.name}, busy polling", f"{ICEORYX.name}, busy polling"
_IN_PLACE = f"{ICEORYX.name}, in place"
_GOALS = [
    # ours, theirs, percentile, at most
    (BUS.name, FLOOR.name, "p99", 1.5),
    (f"{BUS.name}, {_ON_ONE}", f"{FLOOR.name}, {_ON_ONE}", "p50", 1.3),
    (f"{BUS.name}, {_ON_TWO}", f"{FLOOR.name}, {_ON_TWO}", "p50", 1.3),
    (BUS_SOCKET.name, TWO_HOPS.name, "p50", 2.0),
    (BUS_BLOCKING.name, BUS.name, "p50", 1.1),
]
_GOALS_AT_ALL_SIZES = [
    (ours, theirs, key, 1.0)
    for ours, theirs in ((_POLLING, _RIVAL_POLLING), (_LOANED, _IN_PLACE))
    for key in ("p50", "p99")
]
_NOTES = [
    *paced.LATENCY_NOTES,
    "String: a str at both ends; into a subscriber on uvloop where the system can, with a callback where "
    "nothing else is said; busy polling uses a whole CPU while messages come",
    "blocking API, Pipe, Queue and pyzmq, blocking: plain programs, without an event loop's turns at either "
    "end; the blocking API is compared with those",
    f"{TUNED}: MALLOC_* in the environment of all processes, of busd's too, has glibc keep the memory of "
    "long messages; busd asks for that by itself, and where nobody does each message costs page faults",
    "busd, rclpy, and rclpy, Fast DDS: one program, on busd's facade by `bus run`, and on ROS 2 Jazzy as "
    "shipped; large segment: Fast DDS is told to use 64 MiB of shared memory",
    "eclipse-ecal, as shipped: its processes look for each other each second, not ten times as often",
    "loaned and viewed, and in place: copied once, into shared memory, and only looked at there; bytes: "
    "copied in and out, and nothing is decoded",
    "on one CPU, on two: publisher and subscriber were put there; else the scheduler chooses. A wake-up of "
    "another virtual CPU costs several times one of the same",
    "best rival: the one with the best median of all that wait for events; of fewer than 100 messages the "
    "p99 is the max",
]


def run(plan: Plan) -> Section:
    """Measure all systems at the sizes of the plan."""
    cases = [case for size in plan.sizes for case in _cases(plan, size)]
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    comparisons = reached(NAME, outcomes)
    comparisons += [one for size in plan.sizes for one in _compare(outcomes, size)]
    rows = [Row.of(outcomes[case.name]) for case in cases]
    rates = ", ".join(f"{bytes_text(size)} at {_STREAMS[size].rate:,.0f}/s" for size in plan.sizes)
    title = f"Latency: String of {rates}"
    return Section(NAME, title, paced.LATENCY_COLUMNS, rows, comparisons, _NOTES, "size in B")


def _cases(plan: Plan, size: int) -> list[Case]:
    stream = _STREAMS[size]
    work = Work(size=size, count=plan.choose(*stream.counts), warm_up=stream.warm_up, rate=stream.rate)
    case = partial(_case, plan, work)
    cases = [
        case(system.name, system)
        for system in (BUS, BUS_BLOCKING, BUS_SOCKET, *FLOORS, *RIVALS)
        if size <= system.largest
    ]
    if size == _TUNED_AT:
        cases += [case(one.name, one) for one in map(tuned, _QUICK_TUNED if plan.quick else _TUNED)]
    if size in _POLLED:
        cases.append(case(_POLLING, BUS, busy_poll_s=_BUSY_POLL_S))
        cases.append(case(_RIVAL_POLLING, ICEORYX, take_by="polling"))
    if size in _LARGE:
        cases.append(case(_LOANED, BUS_BYTES, publish_by="loan", take_by="views"))
        cases.append(case(_IN_PLACE, ICEORYX, publish_by="loan"))
    return cases if plan.quick else [*cases, *_more(plan, work)]


def _more(plan: Plan, work: Work) -> list[Case]:
    """The optional cases: once or twice, because no goal uses them."""
    case = partial(_case, plan, work, rounds=plan.rounds(is_essential=False))
    cases = []
    if work.size in _BY_FACADE:
        cases.append(case(RCLPY.name, RCLPY))
    if work.size in _LARGE:
        cases.append(case(ROS_LARGE.name, ROS_LARGE))
    if work.size == _AS_BYTES:
        cases.append(case(_COPIED, BUS_BYTES))
        cases.append(case(f"{BUS_SOCKET.name}, bytes", BUS_SOCKET_BYTES))
    if work.size == _SMALL:
        cases.append(case(ECAL_SHIPPED.name, ECAL_SHIPPED))
        cases.append(case(f"{BUS.name}, async for", BUS, take_by="async for"))
        cases += [_placed(plan, work, system, where) for where in (_ON_ONE, _ON_TWO) for system in _PLACED]
    return cases


def _placed(plan: Plan, work: Work, system: System, where: str) -> Case:
    cpus = sorted(os.sched_getaffinity(0))[: 1 if where == _ON_ONE else 2]
    rounds = plan.rounds(is_essential=False)
    work = _as_used(work, system)
    placed = paced.case(f"{system.name}, {where}", system, work, cpus, rounds)
    return placed._replace(missing="there is one CPU only") if where == _ON_TWO and len(cpus) < 2 else placed


def _case(plan: Plan, work: Work, series: str, system: System, *, rounds: int = 0, **ways: object) -> Case:
    is_ours = system.kind == "ours" or system.name.removesuffix(f", {TUNED}") in ESSENTIAL
    if work.size not in _COMPARED or not is_ours:
        rounds = plan.rounds(is_essential=False)
    elif not rounds and work.size == _TUNED_AT:
        rounds = max(1, plan.repetitions - 2)  # each takes long
    return paced.case(series, system, replace(_as_used(work, system), **ways), rounds=rounds)


def _as_used(work: Work, system: System) -> Work:
    """A system that blocks has plain programs at both ends; all others publish from programs of asyncio."""
    return replace(work, take_by=system.takes_by, gives_turns=system.takes_by != "blocking")


def _compare(outcomes: Mapping[str, Outcome], size: int) -> list[Comparison]:
    text = bytes_text(size)
    rivals = [f"{text}, {rival.name}" for rival in RIVALS]
    brokered = [f"{text}, {rival.name}" for rival in RIVALS if rival.kind == "brokered"]
    found: list[Comparison] = []
    plain = [f"{text}, {rival.name}" for rival in (PIPE, PYZMQ_BLOCKING)]
    for key in ("p50", "p99"):
        found += against_best(outcomes, f"{text}, {BUS.name}", rivals, key, at_most=1.0)
        found += against_best(outcomes, f"{text}, {BUS_SOCKET.name}", brokered, key, at_most=1.0)
        found += against_best(outcomes, f"{text}, {BUS_BLOCKING.name}", plain, key, at_most=1.0)
        for ours, theirs in ((BUS, rivals), (BUS_SOCKET, brokered), (BUS_BLOCKING, plain)):
            same = [f"{rival}, {TUNED}" for rival in theirs]
            found += against_best(outcomes, f"{text}, {tuned(ours).name}", same, key, at_most=1.0)
    for genuine in (ROS, ROS_LARGE):
        theirs_name = f"{text}, {genuine.name}"
        found += against(outcomes, f"{text}, {RCLPY.name}", theirs_name, "p50", at_most=1.0)
    for where in (_ON_ONE, _ON_TWO):
        placed = [f"{text}, {rival.name}, {where}" for rival in _PLACED if rival.kind == "direct"]
        found += against_best(outcomes, f"{text}, {BUS.name}, {where}", placed, "p50", at_most=1.0)
    for ours, theirs, key, goal in (*(_GOALS if size == _SMALL else ()), *_GOALS_AT_ALL_SIZES):
        found += against(outcomes, f"{text}, {ours}", f"{text}, {theirs}", key, at_most=goal)
    return found
