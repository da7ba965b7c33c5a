"""What an idle system costs: busd and five processes with twenty topics, all matched, nothing published.

By the ticks of /proc/<pid>/stat, which is what `top` shows, and finer by the kernel's clock and the wake-ups.
"""

import os
from pathlib import Path
from time import monotonic, sleep
from typing import NamedTuple

import msgspec

from benchmarks.adapters.idling import Place
from benchmarks.cases import Case, Figures, interleave
from benchmarks.harness import START_S, Child, Failure, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Row, Section, compare

NAME = "idle"
_PROCESSES, _TOPICS_EACH = 5, 4
_SETTLE_S = 1.5
_UTIME, _STIME = 13, 14  # of /proc/<pid>/stat, counted from 0

_COLUMNS = [
    Column("busd_ticks", "busd: ticks"),
    Column("busd_us_per_s", "µs CPU/s"),
    Column("busd_wakeups_per_s", "wake-ups/s"),
    Column("clients_ticks", "all clients: ticks"),
    Column("clients_us_per_s", "µs CPU/s"),
    Column("clients_wakeups_per_s", "wake-ups/s"),
]


class Reading(NamedTuple):
    """What a process has used so far."""

    ticks: int
    cpu_ns: int
    wakeups: int


def run(plan: Plan) -> Section:
    """Watch an idle system."""
    seconds = plan.choose(6, 20)
    name = f"{_PROCESSES} processes, {_PROCESSES * _TOPICS_EACH} topics"
    outcomes = interleave(
        [Case(name, lambda: measure(seconds))],
        plan.choose(1, 3),
        lambda text: plan.tell(f"idle {text}"),
    )
    found = outcomes[name].repetitions
    ticks = [one["busd_ticks"] + one["clients_ticks"] for one in found]
    notes = [
        f"over {seconds} s, from {_SETTLE_S:g} s after the last message; "
        f"a tick is {1000 / os.sysconf('SC_CLK_TCK'):g} ms; what is left is the heartbeat"
    ]
    comparisons = compare("ticks of all six processes", ticks, at_most=0.0)
    return Section(
        NAME,
        "Idle: CPU of a system that has nothing to do",
        _COLUMNS,
        [Row.of(outcomes[name])],
        comparisons,
        notes,
    )


def measure(seconds: float, *, settle_s: float = _SETTLE_S) -> Figures:
    """Start the system, let it settle, and watch it for so long. Raises Failure where it does not start."""
    with Group() as group:
        busd = group.start_busd()
        clients = []
        for index in range(_PROCESSES):
            place = msgspec.json.encode(Place(index, _PROCESSES, _TOPICS_EACH)).decode()
            clients.append(group.start_python(f"client_{index}", "-m", "benchmarks.adapters.idling", place))
        for client in clients:
            group.expect(client, "ready", within_s=START_S)
        sleep(settle_s)
        before = [read(child) for child in (busd, *clients)]
        began = monotonic()
        sleep(seconds)
        watched_s = monotonic() - began
        after = [read(child) for child in (busd, *clients)]
    used = [
        Reading(*(late - early for early, late in zip(one, other, strict=True)))
        for one, other in zip(before, after, strict=True)
    ]
    return _figures("busd", used[:1], watched_s) | _figures("clients", used[1:], watched_s)


def read(child: Child) -> Reading:
    """Raises Failure where the process is gone."""
    folder = Path("/proc") / str(child.pid)
    try:
        # The second field is the program's name and may have blanks in it.
        fields = (folder / "stat").read_text().rpartition(")")[2].split()
        status = (folder / "status").read_text()
    except OSError:
        raise Failure(child.describe_end()) from None
    wakeups = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("voluntary_"))
    return Reading(int(fields[_UTIME - 2]) + int(fields[_STIME - 2]), child.cpu_ns(), wakeups)


def _figures(who: str, used: list[Reading], seconds: float) -> Figures:
    return {
        f"{who}_ticks": float(sum(one.ticks for one in used)),
        f"{who}_us_per_s": sum(one.cpu_ns for one in used) / 1e3 / seconds,
        f"{who}_wakeups_per_s": sum(one.wakeups for one in used) / seconds,
    }
