"""Messages a second from one publisher's process to one subscriber's process, at full speed.

The rate is counted from the first publish to the last message taken. CPU time is the time of whole processes
over the same period, by the kernel's clock for each process. A system that can be lossless must be.
"""

from collections.abc import Callable, Mapping
from functools import partial
from time import monotonic_ns, sleep
from typing import Any

import msgspec
from msgspec.structs import replace

from benchmarks import copying
from benchmarks.cases import Case, Figures, Outcome, interleave
from benchmarks.figures import per_100k, ratios
from benchmarks.goals import reached
from benchmarks.harness import START_S, Child, Failure, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Comparison, Row, Section, compare
from benchmarks.systems import (
    BUS,
    BUS_SOCKET,
    FLOORS,
    ICEORYX,
    PIPE,
    PYZMQ,
    PYZMQ_PROXY,
    RCLPY,
    RIVALS,
    ROS,
    ROS_LARGE,
    TUNED,
    ZENOH,
    Speed,
    System,
    no_c_program,
    tuned,
)
from benchmarks.versus import against, against_best
from benchmarks.work import Work, text_of
from bus.msg.std_msgs import String
from bus_cli.bench.figures import bytes_text

NAME = "throughput"
_LIMIT_S = 30.0
_QUIET_S = 0.3
"""After this time without a message, a lossy subscriber has all messages that it will get."""
_KiB = 1024
_SMALL = 64
_FLOOD_S = (0.3, 1.0)
"""Length of a flood: the approximate one in a quick run, and the least one in a normal run."""
_TRIES, _LONGER, _MOST_LONGER = 3, 1.2, 20.0
"""Number of tries for a flood that was too short, and the factors by which it may be lengthened."""
_GENTLE = 2.0
"""A flood that took more than this factor too long is shortened in the next repetition."""
_CODEC, _COPY = Speed(3_000_000, 3e9), Speed(20_000_000, 20e9)
_CODEC_NAME = "codec alone"
_POLLING, _ICEORYX_POLLING = (f"{system.name}, busy polling" for system in (BUS, ICEORYX))
_BUSY_POLL_S = 0.002
_TUNED_AT = 1 << 20
_TUNED = (BUS, BUS_SOCKET, PIPE, PYZMQ, PYZMQ_PROXY, ICEORYX, ZENOH)
_BY_FACADE = (_SMALL, 1 << 20)
_POLLED = (_SMALL, 64 * _KiB, 1 << 20)
_SEVERAL = {
    _SMALL: (BUS, BUS_SOCKET, PYZMQ, PYZMQ_PROXY, ICEORYX),
    64 * _KiB: (BUS, BUS_SOCKET, PYZMQ_PROXY, ICEORYX),
    1 << 20: (BUS, BUS_SOCKET, PYZMQ_PROXY, ICEORYX),
}
"""Sizes and systems with several rounds, because goals use them."""
_FEW = (BUS, BUS_SOCKET, *FLOORS, PYZMQ, PYZMQ_PROXY, ICEORYX)
"""The systems that are measured at the other sizes."""
_LIMIT_FLOOD_S = 0.5
_GOALS = [
    # system, size, figure, at least
    (BUS, _KiB, "per_s", 1.5e6),
    (BUS, 64 * _KiB, "bytes_per_s", 3e9),
    (BUS_SOCKET, _SMALL, "per_s", 1e6),
]

COLUMNS = [
    Column("per_s", "messages/s", "higher"),
    Column("bytes_per_s", "bytes/s", "higher"),
    Column("lost", "lost %", "lower"),
    Column("cpu", "CPU s per 100k: all", "lower"),
    Column("cpu_publisher", "publisher", "lower"),
    Column("cpu_broker", "broker", "lower"),
    Column("cpu_subscriber", "subscriber", "lower"),
]
_NOTES = [
    "reliable + keep all, String: a new message object for each publish, a str in the subscriber's hands; "
    "every run is checked: all arrived, none dropped. Of a system that can't be lossless, the messages that "
    "arrived count",
    "publish(), and send() if publish() returns that there is no room; send: await send() each time. The "
    "subscriber has a callback, unless the row names another way. The floods of all systems take at least "
    "the same time, with different numbers of messages",
    "codec alone: construct, encode and decode the same messages in one process, with nothing in between; "
    "the C programs hand over bytes, and make no str of them",
    "best rival: of the systems that lost nothing, the one with the best median; polling systems are "
    "compared with polling ones, event-driven ones with event-driven ones",
    f"{TUNED}, and busd, rclpy, and rclpy, Fast DDS: as for latency",
]


