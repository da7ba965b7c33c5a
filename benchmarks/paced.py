"""One paced stream from process to process: the time of each message, CPU time, memory.

The benchmarks of latency and of cost share this module.
"""

import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import NamedTuple

import msgspec

from benchmarks.cases import Case, Figures
from benchmarks.figures import per_100k, percentiles
from benchmarks.harness import START_S, Child, Failure, Group
from benchmarks.report import Column
from benchmarks.systems import BUS, BUS_PLAIN, BUS_SOCKET, BUS_SOCKET_PLAIN, System
from benchmarks.work import Arrivals, Work
from bus_cli.bench.figures import bytes_text

LATENCY_COLUMNS = [
    Column("p50", "µs: p50", "lower"),
    Column("p90", "p90", "lower"),
    Column("p99", "p99", "lower"),
    Column("p99.9", "p99.9", "lower"),
    Column("max", "max", "lower"),
    Column("due_p99", "since due: p99", "lower"),
    Column("late_p50", "sender late: p50", "lower"),
    Column("cpu", "CPU s per 100k", "lower"),
]
LATENCY_NOTES = [
    "one way, by CLOCK_MONOTONIC in the message; warm-up left out; percentiles are of each repetition",
    "the schedule is fixed: a message that could not be sent when it was due is sent late, and its delay "
    "counts in `since due`, which is the age from when it should have been sent",
]
PARTS = ("publisher", "broker", "subscriber")
"""Parts with separate CPU time and memory: `cpu_publisher`, `mib_publisher`, ..."""
PLAIN = {BUS.name: BUS_PLAIN, BUS_SOCKET.name: BUS_SOCKET_PLAIN}
"""The systems with a plain program as publisher, by the name of the normal system."""
_BUSY = "while True: pass"


class Stream(NamedTuple):
    """The messages a second, and their number in a quick and in a normal run."""

    rate: float
    warm_up: int
    counts: tuple[int, int]


def case(series: str, system: System, work: Work, on_cpus: Sequence[int] = (), rounds: int = 0) -> Case:
    """A row of a table: `work` done by `system`, as the point of `series` at its size."""
    name = f"{bytes_text(work.size)}, {series}"
    measured = partial(measure, system, work, on_cpus)
    return Case(name, measured, system.missing(), series, work.size, rounds)


def measure(
    system: System, work: Work, on_cpus: Sequence[int] = (), *, neighbours: int | None = None
) -> Figures:
    """Measure once. Raises Failure if it did not end.

    Without `on_cpus`, the scheduler chooses the CPUs. With it, the publisher runs on the first, and the
    others run in turns on the next ones. `neighbours` is a number of processes that only use a CPU. If it is
    given, even 0, the figures include context switches of the publisher and the subscriber.
    """
    with Group() as group:
        for number in range(neighbours or 0):
            group.start(f"neighbour_{number}", sys.executable, "-c", _BUSY, stop_signal=signal.SIGTERM)
        servers = system.start_servers(group)
        publisher, subscriber = system.start_pair(group, work)
        children = (publisher, subscriber, *servers)
        if on_cpus:
            for child, place in zip(children, cycle(on_cpus), strict=False):
                put_on(child, place)
        before_ns = [child.cpu_ns() for child in children]
        before_switches = [switches(child) for child in children[:2]]
        publisher.send("go")
        limit_s = 2 * work.total / work.rate + START_S
        group.expect(subscriber, "complete", within_s=limit_s)
        after_ns = [child.cpu_ns() for child in children]
        after_switches = [switches(child) for child in children[:2]]
        mib = [memory_mib(child) for child in children]
        subscriber.send("report")
        event = group.expect(subscriber, "received", within_s=START_S)
    cpu = [
        per_100k((after - before) / 1e9, work.total)
        for before, after in zip(before_ns, after_ns, strict=True)
    ]
    figures = summary(msgspec.convert(event, Arrivals)) | {"cpu": sum(cpu), "mib": sum(mib)}
    for key, found in (("cpu", cpu), ("mib", mib)):
        values = (found[0], sum(found[2:]), found[1])
        figures |= {f"{key}_{part}": value for part, value in zip(PARTS, values, strict=True)}
    if neighbours is None:
        return figures
    for part, before, after in zip(("publisher", "subscriber"), before_switches, after_switches, strict=True):
        figures[f"given_{part}"] = (after[0] - before[0]) / work.total
        figures[f"taken_{part}"] = (after[1] - before[1]) / work.total * 1000
    return figures


def put_on(child: Child, cpu: int) -> None:
    """Run all threads of a process on one CPU only. Raises Failure if that is not possible."""
    try:
        for thread in _threads(child):
            with suppress(ProcessLookupError):  # a thread that has ended: zenoh's come and go
                os.sched_setaffinity(int(thread.name), {cpu})
    except OSError as error:
        raise Failure(f"{child.name} can't be put on CPU {cpu}: {error.strerror}") from None


def switches(child: Child) -> tuple[int, int]:
    """Voluntary and forced context switches of its threads. Raises Failure if it has ended."""
    counts = [0, 0]
    try:
        found = _threads(child)
    except OSError:
        raise Failure(child.describe_end()) from None
    for thread in found:
        try:
            lines = (thread / "status").read_text().splitlines()
        except (FileNotFoundError, ProcessLookupError):  # a thread that has ended: zenoh's come and go
            continue
        for line in lines:
            for place, key in enumerate(("voluntary_ctxt_switches:", "nonvoluntary_ctxt_switches:")):
                if line.startswith(key):
                    counts[place] += int(line.split()[1])
    return counts[0], counts[1]


def _threads(child: Child) -> list[Path]:
    """The folders of its threads in /proc. Each thread may end at any time. Raises OSError if all have
    ended."""
    return list((Path("/proc") / str(child.pid) / "task").iterdir())


def memory_mib(child: Child) -> float:
    """MiB of a process: its own, and its part of shared memory. Raises Failure if it has ended."""
    try:
        lines = (Path("/proc") / str(child.pid) / "smaps_rollup").read_text().splitlines()
    except OSError:
        raise Failure(child.describe_end()) from None
    return next((int(line.split()[1]) for line in lines if line.startswith("Pss:")), 0) / 1024


def summary(found: Arrivals) -> Figures:
    """Percentiles in µs."""
    due_ns = [late + age for late, age in zip(found.late_ns, found.age_ns, strict=True)]
    return (
        percentiles(found.age_ns, scale=1e-3)
        | percentiles(due_ns, prefix="due_", scale=1e-3)
        | percentiles(found.late_ns, prefix="late_", scale=1e-3)
    )
