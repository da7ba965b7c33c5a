"""The cost of a matched system without work: CPU time and wake-ups of all its processes.

Measures busd with five processes and twenty topics, and one publisher and one subscriber of each system, all
of them at the same time, because they are idle. It uses the kernel's clock, and for busd also the ticks that
`top` shows.
"""

import os
from contextlib import ExitStack
from pathlib import Path
from time import monotonic, sleep
from typing import NamedTuple

import msgspec

from benchmarks.adapters.idling import Place
from benchmarks.cases import Figures, Outcome
from benchmarks.harness import START_S, Child, Failure, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Row, Section, compare
from benchmarks.systems import BUS, BUS_SOCKET, NATS, REDIS, RIVALS, System
from benchmarks.work import Work

NAME = "idle"
_PROCESSES, _TOPICS_EACH = 5, 4
MANY = f"busd, {_PROCESSES} processes, {_PROCESSES * _TOPICS_EACH} topics"
_PAIR = Work(size=64, count=0, warm_up=0, rate=1.0)
"""Without messages: systems that are idle for long use their default settings."""
_SETTLE_S = 1.5
_QUICK_RIVALS = (NATS, REDIS)
_UTIME, _STIME = 13, 14  # indices in /proc/<pid>/stat, from 0

_COLUMNS = [
    Column("us_per_s", "µs CPU/s: all", "lower"),
    Column("server_us_per_s", "server", "lower"),
    Column("wakeups_per_s", "wake-ups/s: all", "lower"),
    Column("server_wakeups_per_s", "server", "lower"),
    Column("processes", "processes"),
]


class Reading(NamedTuple):
    """The resources that a process has used so far."""

    ticks: int
    cpu_ns: int
    wakeups: int


class Watched(NamedTuple):
    """The processes of a system; the servers come first."""

    servers: list[Child]
    others: list[Child]


def run(plan: Plan) -> Section:
    """Measure idle systems."""
    seconds = plan.choose(3, 15)
    systems = [BUS, BUS_SOCKET, *(_QUICK_RIVALS if plan.quick else RIVALS)]
    outcomes = {MANY: Outcome(MANY)}
    outcomes |= {one.name: Outcome(one.name, missing=one.missing(), series=one.name) for one in systems}
    plan.tell(NAME)
    measure(outcomes, systems, seconds)
    ticks = [one["ticks"] for one in outcomes[MANY].repetitions]
    notes = [
        f"over {seconds} s, from {_SETTLE_S:g} s after the last message; where nothing else is said, of a "
        "publisher and a subscriber that are matched and of which nothing is asked, and of the server",
        f"a tick is {1000 / os.sysconf('SC_CLK_TCK'):g} ms; what is left of busd is the heartbeat",
    ]
    rows = [Row.of(outcome) for outcome in outcomes.values()]
    comparisons = compare(f"{MANY}: ticks of all processes", ticks, at_most=0.0)
    title = "Idle: systems that have nothing to do"
    return Section(NAME, title, _COLUMNS, rows, comparisons, notes)


def measure(
    outcomes: dict[str, Outcome], systems: list[System], seconds: float, *, settle_s: float = _SETTLE_S
) -> None:
    """Start all systems, let them settle, measure them for `seconds`, and add the figures to `outcomes`."""
    with ExitStack() as stack:
        watched: dict[str, Watched] = {}
        for name, outcome in outcomes.items():
            if outcome.missing:
                continue
            system = next((one for one in systems if one.name == name), None)
            group = stack.enter_context(Group())
            try:
                watched[name] = start_many(group) if system is None else start_pair(group, system)
            except Failure as error:
                outcome.failure = str(error)
        sleep(settle_s)
        began, before = monotonic(), _read_all(watched, outcomes)
        sleep(seconds)
        watched_s, after = monotonic() - began, _read_all(watched, outcomes)
    for name, late in after.items():
        used = [
            Reading(*(new - old for old, new in zip(*pair, strict=True)))
            for pair in zip(before[name], late, strict=True)
        ]
        outcomes[name].repetitions.append(_figures(used, len(watched[name].servers), watched_s))


def start_many(group: Group) -> Watched:
    """Start busd and some processes with some topics each; all topics have been used."""
    busd, clients = group.start_busd(), []
    for index in range(_PROCESSES):
        place = msgspec.json.encode(Place(index, _PROCESSES, _TOPICS_EACH)).decode()
        clients.append(group.start_python(f"client_{index}", "-m", "benchmarks.adapters.idling", place))
    for client in clients:
        group.expect(client, "ready", within_s=START_S)
    return Watched([busd], clients)


def start_pair(group: Group, system: System) -> Watched:
    """Start a publisher and a subscriber that are matched."""
    servers = system.start_servers(group)
    work = msgspec.structs.replace(_PAIR, take_by=system.takes_by)
    return Watched(servers, list(system.start_pair(group, work)))


def read(child: Child) -> Reading:
    """Sums over all threads of a process. Raises Failure if it has ended."""
    folder = Path("/proc") / str(child.pid)
    try:
        # The second field is the program's name and may contain blanks.
        fields = (folder / "stat").read_text().rpartition(")")[2].split()
        wakeups = sum(_wakeups_of(task) for task in (folder / "task").iterdir())
    except OSError:
        raise Failure(child.describe_end()) from None
    return Reading(int(fields[_UTIME - 2]) + int(fields[_STIME - 2]), child.cpu_ns(), wakeups)


def _wakeups_of(task: Path) -> int:
    try:
        lines = (task / "status").read_text().splitlines()
    except (FileNotFoundError, ProcessLookupError):
        return 0  # a thread that has ended
    return next((int(line.split()[1]) for line in lines if line.startswith("voluntary_")), 0)


def _read_all(watched: dict[str, Watched], outcomes: dict[str, Outcome]) -> dict[str, list[Reading]]:
    """Readings of each system that still runs."""
    readings = {}
    for name, (servers, others) in watched.items():
        try:
            readings[name] = [read(child) for child in (*servers, *others)]
        except Failure as error:
            outcomes[name].failure = str(error)
    return readings


def _figures(used: list[Reading], servers: int, seconds: float) -> Figures:
    found = {"processes": float(len(used)), "ticks": float(sum(one.ticks for one in used))}
    for key, part in (("", used), ("server_", used[:servers])):
        found[f"{key}us_per_s"] = sum(one.cpu_ns for one in part) / 1e3 / seconds
        found[f"{key}wakeups_per_s"] = sum(one.wakeups for one in part) / seconds
    return found
