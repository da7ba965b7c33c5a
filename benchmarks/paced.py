"""One paced stream from process to process: how long each message took, and what CPU time.

Shared by the benchmarks of latency and of cost.
"""

import msgspec

from benchmarks.cases import Case, Figures
from benchmarks.figures import per_100k, percentiles
from benchmarks.harness import START_S, Group
from benchmarks.report import Column
from benchmarks.systems import System
from benchmarks.work import Arrivals, Work

LATENCY_COLUMNS = [
    Column("p50", "µs: p50"),
    Column("p90", "p90"),
    Column("p99", "p99"),
    Column("p99.9", "p99.9"),
    Column("max", "max"),
    Column("due_p99", "since due: p99"),
    Column("late_p50", "sender late: p50"),
    Column("cpu", "CPU s per 100k"),
]
LATENCY_NOTES = [
    "one way, by CLOCK_MONOTONIC in the message; warm-up left out; percentiles are of each repetition; the "
    "scheduler chooses the CPUs",
    "the schedule is fixed: a message that could not be sent when it was due is sent late, and its delay "
    "counts in `since due`, which is the age from when it should have been sent",
]


def case(name: str, system: System, work: Work) -> Case:
    """A line of a table: `work` done by `system`."""
    return Case(name, lambda: measure(system, work), system.missing())


def measure(system: System, work: Work) -> Figures:
    """Do it once. Raises Failure where it did not come to its end."""
    with Group() as group:
        servers = system.start_servers(group)
        publisher, subscriber = system.start_pair(group, work)
        children = (publisher, subscriber, *servers)
        before_ns = [child.cpu_ns() for child in children]
        publisher.tell("go")
        limit_s = 2 * work.total / work.rate + START_S
        group.expect(subscriber, "complete", within_s=limit_s)
        after_ns = [child.cpu_ns() for child in children]
        subscriber.tell("report")
        event = group.expect(subscriber, "received", within_s=START_S)
    cpu_s = [(after - before) / 1e9 for before, after in zip(before_ns, after_ns, strict=True)]
    return summary(msgspec.convert(event, Arrivals)) | {
        "cpu": per_100k(sum(cpu_s), work.total),
        "cpu_publisher": per_100k(cpu_s[0], work.total),
        "cpu_subscriber": per_100k(cpu_s[1], work.total),
        "cpu_broker": per_100k(sum(cpu_s[2:]), work.total),
    }


def summary(found: Arrivals) -> Figures:
    """Percentiles in µs."""
    due_ns = [late + age for late, age in zip(found.late_ns, found.age_ns, strict=True)]
    return (
        percentiles(found.age_ns, scale=1e-3)
        | percentiles(due_ns, prefix="due_", scale=1e-3)
        | percentiles(found.late_ns, prefix="late_", scale=1e-3)
    )
