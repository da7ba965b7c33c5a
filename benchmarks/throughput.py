"""Messages a second from one publisher's process to one subscriber's process, losing none.

The rate is counted from the first publish to the last message taken. CPU time is that of whole processes
over the same time, by the kernel's clock for each process.
"""

from functools import partial
from time import monotonic_ns

import msgspec

from benchmarks.cases import Case, Figures, interleave
from benchmarks.figures import per_100k, ratios
from benchmarks.harness import Failure, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Row, Section, compare
from benchmarks.systems import BUS, System
from benchmarks.work import Work, text_of
from bus.msg.std_msgs import String

NAME = "throughput"
GOAL_PER_S = 1_000_000
_LIMIT_S = 60.0
_KiB = 1024

_COUNTS = {64: (300_000, 2_000_000), _KiB: (150_000, 1_000_000), 64 * _KiB: (8_000, 40_000)}
_COUNTS[_KiB * _KiB] = (600, 3_000)

_COLUMNS = [
    Column("per_s", "messages/s"),
    Column("bytes_per_s", "bytes/s"),
    Column("cpu_publisher", "CPU s per 100k: publisher"),
    Column("cpu_broker", "broker"),
    Column("cpu_subscriber", "subscriber"),
]
_NOTES = [
    "reliable + keep all, String: a new message object for each publish, a str in the subscriber's hands; "
    "every run checked: all arrived, none dropped",
    "by publish: publish(), and send() where it says that there is no room; by send: await send() each time",
    "codec alone: construct, encode and decode the same messages in one process, with nothing in between",
]


def run(plan: Plan) -> Section:
    """Measure every size with a callback and with `async for`."""
    cases = []
    for size, counts in _COUNTS.items():
        work = Work(size=size, count=plan.choose(*counts), warm_up=plan.choose(*counts) // 10)
        cases.append(Case(f"{_bytes(size)}, codec alone", partial(measure_codec, work)))
        ways = [("publish", "callback"), ("publish", "async for")]
        ways += [("send", "callback")] if size == 64 else []
        for publish_by, take_by in ways:
            name = f"{_bytes(size)}, by {publish_by}, {take_by}"
            exact = msgspec.structs.replace(work, publish_by=publish_by, take_by=take_by)
            cases.append(Case(name, partial(measure, BUS, exact)))
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"throughput {text}"))
    best = outcomes["64 B, by publish, callback"].repetitions
    alone = outcomes["64 B, codec alone"].repetitions
    comparisons = compare(
        "64 B, messages/s, callback", [one["per_s"] for one in best], at_least=GOAL_PER_S
    ) + compare("64 B, callback, as a part of codec alone", ratios(best, alone, "per_s"))
    rows = [Row.of(outcomes[case.name]) for case in cases]
    title = "Throughput: publisher -> busd -> subscriber, lossless"
    return Section(NAME, title, _COLUMNS, rows, comparisons, _NOTES)


def measure(system: System, work: Work) -> Figures:
    """One flood. Raises Failure where it did not come to its end, or lost something."""
    with Group() as group:
        servers = system.start_servers(group)
        subscriber = system.start_role(group, "subscriber", work)
        publisher = system.start_role(group, "publisher", work)
        publisher.tell("warm_up")
        group.expect(subscriber, "warm", within_s=_LIMIT_S)
        before_ns = [child.cpu_ns() for child in (publisher, subscriber, *servers)]
        publisher.tell("go")
        begin_ns = int(group.expect(publisher, "sent", within_s=_LIMIT_S)["begin_ns"])
        received = group.expect(subscriber, "received", within_s=_LIMIT_S)
        after_ns = [child.cpu_ns() for child in (publisher, subscriber, *servers)]
    expected = work.warm_up + work.count
    if received["count"] != expected or received["dropped"]:
        raise Failure(f"{received['count']} of {expected} arrived; dropped: {received['dropped']}")
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


def _bytes(size: int) -> str:
    for unit, factor in (("MiB", _KiB**2), ("KiB", _KiB)):
        if size >= factor:
            return f"{size // factor} {unit}"
    return f"{size} B"
