"""The facade of rclpy, with both kinds of nodes, beside the asyncio API and ROS 2's own rclpy, in turns.

Measures latency, CPU time, memory, throughput and start of the same work, and an action beside the same
number of messages. Both programs are typical ones: a timer publishes and a callback takes, in `rclpy.spin` or
on the event loop. The latency of single messages is also measured with the schedule of all other systems.
Floods are also taken by an executor of two threads, beside the default executor.
"""

import os
import signal
import sys
from collections.abc import Callable
from functools import partial
from time import monotonic_ns

from msgspec.structs import replace

from benchmarks import paced, throughput
from benchmarks.adapters.roles import LAST
from benchmarks.adapters.round_trips import FEEDBACKS, MESSAGES
from benchmarks.cases import Case, Figures, interleave
from benchmarks.figures import percentiles, ratios
from benchmarks.harness import START_S, Failure, Group
from benchmarks.installed import Installed, installed
from benchmarks.plan import Plan
from benchmarks.report import Column, Row, Section, compare
from benchmarks.startup import FIRST, compiling, measure_first_message
from benchmarks.systems import ASYNC_NODE, BUS, RCLPY, RCLPY_THREADS, ROS, ROS_LARGE, System
from benchmarks.work import Work

NAME = "facade"
_SIZE, _LARGE = 64, 1 << 20
_RATE, _LARGE_RATE = 2500.0, 200.0
_LIMIT_S = 60.0
_RCLPY, _ASYNCIO, _THREADS, _ASYNC_NODE = "rclpy", "asyncio", "two threads", "AsyncNode"
_GENUINE = ROS.name
_SYSTEMS = {
    _RCLPY: RCLPY,
    _ASYNCIO: BUS,
    _ASYNC_NODE: ASYNC_NODE,
    _THREADS: RCLPY_THREADS,
    _GENUINE: ROS,
}
_BOTH, _SAME, _NEW = (_RCLPY, _ASYNCIO), (_RCLPY, _GENUINE), (_ASYNC_NODE, _ASYNCIO)
_SCHEDULED, _TIMED, _LONG = "64 B by schedule", f"{_RATE:,.0f}/s by a timer", "1 MiB by schedule"
_FLOOD, _LOSSY, _START = "lossless", "default QoS", "start"
_ACTION, _MESSAGES = "an action", f"{MESSAGES} native messages"
_PLACES = {"on one CPU": 1, "on two CPUs": 2}
_WITHOUT = {
    (_SCHEDULED, _THREADS),
    (_TIMED, _THREADS),
    (_LONG, _THREADS),
    (_FLOOD, _GENUINE),  # measured in throughput
    (_START, _THREADS),
    (_START, _ASYNCIO),
    (_START, _ASYNC_NODE),
}
_GOALS = [
    # work, systems, figure, at most, at least
    (_SCHEDULED, _BOTH, "p50", 1.25, None),
    (_SCHEDULED, _BOTH, "p99", None, None),
    (_SCHEDULED, _BOTH, "cpu", None, None),
    (_SCHEDULED, _SAME, "p50", 1 / 3, None),
    (_SCHEDULED, _SAME, "cpu", 1 / 3, None),
    (_LONG, _BOTH, "p50", 1.1, None),
    (_LONG, _SAME, "p50", 1 / 3, None),
    (_LONG, _SAME, "cpu", 1 / 3, None),
    (_TIMED, _BOTH, "p50", 1.25, None),
    (_TIMED, _BOTH, "cpu", None, None),
    (_TIMED, _SAME, "p50", 1 / 3, None),
    (_TIMED, _SAME, "cpu", 1 / 3, None),
    (_TIMED, _SAME, "mib_publisher", 1 / 3, None),
    (_TIMED, _SAME, "mib_subscriber", 1 / 3, None),
    (_FLOOD, _BOTH, "per_s", None, 1 / 3),
    (_FLOOD, (_THREADS, _RCLPY), "per_s", None, 1 / 4),
    (_LOSSY, _BOTH, "per_s", None, None),
    (_LOSSY, _BOTH, "published_per_s", None, None),
    (_LOSSY, (_THREADS, _RCLPY), "per_s", None, 1 / 4),
    (_LOSSY, _SAME, "per_s", None, 3.0),
    (_SCHEDULED, _NEW, "p50", 1.1, None),
    (_SCHEDULED, _NEW, "cpu", None, None),
    (_TIMED, _NEW, "p50", 1.1, None),
    (_TIMED, _NEW, "cpu", None, None),
    (_LONG, _NEW, "p50", 1.1, None),
    (_FLOOD, _NEW, "per_s", None, 1 / 1.1),
    (_LOSSY, _NEW, "per_s", None, None),
    (_START, _SAME, "talker_ms", 1 / 3, None),
    (_START, _SAME, "listener_ms", 1 / 3, None),
]
_COLUMNS = [
    Column("p50", "µs: p50", "lower"),
    Column("p99", "p99", "lower"),
    Column("cpu", "CPU s per 100k: all", "lower"),
    *(Column(f"cpu_{part}", part, "lower") for part in paced.PARTS),
    *(
        Column(f"mib_{part}", f"MiB: {part}" if not index else part, "lower")
        for index, part in enumerate(("publisher", "subscriber"))
    ),
    Column("per_s", "taken/s", "higher"),
    Column("published_per_s", "published/s", "higher"),
    Column("delivered", "delivered %", "higher"),
    Column("talker_ms", "start, ms: talker", "lower"),
    Column("listener_ms", "listener", "lower"),
]
_AS_INSTALLED = "where this tree is installed with what it requires, and nothing else; round trips do not"
_NOTES = [
    f"String of {_SIZE} B, or of 1 MiB, by shared memory, a new object each; rclpy: `rclpy.spin` in both "
    "processes, but floods, and what goes by schedule, are published in a loop that does not spin; its "
    "messages are made empty and then filled",
    f"by schedule: {_RATE:,.0f} messages/s of 64 B, {_LARGE_RATE:,.0f}/s of 1 MiB, as in `latency`",
    f"{_TIMED}: a timer publishes, and skips what it can't do in time; latency from inside its callback to "
    "inside the subscription's; MiB as in `cost`",
    f"{_FLOOD}: reliable + keep all, every run checked; {_LOSSY}: reliable, keep last 10, and the publisher "
    "does not wait, so what is not taken in time is replaced",
    f"{_GENUINE}: the same program on ROS 2 Jazzy as shipped, at 1 MiB with large segments; rclpy: on busd, "
    "by `bus run`",
    "AsyncNode: rclpy.experimental.AsyncNode of ROS 2 Lyrical on busd, on the event loop of the asyncio API",
    "two threads: a MultiThreadedExecutor(2) takes, and the callback's group is mutually exclusive",
    f"{_START}: from the start of a talker's process to its message in another's hands, and from the start "
    "of a listener's process until its subscription is there",
    f"{_ACTION}: from a goal of Fibonacci to its result and {FEEDBACKS} feedbacks, client and server in "
    f"processes of rclpy on busd; {_MESSAGES}: to and fro between two programs of the asyncio API. Both "
    "processes share a CPU, or each has its own: left alone, the kernel often puts two that strictly take "
    "turns on one CPU, where a change takes a fraction of the time, but not the two ends of an action",
]