def run(plan: Plan) -> Section:
    """Measure all systems at the sizes of the plan."""
    cases = [case for size in plan.sizes for case in _cases(plan, size)]
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    comparisons = reached(NAME, outcomes)
    comparisons += [one for size in plan.sizes for one in _compare(outcomes, size)]
    rows = [Row.of(outcomes[case.name]) for case in cases]
    return Section(NAME, "Throughput: String, 1 to 1", COLUMNS, rows, comparisons, _NOTES, "size in B")


def case(series: str, system: System, work: Work, seconds: float = 0.0, rounds: int = 0) -> Case:
    """A row of a table: `work` done by `system`, as the point of `series` at its size."""
    name = f"{bytes_text(work.size)}, {series}"
    measured = Lasting(partial(measure, system), work, seconds)
    return Case(name, measured, system.missing(), series, work.size, rounds)


class Lasting:
    """A flood that is measured again with more messages if it was too short.

    The speed of a system on this machine is only a guess at first. Later repetitions use the measured speed.
    """

    def __init__(self, measure_it: Callable[[Work], Figures], work: Work, seconds: float) -> None:
        self._measure = measure_it
        self._work = work
        self._seconds = seconds

    def __call__(self) -> Figures:
        """Raises Failure if the measurement does."""
        for _ in range(_TRIES):
            found = self._measure(self._work)
            times = _LONGER * self._seconds / found["seconds"]
            is_long_enough = found["seconds"] >= self._seconds
            if not is_long_enough or found["seconds"] > _GENTLE * self._seconds > 0:
                count = max(1, int(self._work.count * min(times, _MOST_LONGER)))
                self._work = replace(self._work, count=count)
            if is_long_enough:
                break
        return found


def least_s(plan: Plan) -> float:
    """The least time of a flood; a shorter one is measured again. 0 in a quick run."""
    return 0.0 if plan.quick else flood_s(plan)


def flood_s(plan: Plan) -> float:
    """The approximate time of a flood."""
    return _FLOOD_S[not plan.quick]


