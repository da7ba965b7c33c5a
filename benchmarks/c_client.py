"""Programs in C at both ends: busd's client for C, rivals' libraries for C, and the barest programs.

Paced messages and floods, one publisher and one subscriber. All wait for events. The programs are in
benchmarks/c.
"""

import os
from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

from benchmarks import paced, throughput
from benchmarks.adapters import c_program
from benchmarks.cases import Case, Outcome, interleave
from benchmarks.plan import Plan
from benchmarks.report import Column, Comparison, Row, Section
from benchmarks.servers import serve_roudi
from benchmarks.systems import BUS, BUS_SOCKET, C_FLOOR, C_SOCKET, Speed, System, by_c, no_c_program
from benchmarks.versus import against, against_best
from benchmarks.work import Work
from bus_cli.bench.figures import bytes_text

NAME = "c_client"


_SMALL, _LARGE = 64, 1 << 20
_STREAMS = {
    _SMALL: paced.Stream(1000, 200, (500, 5000)),
    1 << 16: paced.Stream(1000, 100, (300, 3000)),
    _LARGE: paced.Stream(200, 20, (60, 1000)),
}
_FLOOD = "flood"
_PINNED = "on two CPUs"


def _ours(system: System, name: str, way: str, guess: Speed) -> System:
    environ = MappingProxyType({**system.environ, **by_c("busd", way)})
    missing = partial(_both, system.missing, "busd")
    return system._replace(
        name=f"busd in C, {name}",
        module=c_program.__name__,
        environ=environ,
        missing=missing,
        fans_out=False,
        guess=guess,
    )


def _both(missing: Callable[[], str], program: str) -> str:
    return missing() or no_c_program(program)


def _rival(name: str, program: str, way: str, guess: Speed) -> System:
    return C_FLOOR._replace(
        name=name,
        environ=by_c(program, way),
        missing=partial(_missing, program),
        kind="direct",
        guess=guess,
    )


def _missing(program: str) -> str:
    packages = {"zeromq": "libzmq3-dev", "iceoryx": "libiceoryx-binding-c-dev and iceoryx"}
    return no_c_program(program) and f"it needs {packages[program]}: {no_c_program(program)}"


RING = _ours(BUS, "shared memory", "ring", Speed(8_000_000, 20e9))
VIEWED = _ours(BUS, "shared memory, viewed", "viewed", Speed(8_000_000, 20e9))
SOCKET = _ours(BUS_SOCKET, "socket", "socket", Speed(500_000, 1.5e9))
ZMQ = _rival("libzmq", "zeromq", "ipc", Speed(3_000_000, 2e9))
ICEORYX = _rival("iceoryx, copied", "iceoryx", "copied", Speed(1_000_000, 10e9))._replace(serve=serve_roudi)
ICEORYX_VIEWED = ICEORYX._replace(name="iceoryx, viewed", environ=by_c("iceoryx", "viewed"))
SYSTEMS = (RING, VIEWED, SOCKET, C_FLOOR, C_SOCKET, ZMQ, ICEORYX, ICEORYX_VIEWED)

_COLUMNS = [
    Column("p50", "µs: p50", "lower"),
    Column("p90", "p90", "lower"),
    Column("p99", "p99", "lower"),
    Column("cpu", "CPU s per 100k", "lower"),
    Column("per_s", "messages/s", "higher"),
    Column("bytes_per_s", "bytes/s", "higher"),
]
_NOTES = [
    *paced.LATENCY_NOTES,
    "each publisher has the bytes in its memory and puts them into the system; each subscriber copies them "
    "out of shared memory into its own; viewed: it reads the beginning only, in shared memory; by a socket, "
    "the bytes are its own copy",
    "flood: lossless, at full speed; all arrived",
    f"{_PINNED}: publisher and subscriber were put there; else the scheduler chooses",
    "eCAL and zenoh have no package with headers for C that this machine can install: they are measured from "
    "Python only",
]


def run(plan: Plan) -> Section:
    """Measure all systems at all sizes."""
    sizes = [size for size in _STREAMS if not plan.quick or size != 1 << 16]
    cases = [case for size in sizes for case in _cases(plan, size)]
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    comparisons = [one for size in sizes for one in _compare(outcomes, size)]
    rows = [Row.of(outcomes[case.name]) for case in cases]
    title = "Programs in C: paced messages and floods, 1 to 1"
    return Section(NAME, title, _COLUMNS, rows, comparisons, _NOTES, "size in B")


def _cases(plan: Plan, size: int) -> list[Case]:
    stream = _STREAMS[size]
    work = Work(size=size, count=plan.choose(*stream.counts), warm_up=stream.warm_up, rate=stream.rate)
    cases = [paced.case(system.name, system, work) for system in SYSTEMS]
    if size == _SMALL and not plan.quick:
        cpus = sorted(os.sched_getaffinity(0))[:2]
        pinned = [paced.case(f"{one.name}, {_PINNED}", one, work, cpus) for one in SYSTEMS]
        cases += [one if len(cpus) == 2 else one._replace(missing="there is one CPU only") for one in pinned]
    seconds = throughput.least_s(plan)
    for system in SYSTEMS:
        flood = throughput.work_of(plan, system.guess, size)
        case = throughput.case(f"{_FLOOD}, {system.name}", system, flood, seconds)
        cases.append(case)
    return cases


def _compare(outcomes: Mapping[str, Outcome], size: int) -> list[Comparison]:
    def named(system: System, how: str = "") -> str:
        return f"{bytes_text(size)}, {how}{system.name}"

    found: list[Comparison] = []
    limit = 1.3 if size == _SMALL else None
    for where in ("", f", {_PINNED}"):
        ours, bare = named(RING) + where, named(C_FLOOR) + where
        found += against(outcomes, ours, bare, "p50", at_most=limit)
        rivals = [named(rival) + where for rival in (ZMQ, ICEORYX)]
        for key in ("p50", "cpu"):
            found += against_best(outcomes, ours, rivals, key, at_most=1.0)
        lent = named(VIEWED) + where, named(ICEORYX_VIEWED) + where
        found += against(outcomes, *lent, "p50", at_most=1.0)
    flooded = [named(rival, f"{_FLOOD}, ") for rival in (ZMQ, ICEORYX)]
    found += against_best(
        outcomes, named(RING, f"{_FLOOD}, "), flooded, "per_s", at_least=1.0, what="messages/s"
    )
    return found
