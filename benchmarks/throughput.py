"""Messages a second from one publisher's process to one subscriber's process, losing none.

The rate is counted from the first publish to the last message taken. CPU time is that of whole processes
over the same time, by the kernel's clock for each process.
"""

from functools import partial
from time import monotonic_ns

import msgspec

from benchmarks.cases import Case, Figures, interleave
from benchmarks.figures import bytes_text, per_100k, ratios
from benchmarks.harness import Failure, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Comparison, Row, Section, compare
from benchmarks.systems import BUS, BUS_SOCKET, PYZMQ, System
from benchmarks.work import Work, text_of
from bus.msg.std_msgs import String

NAME = "throughput"
_LIMIT_S = 60.0
_KiB = 1024

_COUNTS = {64: (300_000, 3_000_000), _KiB: (150_000, 1_500_000), 64 * _KiB: (8_000, 60_000)}
_COUNTS[_KiB * _KiB] = (400, 3_000)
_GOALS = [
    # system, size, figure, at least
    (BUS, 64, "per_s", 3e6),
    (BUS, _KiB, "per_s", 1.5e6),
    (BUS, 64 * _KiB, "bytes_per_s", 3e9),
    (BUS_SOCKET, 64, "per_s", 1e6),
]

COLUMNS = [
    Column("per_s", "messages/s"),
    Column("bytes_per_s", "bytes/s"),
    Column("cpu_publisher", "CPU s per 100k: publisher"),
    Column("cpu_broker", "broker"),
    Column("cpu_subscriber", "subscriber"),
]
_NOTES = [
    "reliable + keep all, String: a new message object for each publish, a str in the subscriber's hands; "
    "every run checked: all arrived, none dropped",
    "publish(), and send() where it says that there is no room; send: await send() each time; with a "
    "callback where nothing else is said",
    "codec alone: construct, encode and decode the same messages in one process, with nothing in between",
]


def run(plan: Plan) -> Section:
    """Measure every size by both routes."""
    cases = []
    for size, counts in _COUNTS.items():
        count = plan.choose(*counts)
        work = Work(size=size, count=count, warm_up=count // 10, publish_by="publish", take_by="callback")
        text = bytes_text(size)
        cases.append(Case(f"{text}, codec alone", partial(measure_codec, work)))
        cases += [case(f"{text}, {system.name}", system, work) for system in (BUS, BUS_SOCKET)]
        if size == 64:
            iterating = msgspec.structs.replace(work, take_by="async for")
            sending = msgspec.structs.replace(work, publish_by="send")
            cases.append(case(f"{text}, {BUS.name}, async for", BUS, iterating))
            cases.append(case(f"{text}, {BUS.name}, send", BUS, sending))
            cases.append(case(f"{text}, {BUS_SOCKET.name}, async for", BUS_SOCKET, iterating))
        if size <= _KiB:
            cases.append(case(f"{text}, {PYZMQ.name}", PYZMQ, work))
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    comparisons: list[Comparison] = []
    for system, size, key, goal in _GOALS:
        name = f"{bytes_text(size)}, {system.name}"
        found = outcomes[name].repetitions
        unit = "bytes/s" if key == "bytes_per_s" else "messages/s"
        comparisons += compare(f"{name}, {unit}", [one[key] for one in found], at_least=goal)
        alone = outcomes[f"{bytes_text(size)}, codec alone"].repetitions
        comparisons += compare(f"{name}, as a part of codec alone", ratios(found, alone, "per_s"))
    rows = [Row.of(outcomes[case.name]) for case in cases]
    return Section(NAME, "Throughput: String, lossless, 1 to 1", COLUMNS, rows, comparisons, _NOTES)


def case(name: str, system: System, work: Work) -> Case:
    """A line of a table: `work` done by `system`."""
    return Case(name, partial(measure, system, work), system.missing())


def measure(system: System, work: Work) -> Figures:
    """One flood. Raises Failure where it did not come to its end, or lost something."""
    with Group() as group:
        servers = system.start_servers(group)
        publisher, subscriber = system.start_pair(group, work)
        publisher.tell("warm_up")
        group.expect(subscriber, "warm", within_s=_LIMIT_S)
        before_ns = [child.cpu_ns() for child in (publisher, subscriber, *servers)]
        publisher.tell("go")
        begin_ns = int(group.expect(publisher, "sent", within_s=_LIMIT_S)["begin_ns"])
        received = group.expect(subscriber, "received", within_s=_LIMIT_S)
        after_ns = [child.cpu_ns() for child in (publisher, subscriber, *servers)]
    if received["count"] != work.total or received["dropped"]:
        raise Failure(f"{received['count']} of {work.total} arrived; dropped: {received['dropped']}")
    seconds = (received["end_ns"] - begin_ns) / 1e9
    cpu_s = [(after - before) / 1e9 for before, after in zip(before_ns, after_ns, strict=True)]
    return {
        "per_s": work.count / seconds,
        "bytes_per_s": work.count * work.size / seconds,
        "cpu_publisher": per_100k(cpu_s[0], work.count),
        "cpu_subscriber": per_100k(cpu_s[1], work.count),
        "cpu_broker": per_100k(sum(cpu_s[2:]), work.count),
    }


def measure_codec(work: Work) -> Figures:
    """What can't be saved by any transport: a message object made, encoded and decoded, here."""
    encode, decode = msgspec.msgpack.Encoder().encode, msgspec.msgpack.Decoder(String).decode
    text = text_of(work.size)
    begin_ns = monotonic_ns()
    for _ in range(work.count):
        decode(encode(String(data=text)))
    seconds = (monotonic_ns() - begin_ns) / 1e9
    return {"per_s": work.count / seconds, "bytes_per_s": work.count * work.size / seconds}
