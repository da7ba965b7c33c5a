"""One publisher's process to many subscribers' processes, as fast as it goes: deliveries, costs, losses.

Lossless, and with messages that may be lost, where the publisher does not wait for anybody.
"""

from functools import partial

from benchmarks.adapters.bus_fanout import Fan
from benchmarks.cases import Case, Figures, interleave
from benchmarks.figures import ratios
from benchmarks.harness import START_S, Failure, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Comparison, Row, Section, compare
from benchmarks.systems import BUS_FAN_OUT, BUS_SOCKET_FAN_OUT, System

NAME = "fanout"
_SIZE = 64
_NUMBERS = (1, 2, 4, 8, 16)
_LIMIT_S = 120.0
_COUNTS = {True: (100_000, 1_000_000), False: (150_000, 2_000_000)}
_REASONS = ("replaced", "overrun", "publisher_queue", "memory_limit")
_COLUMNS = [
    Column("deliveries_per_s", "deliveries/s"),
    Column("per_s", "published/s"),
    Column("cpu_publish_ns", "publisher, CPU ns per publish"),
    Column("delivered", "delivered %"),
    *(Column(reason, f"{reason} %") for reason in _REASONS),
]
_NOTES = [
    f"String of {_SIZE} B; lossless: reliable + keep all; lossy: best effort, keep last 1,000, and the "
    "publisher never waits, so what can't be taken in time is lost, and all of it is accounted for",
    "deliveries of all subscribers, from the first publish to when the slowest had the last message; the "
    "publisher's CPU time is that of its whole process while it publishes, waiting for room included",
]


def run(plan: Plan) -> Section:
    """Measure 1 to 16 subscribers by shared memory, and some of them by socket."""
    cases = []
    for is_lossless, counts in _COUNTS.items():
        for number in _NUMBERS:
            count = plan.choose(*counts) // max(1, number // 4)
            fan = Fan(size=_SIZE, count=count, subscribers=number, is_lossless=is_lossless)
            cases.append(_case(BUS_FAN_OUT, fan))
            if number in (1, 8):
                cases.append(_case(BUS_SOCKET_FAN_OUT, fan))
    repetitions = plan.choose(1, 3)
    outcomes = interleave(cases, repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    comparisons: list[Comparison] = []
    for is_lossless in _COUNTS:
        found = {number: outcomes[_name(BUS_FAN_OUT, is_lossless, number)].repetitions for number in _NUMBERS}
        kind = _kind(is_lossless)
        deliveries = [one["deliveries_per_s"] for one in found[8]] if is_lossless else []
        comparisons += compare(f"{kind}, 8 subscribers, deliveries/s", deliveries, at_least=4e6)
        values = ratios(found[16], found[1], "cpu_publish_ns")
        goal = None if is_lossless else 1.5
        comparisons += compare(f"{kind}, CPU per publish, 16 subscribers / 1", values, at_most=goal)
    rows = [Row.of(outcomes[case.name]) for case in cases]
    return Section(NAME, "Fan-out: 1 to many", _COLUMNS, rows, comparisons, _NOTES)


def measure(system: System, fan: Fan) -> Figures:
    """One flood. Raises Failure where it did not come to its end, or a message is unaccounted for."""
    with Group() as group:
        system.start_servers(group)
        subscribers = [
            system.start_role(group, "subscriber", fan, name=f"subscriber_{index}")
            for index in range(fan.subscribers)
        ]
        publisher = system.start_role(group, "publisher", fan)
        publisher.tell("go")
        sent = group.expect(publisher, "sent", within_s=_LIMIT_S)
        received = [group.expect(one, "received", within_s=_LIMIT_S + START_S) for one in subscribers]
    published = fan.count + 1
    lost = dict.fromkeys(_REASONS, 0)
    for one in received:
        accounted = one["count"] + sum(one["dropped"].values())
        if accounted != published or (fan.is_lossless and one["dropped"]):
            raise Failure(f"{one['count']} of {published} arrived; dropped: {one['dropped']}")
        for reason, count in one["dropped"].items():
            lost[reason] = lost.get(reason, 0) + count
    delivered = sum(one["count"] for one in received)
    seconds = (max(one["end_ns"] for one in received) - sent["begin_ns"]) / 1e9
    percent = 100 / (published * fan.subscribers)
    return {
        "deliveries_per_s": delivered / seconds,
        "per_s": published / seconds,
        "cpu_publish_ns": sent["cpu_ns"] / published,
        "delivered": delivered * percent,
        **{reason: count * percent for reason, count in lost.items()},
    }


def _case(system: System, fan: Fan) -> Case:
    name = _name(system, fan.is_lossless, fan.subscribers)
    return Case(name, partial(measure, system, fan), system.missing())


def _name(system: System, is_lossless: bool, number: int) -> str:
    return f"{_kind(is_lossless)}, {system.name}, {number}"


def _kind(is_lossless: bool) -> str:
    return "lossless" if is_lossless else "lossy"