def run(plan: Plan) -> Section:
    """Measure each work with both, with an installed busd as users have it."""
    plan.tell(f"{NAME} installing busd")
    with installed() as found:
        return _run(plan, found)


def _run(plan: Plan, found: Installed) -> Section:
    timed = Work(
        size=_SIZE,
        count=plan.choose(600, 5_000),
        warm_up=200,
        rate=_RATE,
        publish_by="timer",
        take_by="callback",
    )
    long = replace(
        timed, size=_LARGE, count=plan.choose(40, 500), warm_up=10, rate=_LARGE_RATE, publish_by=""
    )
    count = plan.choose(100_000, 300_000)
    flood = Work(size=_SIZE, count=count, warm_up=count // 10, publish_by="publish", take_by="callback")
    lossy = Work(size=_SIZE, count=count, warm_up=0, publish_by=LAST, take_by="callback")
    cases = []
    for what, work, measure in (
        (_SCHEDULED, replace(timed, publish_by=""), paced.measure),
        (_LONG, long, paced.measure),
        (_TIMED, timed, paced.measure),
        (_FLOOD, flood, throughput.measure),
        (_LOSSY, lossy, measure_lossy),
        (_START, FIRST, measure_start),
    ):
        for name, system in _SYSTEMS.items():
            if (what, name) in _WITHOUT:
                continue
            system = run_by(system, found.python)
            series = f"{what}, {name}"
            if what == _LONG and name == _GENUINE:
                system = ROS_LARGE
            done = replace(work, gives_turns=system.gives_turns) if work.rate else work
            measured: Callable[[], dict[str, float]] = partial(measure, system, done)
            if what == _FLOOD:
                measured = throughput.Lasting(partial(measure, system), work, throughput.least_s(plan))
            rounds = plan.rounds(is_essential=what != _LOSSY and name != _GENUINE)
            cases.append(Case(series, measured, system.missing(), series, work.size, rounds))
    trips = plan.choose(50, 500)
    usable = sorted(os.sched_getaffinity(0))
    for what in (_ACTION, _MESSAGES):
        for where, number in _PLACES.items():
            measured = partial(measure_round_trips, what == _ACTION, trips, usable[:number])
            missing = BUS.missing() or ("" if len(usable) >= number else "there is one CPU only")
            cases.append(Case(f"{what}, {where}", measured, missing, f"{what}, {where}", _SIZE))
    with compiling():
        outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    comparisons = []
    for what, names, key, at_most, at_least in _GOALS:
        ours, theirs = (outcomes[f"{what}, {name}"].repetitions for name in names)
        values = ratios(ours, theirs, key)
        text = f"{what}, {' / '.join(names)}, {key}"
        comparisons += compare(text, values, at_most=at_most, at_least=at_least)
    for where in _PLACES:
        ours, theirs = (outcomes[f"{what}, {where}"].repetitions for what in (_ACTION, _MESSAGES))
        text = f"{_ACTION} / {_MESSAGES}, {where}, p50"
        comparisons += compare(text, ratios(ours, theirs, "p50"), at_most=3.0)
    rows = [Row.of(outcomes[case.name]) for case in cases]
    title = "The facade of rclpy beside the asyncio API"
    where = f"in the environment of its developers, for it can't be installed: {found.why_not}"
    notes = [*_NOTES, f"busd's programs run {where if found.why_not else _AS_INSTALLED}"]
    return Section(NAME, title, _COLUMNS, rows, comparisons, notes, "size in B")


def run_by(system: System, python: str) -> System:
    """`system` with another Python, if this one would run its programs."""
    first, *rest = system.runner
    return system._replace(runner=(python, *rest)) if first == sys.executable else system


def measure_start(system: System, work: Work) -> Figures:
    """The time from a talker's start to its message's arrival, and from a listener's start until it listens.
    Raises Failure."""
    talker = measure_first_message(system)
    with Group() as group:
        system.start_servers(group)
        begin_ns = monotonic_ns()
        system.start_role(group, "subscriber", work)
        listener_ms = (monotonic_ns() - begin_ns) / 1e6
    return {"talker_ms": talker["ms"], "listener_ms": listener_ms}


def measure_round_trips(is_action: bool, count: int, cpus: list[int]) -> Figures:
    """The time from the first message of each round trip to the last. Raises Failure if it did not end.

    The server runs on the first of `cpus`, like busd, and the client on the last.
    """
    runner = RCLPY.runner if is_action else (sys.executable,)
    command = (*runner, "-m", "benchmarks.adapters.round_trips", "action" if is_action else "messages")
    with Group() as group:
        paced.put_on(group.start_busd(), cpus[0])
        for role, cpu in (("server", cpus[0]), ("client", cpus[-1])):
            child = group.start(role, *command, role, str(count), stop_signal=signal.SIGTERM)
            group.expect(child, "ready", within_s=START_S)
            paced.put_on(child, cpu)
        child.send("go")
        taken = group.expect(child, "taken", within_s=_LIMIT_S)
    return percentiles(taken["ns"], scale=1e-3)


def measure_lossy(system: System, work: Work) -> Figures:
    """One flood that may lose messages, except the last. Raises Failure if it did not end."""
    with Group() as group:
        system.start_servers(group)
        publisher, subscriber = system.start_pair(group, work)
        publisher.send("go")
        sent = group.expect(publisher, "sent", within_s=_LIMIT_S)
        received = group.expect(subscriber, "received", within_s=START_S)
    if received["count"] > work.count:
        raise Failure(f"{received['count']} of {work.count} arrived")
    return {
        "per_s": received["count"] * 1e9 / (received["end_ns"] - sent["begin_ns"]),
        "published_per_s": work.count * 1e9 / (sent["end_ns"] - sent["begin_ns"]),
        "delivered": 100 * received["count"] / work.count,
    }
