"""One publisher's process to many subscribers' processes: deliveries a second, and the arrival at the last
one.

Measures every system that fans out, without losses if the system can. For busd it also measures the cost of a
publish without waiting for subscribers, and the outcome of each message.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from time import sleep

from benchmarks.adapters.bus_fanout import Fan
from benchmarks.cases import Case, Figures, Outcome, interleave
from benchmarks.figures import per_100k, percentiles, ratios
from benchmarks.goals import reached
from benchmarks.harness import START_S, Child, Event, Failure, Group
from benchmarks.paced import PLAIN
from benchmarks.plan import Plan
from benchmarks.report import Column, Comparison, Row, Section, compare
from benchmarks.systems import (
    BUS,
    BUS_FAN_OUT,
    BUS_SOCKET,
    BUS_SOCKET_FAN_OUT,
    ICEORYX,
    NATS,
    PYZMQ,
    PYZMQ_PROXY,
    RCLPY,
    RIVALS,
    ROS,
    System,
)
from benchmarks.throughput import Lasting, flood_s, least_s
from benchmarks.versus import against, against_best
from benchmarks.work import Work

NAME = "fanout"
_QUICK_RIVALS = (PYZMQ, NATS)
_SIZE, _RATE = 64, 400.0
_NUMBERS, _QUICK_NUMBERS = (1, 8, 16), (8,)
_GOAL_NUMBERS = (8, 16)
_LOSSY_NUMBERS = (1, 16)
_SLOW_NUMBER = 8
_FAST = (BUS, BUS_SOCKET, PYZMQ, PYZMQ_PROXY, ICEORYX)
"""The other systems are measured with this number of subscribers only, and in fewer rounds."""
_LIMIT_S = 30.0
_LOOK_S = 0.3
_REASONS = ("replaced", "overrun", "publisher_queue", "memory_limit")
_COLUMNS = [
    Column("deliveries_per_s", "deliveries/s", "higher"),
    Column("lost", "lost %", "lower"),
    Column("cpu", "CPU s per 100k deliveries", "lower"),
    Column("last_p50", "last has it, µs: p50", "lower"),
    Column("last_p99", "p99", "lower"),
]
_NOTES = [
    f"String of {_SIZE} B, each subscriber in a process of its own; a flood, from the first publish to when "
    "the slowest has the last message, and the CPU time of all processes meanwhile; lossless but where "
    "`lost` says otherwise",
    f"last has it: {_RATE:g}/s, from the call that publishes a message to the moment when the last of all "
    "subscribers has it in its hands; each publisher sends as a plain program does, busd's by `bus.connect`, "
    "and sleeps until the next is due, but for nats-py, which needs its event loop",
    "lossy: best effort, keep last 1,000, and the publisher never waits, so what can't be taken in time is "
    "lost, and all of it is accounted for (the reasons stand in the JSON); its CPU time is that of its whole "
    "process while it publishes",
]


def run(plan: Plan) -> Section:
    """Measure every system that fans out, and busd without waiting."""
    rivals = _QUICK_RIVALS if plan.quick else RIVALS
    systems = [BUS, BUS_SOCKET, *(system for system in rivals if system.fans_out)]
    if not plan.quick:
        systems.append(RCLPY)
    numbers = _QUICK_NUMBERS if plan.quick else _NUMBERS
    cases = [
        _case(plan, system, number)
        for number in numbers
        for system in systems
        if number == _SLOW_NUMBER or system in _FAST
    ]
    if not plan.quick:
        cases += [_lossy_case(BUS_FAN_OUT, number) for number in _LOSSY_NUMBERS]
        cases.append(_lossy_case(BUS_SOCKET_FAN_OUT, 8))
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    rows = [Row.of(outcomes[case.name]) for case in cases]
    title = "Fan-out: one publisher, many subscribers"
    return Section(NAME, title, _COLUMNS, rows, comparisons(outcomes, systems), _NOTES, "subscribers")


def comparisons(outcomes: Mapping[str, Outcome], systems: list[System]) -> list[Comparison]:
    """The goals for which `outcomes` has figures."""
    # A system that loses messages in a flood may deliver all messages of the paced stream.
    paced = {
        name: replace(one, repetitions=[figures | {"lost": 0.0} for figures in one.repetitions])
        for name, one in outcomes.items()
    }
    found: list[Comparison] = reached(NAME, outcomes)
    for number in _GOAL_NUMBERS:
        rivals = [name_of(one, number) for one in systems if one.kind in ("direct", "brokered")]
        brokered = [name_of(one, number) for one in systems if one.kind == "brokered"]
        for system, theirs, least in ((BUS, rivals, 2.0), (BUS_SOCKET, brokered, 1.0)):
            ours = name_of(system, number)
            what = " with a broker" if system is BUS_SOCKET else ""
            found += against_best(
                outcomes, ours, theirs, "deliveries_per_s", at_least=least, what=f"deliveries/s{what}"
            )
            for key in ("p50", "p99"):
                found += against_best(
                    paced, ours, theirs, f"last_{key}", at_most=1.0, what=f"time to the last{what}, {key}"
                )
    facade, genuine = name_of(RCLPY, _SLOW_NUMBER), name_of(ROS, _SLOW_NUMBER)
    bounds: tuple[tuple[str, float | None, float | None], ...] = (
        ("deliveries_per_s", 1.0, None),
        ("last_p50", None, 1.0),
    )
    for key, at_least, at_most in bounds:
        found += against(outcomes, facade, genuine, key, at_least=at_least, at_most=at_most)
    ours = name_of(BUS, 8)
    if ours in outcomes:
        values = [one["deliveries_per_s"] for one in outcomes[ours].repetitions]
        found += compare(f"{ours}, deliveries/s", values, at_least=4e6)
    for name, outcome in outcomes.items():
        values = [one["cpu_publish_ns"] for one in outcome.repetitions if "cpu_publish_ns" in one]
        found += compare(f"{name}, CPU ns of the publisher per publish", values)
    one, many = (outcomes.get(_lossy_name(BUS_FAN_OUT, number)) for number in _LOSSY_NUMBERS)
    if one and many:
        values = ratios(many.repetitions, one.repetitions, "cpu_publish_ns")
        name = f"lossy, CPU per publish, {_LOSSY_NUMBERS[1]} subscribers / {_LOSSY_NUMBERS[0]}"
        found += compare(name, values, at_most=1.5)
    return found


def measure(system: System, flood: Callable[[], Figures], paced: Work) -> Figures:
    """A flood and a paced stream. Raises Failure if one did not end, or lost messages that it must not
    lose."""
    return flood() | measure_last(PLAIN.get(system.name, system), paced)


def measure_flood(system: System, work: Work) -> Figures:
    """Deliveries to all subscribers together."""
    with Group() as group:
        servers = system.start_servers(group)
        publisher, subscribers = system.start_fan(group, work, work.subscribers)
        publisher.send("warm_up")
        for child in () if system.may_lose else subscribers:
            group.expect(child, "warm", within_s=_LIMIT_S)
        children = (publisher, *subscribers, *servers)
        before_ns = sum(child.cpu_ns() for child in children)
        publisher.send("go")
        begin_ns = int(group.expect(publisher, "sent", within_s=_LIMIT_S)["begin_ns"])
        received = (_look if system.may_lose else _expect)(group, subscribers)
        after_ns = sum(child.cpu_ns() for child in children)
    expected = work.count if system.may_lose else work.total
    for one in received:
        if one["count"] > expected or ((one["count"] < expected or one["dropped"]) and not system.may_lose):
            raise Failure(f"{one['count']} of {expected} arrived; dropped: {one['dropped']}")
    delivered = sum(one["count"] for one in received) - (expected - work.count) * work.subscribers
    seconds = (max(one["end_ns"] for one in received) - begin_ns) / 1e9
    if delivered < 1 or seconds <= 0:
        raise Failure("nothing arrived")
    return {
        "deliveries_per_s": delivered / seconds,
        "lost": 100 - 100 * delivered / (work.count * work.subscribers),
        "cpu": per_100k((after_ns - before_ns) / 1e9, delivered),
        "seconds": seconds,
    }


def measure_last(system: System, work: Work) -> Figures:
    """The time until the last subscriber has a message, in µs."""
    with Group() as group:
        system.start_servers(group)
        publisher, subscribers = system.start_fan(group, work, work.subscribers)
        publisher.send("go")
        for child in subscribers:
            group.expect(child, "complete", within_s=2 * work.total / work.rate + START_S)
        for child in subscribers:
            child.send("report")
        ages = [group.expect(child, "received", within_s=START_S)["age_ns"] for child in subscribers]
    return percentiles(map(max, zip(*ages, strict=True)), prefix="last_", scale=1e-3)


def measure_lossy(system: System, fan: Fan) -> Figures:
    """One flood without waiting for subscribers. Raises Failure if the outcome of a message is unknown."""
    with Group() as group:
        system.start_servers(group)
        publisher, subscribers = system.start_fan(group, fan, fan.subscribers)
        publisher.send("go")
        sent = group.expect(publisher, "sent", within_s=_LIMIT_S)
        received = _expect(group, subscribers)
    published = fan.count + 1
    lost = dict.fromkeys(_REASONS, 0)
    for one in received:
        if one["count"] + sum(one["dropped"].values()) != published:
            raise Failure(f"{one['count']} of {published} arrived; dropped: {one['dropped']}")
        for reason, count in one["dropped"].items():
            lost[reason] = lost.get(reason, 0) + count
    delivered = sum(one["count"] for one in received)
    seconds = (max(one["end_ns"] for one in received) - sent["begin_ns"]) / 1e9
    percent = 100 / (published * fan.subscribers)
    return {
        "deliveries_per_s": delivered / seconds,
        "per_s": published / seconds,
        "lost": sum(lost.values()) * percent,
        "cpu_publish_ns": sent["cpu_ns"] / published,
        **{reason: count * percent for reason, count in lost.items()},
    }


def name_of(system: System, number: int) -> str:
    """The row of `system` with `number` subscribers."""
    return f"{number} subscriber{'s' if number > 1 else ''}, {system.name}"


def _case(plan: Plan, system: System, number: int) -> Case:
    # With two CPUs, two subscribers run in parallel; more of them take turns.
    count = system.guess.messages_in(flood_s(plan), _SIZE) // max(1, number // 2)
    # No warm-up if messages may be lost, because its end can't be detected.
    warm_up = 0 if system.may_lose else count // 10
    work = Work(size=_SIZE, count=count, warm_up=warm_up, take_by=system.takes_by, subscribers=number)
    flood = Lasting(partial(measure_flood, system), work, least_s(plan))
    paced = Work(
        size=_SIZE,
        count=plan.choose(150, 500),
        warm_up=25,
        rate=_RATE,
        take_by=system.takes_by,
        gives_turns=PLAIN.get(system.name, system).gives_turns,
        subscribers=number,
    )
    name, measured = name_of(system, number), partial(measure, system, flood, paced)
    rounds = plan.rounds(is_essential=number == _SLOW_NUMBER and system in _FAST)
    if number == max(_GOAL_NUMBERS):
        rounds = max(1, plan.repetitions - 2)  # each takes long
    return Case(name, measured, system.missing(), system.name, number, rounds)


def _lossy_case(system: System, number: int) -> Case:
    fan = Fan(size=_SIZE, count=1_000_000 // max(1, number // 4), subscribers=number)
    name = _lossy_name(system, number)
    series, measured = f"{system.name}, lossy", partial(measure_lossy, system, fan)
    return Case(name, measured, system.missing(), series, number, rounds=1)


def _lossy_name(system: System, number: int) -> str:
    return f"{name_of(system, number)}, lossy"


def _expect(group: Group, subscribers: list[Child]) -> list[Event]:
    return [group.expect(child, "received", within_s=_LIMIT_S) for child in subscribers]


def _look(group: Group, subscribers: list[Child]) -> list[Event]:
    """The arrivals at each subscriber, after all arrivals have stopped."""
    before: list[Event] = []
    while True:
        for child in subscribers:
            child.send("look")
        seen = [group.expect(child, "seen", within_s=_LIMIT_S) for child in subscribers]
        if seen == before:
            return [Event(one, dropped={}) for one in seen]
        before = seen
        sleep(_LOOK_S)