def work_of(plan: Plan, speed: Speed, size: int, **ways: Any) -> Work:
    """A flood that takes about as long as other systems' floods."""
    count = speed.messages_in(_LONGER * flood_s(plan), size)
    return replace(Work(size=size, count=count, warm_up=max(8, count // 10), take_by="callback"), **ways)


def copying_case(plan: Plan, size: int) -> Case:
    """The limit for every system that copies."""
    measure_it = partial(copying.measure_copying, size, _COPY.messages_in(_LIMIT_FLOOD_S, size))
    return Case(
        f"{bytes_text(size)}, {copying.NAME}", measure_it, no_c_program("copying"), copying.NAME, size
    )


def _cases(plan: Plan, size: int) -> list[Case]:
    count = _CODEC.messages_in(_LIMIT_FLOOD_S, size)
    codec = partial(measure_codec, Work(size=size, count=count, warm_up=0))
    several = [system.name for system in _SEVERAL.get(size, ())]
    few, seconds = plan.rounds(is_essential=False), least_s(plan)
    cases = [Case(f"{bytes_text(size)}, {_CODEC_NAME}", codec, "", _CODEC_NAME, size, few)]
    ways: list[tuple[str, System, dict[str, Any]]] = [
        (system.name, system, {"take_by": system.takes_by})
        for system in ((BUS, BUS_SOCKET, *FLOORS, *RIVALS) if size in _SEVERAL else _FEW)
        if system.floods and size <= system.largest
    ]
    if size == _TUNED_AT and not plan.quick:
        ways += [(one.name, one, {"take_by": one.takes_by}) for one in map(tuned, _TUNED)]
    if size in _POLLED:
        ways.append((_POLLING, BUS, {"busy_poll_s": _BUSY_POLL_S}))
        ways.append((_ICEORYX_POLLING, ICEORYX, {"take_by": "polling"}))
    if size == _SMALL and not plan.quick:
        ways.append((f"{BUS.name}, async for", BUS, {"take_by": "async for"}))
        ways.append((f"{BUS.name}, send", BUS, {"publish_by": "send"}))
    if size in _BY_FACADE and not plan.quick:
        ways.append((RCLPY.name, RCLPY, {}))
    if size == _BY_FACADE[-1] and not plan.quick:
        ways.append((ROS_LARGE.name, ROS_LARGE, {}))
    for series, system, way in ways:
        is_essential = system.name.removesuffix(f", {TUNED}") in several
        rounds = plan.rounds(is_essential=is_essential)
        if is_essential and size == _TUNED_AT:
            rounds = max(1, plan.repetitions - 2)  # there are twice as many
        cases.append(case(series, system, work_of(plan, system.guess, size, **way), seconds, rounds))
    if size > _KiB:
        cases.append(copying_case(plan, size)._replace(rounds=few))
    return cases


def _compare(outcomes: Mapping[str, Outcome], size: int) -> list[Comparison]:
    text = bytes_text(size)
    ours, socket = (f"{text}, {system.name}" for system in (BUS, BUS_SOCKET))
    rivals = [f"{text}, {rival.name}" for rival in RIVALS]
    brokered = [f"{text}, {rival.name}" for rival in RIVALS if rival.kind == "brokered"]
    goal = 3.0 if size == _SMALL else 1.0
    found: list[Comparison] = []
    for end in ("", f", {TUNED}"):
        theirs, theirs_by_socket = ([f"{rival}{end}" for rival in some] for some in (rivals, brokered))
        found += against_best(outcomes, ours + end, theirs, "per_s", at_least=goal, what="messages/s")
        found += against_best(
            outcomes, socket + end, theirs_by_socket, "per_s", at_least=1.0, what="messages/s"
        )
    found += against(
        outcomes,
        f"{text}, {_POLLING}",
        f"{text}, {_ICEORYX_POLLING}",
        "per_s",
        at_least=1.0,
        what="messages/s",
    )
    for genuine in (ROS, ROS_LARGE):
        facade, theirs_name = f"{text}, {RCLPY.name}", f"{text}, {genuine.name}"
        found += against(outcomes, facade, theirs_name, "per_s", at_least=1.0, what="messages/s")
    alone = outcomes[f"{text}, {_CODEC_NAME}"].repetitions
    for name in (ours, socket):
        values = ratios(outcomes[name].repetitions, alone, "per_s")
        found += compare(f"{name}, as a part of {_CODEC_NAME}", values)
    for system, at_size, key, least in _GOALS:
        if at_size == size:
            name, unit = f"{text}, {system.name}", "bytes/s" if key == "bytes_per_s" else "messages/s"
            found += compare(
                f"{name}, {unit}", [one[key] for one in outcomes[name].repetitions], at_least=least
            )
    return found


def measure(system: System, work: Work) -> Figures:
    """One flood. Raises Failure if it did not end, or lost messages that it must not lose."""
    with Group() as group:
        servers = system.start_servers(group)
        children = (*system.start_pair(group, work), *servers)
        publisher, subscriber, *_ = children
        publisher.send("warm_up")
        if system.may_lose:
            early = _settle(group, subscriber, work.warm_up)["count"]
        else:
            group.expect(subscriber, "warm", within_s=_LIMIT_S)
        before_ns = [child.cpu_ns() for child in children]
        publisher.send("go")
        begin_ns = int(group.expect(publisher, "sent", within_s=_LIMIT_S)["begin_ns"])
        if system.may_lose:
            received = _settle(group, subscriber, work.total)
        else:
            received = group.expect(subscriber, "received", within_s=_LIMIT_S)
        after_ns = [child.cpu_ns() for child in children]
    if system.may_lose:
        arrived = received["count"] - early
        if not 0 < arrived <= work.count:
            raise Failure(f"{arrived} of {work.count} arrived")
    elif received["count"] != work.total or received["dropped"]:
        raise Failure(f"{received['count']} of {work.total} arrived; dropped: {received['dropped']}")
    else:
        arrived = work.count
    seconds = (received["end_ns"] - begin_ns) / 1e9
    cpu = [
        per_100k((after - before) / 1e9, arrived) for before, after in zip(before_ns, after_ns, strict=True)
    ]
    return {
        "per_s": arrived / seconds,
        "bytes_per_s": arrived * work.size / seconds,
        "lost": 100 * (work.count - arrived) / work.count,
        "cpu": sum(cpu),
        "cpu_publisher": cpu[0],
        "cpu_subscriber": cpu[1],
        "cpu_broker": sum(cpu[2:]),
        "seconds": seconds,
    }


def _settle(group: Group, subscriber: Child, total: int) -> dict[str, Any]:
    """The subscriber's arrivals: all `total`, or fewer if no more of them have arrived for a while."""
    last = -1
    for _ in range(int(_LIMIT_S / _QUIET_S)):
        subscriber.send("look")
        seen = group.expect(subscriber, "seen", within_s=START_S)
        if seen["count"] >= total or 0 < seen["count"] == last:
            return seen
        last = seen["count"]
        sleep(_QUIET_S)
    raise Failure(f"{last} of {total} arrived within {_LIMIT_S:g} s")


def measure_codec(work: Work) -> Figures:
    """Costs that no transport can save: make a message object, encode and decode it, in this process."""
    encode, decode = msgspec.msgpack.Encoder().encode, msgspec.msgpack.Decoder(String).decode
    text = text_of(work.size)
    begin_ns = monotonic_ns()
    for _ in range(work.count):
        decode(encode(String(data=text)))
    seconds = (monotonic_ns() - begin_ns) / 1e9
    return {"per_s": work.count / seconds, "bytes_per_s": work.count * work.size / seconds}
