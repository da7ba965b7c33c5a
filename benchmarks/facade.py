"""The facade of rclpy beside the asyncio API, and beside ROS 2's own rclpy, in turns: latency, CPU time and
throughput of the same work.

Both are programs of their kind: a timer publishes and a callback takes, in `rclpy.spin` or on the event loop.
Floods are also taken by an executor of two threads, beside the executor that a program has which names none.
"""

from collections.abc import Callable
from functools import partial

from benchmarks import paced, throughput
from benchmarks.adapters.roles import LAST
from benchmarks.cases import Case, Figures, interleave
from benchmarks.figures import ratios
from benchmarks.harness import START_S, Failure, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Row, Section, compare
from benchmarks.systems import BUS, RCLPY, RCLPY_THREADS, ROS, System
from benchmarks.work import Work

NAME = "facade"
_SIZE = 64
_RATE = 2500.0
_LIMIT_S = 60.0
_RCLPY, _ASYNCIO, _THREADS = "rclpy", "asyncio", "two threads"
_GENUINE = ROS.name
_SYSTEMS = {_RCLPY: RCLPY, _ASYNCIO: BUS, _THREADS: RCLPY_THREADS, _GENUINE: ROS}
_BOTH, _SAME = (_RCLPY, _ASYNCIO), (_RCLPY, _GENUINE)
_PACED, _FLOOD, _LOSSY = f"{_RATE:,.0f}/s", "lossless", "default QoS"
_GOALS = [
    # what, which of which, figure, at most, at least
    (_PACED, _BOTH, "p50", 1.5, None),
    (_PACED, _BOTH, "p99", None, None),
    (_PACED, _BOTH, "cpu", None, None),
    (_PACED, _SAME, "p50", 1.0, None),
    (_PACED, _SAME, "cpu", 1.0, None),
    (_FLOOD, _BOTH, "per_s", None, 1 / 3),
    (_FLOOD, (_THREADS, _RCLPY), "per_s", None, 1 / 4),
    (_LOSSY, _BOTH, "per_s", None, None),
    (_LOSSY, _BOTH, "published_per_s", None, None),
    (_LOSSY, (_THREADS, _RCLPY), "per_s", None, 1 / 4),
    (_LOSSY, _SAME, "per_s", None, 1.0),
]
_COLUMNS = [
    Column("p50", "µs: p50", "lower"),
    Column("p99", "p99", "lower"),
    Column("cpu", "CPU s per 100k: all", "lower"),
    *(Column(f"cpu_{part}", part, "lower") for part in paced.PARTS),
    Column("per_s", "taken/s", "higher"),
    Column("published_per_s", "published/s", "higher"),
    Column("delivered", "delivered %", "higher"),
]
_NOTES = [
    f"String of {_SIZE} B by shared memory, a new object each; rclpy: `rclpy.spin` in both processes, but "
    "floods are published in a loop that does not spin; its messages are made empty and then filled",
    f"{_PACED}: a timer publishes, and skips what it can't do in time; latency from inside its callback to "
    "inside the subscription's",
    f"{_FLOOD}: reliable + keep all, every run checked; {_LOSSY}: reliable, keep last 10, and the publisher "
    "does not wait, so what is not taken in time is replaced",
    f"{_GENUINE}: the same program on ROS 2 Jazzy as shipped; rclpy: on busd, by `bus run`",
    "two threads: a MultiThreadedExecutor(2) takes, and the callback's group is mutually exclusive",
]


def run(plan: Plan) -> Section:
    """Measure each work by both."""
    timed = Work(
        size=_SIZE,
        count=plan.choose(600, 5_000),
        warm_up=200,
        rate=_RATE,
        publish_by="timer",
        take_by="callback",
    )
    count = plan.choose(100_000, 300_000)
    flood = Work(size=_SIZE, count=count, warm_up=count // 10, publish_by="publish", take_by="callback")
    lossy = Work(size=_SIZE, count=count, warm_up=0, publish_by=LAST, take_by="callback")
    cases = []
    for what, work, measure in (
        (_PACED, timed, paced.measure),
        (_FLOOD, flood, throughput.measure),
        (_LOSSY, lossy, measure_lossy),
    ):
        for name, system in _SYSTEMS.items():
            if (what, name) in ((_PACED, _THREADS), (_FLOOD, _GENUINE)):  # the latter is in throughput
                continue
            series = f"{what}, {name}"
            measured: Callable[[], dict[str, float]] = partial(measure, system, work)
            if what == _FLOOD:
                measured = throughput.Lasting(partial(measure, system), work, throughput.least_s(plan))
            rounds = plan.rounds(is_essential=what != _LOSSY and system is not ROS)
            cases.append(Case(series, measured, system.missing(), series, _SIZE, rounds))
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    comparisons = []
    for what, names, key, at_most, at_least in _GOALS:
        ours, theirs = (outcomes[f"{what}, {name}"].repetitions for name in names)
        values = ratios(ours, theirs, key)
        text = f"{what}, {' / '.join(names)}, {key}"
        comparisons += compare(text, values, at_most=at_most, at_least=at_least)
    rows = [Row.of(outcomes[case.name]) for case in cases]
    title = "The facade of rclpy beside the asyncio API"
    return Section(NAME, title, _COLUMNS, rows, comparisons, _NOTES, "size in B")


def measure_lossy(system: System, work: Work) -> Figures:
    """One flood of which some, but not the last, may be lost. Raises Failure where it did not end."""
    with Group() as group:
        system.start_servers(group)
        publisher, subscriber = system.start_pair(group, work)
        publisher.tell("go")
        sent = group.expect(publisher, "sent", within_s=_LIMIT_S)
        received = group.expect(subscriber, "received", within_s=START_S)
    if received["count"] > work.count:
        raise Failure(f"{received['count']} of {work.count} arrived")
    return {
        "per_s": received["count"] * 1e9 / (received["end_ns"] - sent["begin_ns"]),
        "published_per_s": work.count * 1e9 / (sent["end_ns"] - sent["begin_ns"]),
        "delivered": 100 * received["count"] / work.count,
    }
