"""Bridges: their cost beside their transport alone, the cost of many mirrors, and a far side that hangs.

References are plain zenoh, plain cyclonedds and ROS 2's own rclpy on the same loopback, and busd alone. A
message from bus to bus uses both. So the limit for its latency is the sum of theirs, measured in the same
repetition.
"""

import os
import signal
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from time import monotonic, sleep
from typing import NamedTuple

import msgspec
from msgspec.structs import replace

from benchmarks import camera, paced, throughput
from benchmarks.adapters.bridging import Crowd, Torrent
from benchmarks.bridged import (
    BY_ZENOH,
    FAR,
    FROM_DDS,
    FROM_DDS_BY_RTPS,
    FROM_ROS,
    NUMBERED_ZENOH,
    PLAIN_DDS,
    PLAIN_ZENOH,
    SYSTEMS,
    TO_DDS,
    TO_DDS_BY_RTPS,
    TO_ROS,
    missing,
    serve_two,
    serve_with_ros,
    without_ros,
)
from benchmarks.cases import Case, Figures, Outcome, interleave
from benchmarks.figures import percentiles
from benchmarks.harness import START_S, Child, Failure, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Comparison, Row, Section, compare
from benchmarks.systems import BUS, RCLPY, ROS, System
from benchmarks.versus import against
from benchmarks.work import IMAGE, Work
from bus_cli.bench.figures import bytes_text
from bus_cli.query import Query

NAME = "bridge"
_MODULE = "benchmarks.adapters.bridging"
_ROUNDS = 3
_SMALL, _LONG, _LARGE = 64, 64 << 10, 1 << 20
_LATENCY, _FLOOD, _IMAGES, _CALLS = "latency", "lossless", "images", "calls"
_ENDPOINTS = 500
_CROWD, _HANG = f"{_ENDPOINTS} mirrored endpoints", "the far bridge hangs"
_CROWD_OF_ROS, _CROWD_TO_ROS = f"{_CROWD} of ROS 2", f"{_CROWD} to ROS 2"
_FRAME = Work(size=320 * 240 * 3, count=1, warm_up=10, rate=30.0, subscribers=1, publish_by=IMAGE)
_TORRENT = Torrent("/torrent", 32 << 10, 1000.0)
_CROWD_LIMIT_S, _WATCH_S = 60.0, (2, 5)
_HANGS_S = (3, 10)
_CALLS_LIMIT_S = 60.0
_LOOK_S = 0.02
_COLUMNS = [
    Column("p50", "us: p50", "lower"),
    Column("p99", "p99", "lower"),
    Column("lost", "lost %", "lower"),
    Column("per_s", "messages/s", "higher"),
    Column("bytes_per_s", "bytes/s", "higher"),
    Column("cpu", "CPU s per 100k: all", "lower"),
    Column("cpu_broker", "busd and bridges", "lower"),
    Column("there_s", "s: all there", "lower"),
    Column("idle_percent", "CPU %: the busier bridge, then", "lower"),
    Column("grown_mib", "MiB: what the bridge grows by", "lower"),
]
_NOTES = [
    f"{PLAIN_ZENOH.name}, {PLAIN_DDS.name}: no bus at all, by TCP and UDP on loopback, reliable, blocking "
    "where there is no room; the bridges' zenoh goes by TCP on loopback too",
    f"{NUMBERED_ZENOH.name}: with the attachment that each message of ROS 2 has by zenoh, read by its taker: "
    "publisher, number, time; a message of busd has these too",
    f"{BUS.name}: both programs on one bus, as it stands at each end of {BY_ZENOH.name}",
    f"{TO_DDS_BY_RTPS.name}, {FROM_DDS_BY_RTPS.name}: the bridge with its own RTPS instead of cyclonedds",
    "lossless: reliable + keep all at both ends; every run checked: all arrived, none dropped",
    f"{TO_ROS.name}, {FROM_ROS.name}: the same program of rclpy at both ends, on busd's facade and on ROS 2, "
    "with the bridge between them; Fast DDS has receive buffers of 4 MiB, as docs/bridge.md advises",
    f"{_IMAGES}: 320 x 240 RGB at {_FRAME.rate:g} Hz, sensor_msgs/Image with the profile for sensor data "
    "(best effort, keep last 5), to one reader; a lost image has no latency",
    f"{_CALLS}: GetParameterTypes by rclpy, one after the other, from the call to its result; the first name "
    "is the client's",
    f"{_CROWD}: from the word to begin, to a process that is there, until the other bus has all of them; "
    "then: a second later, without messages; the same of ROS 2: made by rclpy, until "
    "the bus has all; to ROS 2: made on the bus, until a program of rclpy sees all their topics",
    f"{_HANG}: SIGSTOP, while {bytes_text(_TORRENT.size)} are published {_TORRENT.rate:,.0f} times a second",
]


class _Stream(NamedTuple):
    systems: Sequence[System]
    rate: float
    counts: tuple[int, int]


_OF_ROS = (ROS, RCLPY, TO_ROS, FROM_ROS)
_STREAMS = {
    _SMALL: _Stream((*SYSTEMS, *_OF_ROS), 1000.0, (1_000, 4_000)),
    _LARGE: _Stream((PLAIN_ZENOH, NUMBERED_ZENOH, BUS, BY_ZENOH, *_OF_ROS), 100.0, (100, 400)),
}
_FLOODS = {_SMALL: SYSTEMS, _LONG: (PLAIN_ZENOH, NUMBERED_ZENOH, BUS, BY_ZENOH)}


def run(plan: Plan) -> Section:
    """Measure the rivals, busd alone, and the bridges."""
    cases: list[Case] = []
    for size, stream in _STREAMS.items():
        work = Work(
            size=size, count=plan.choose(*stream.counts), warm_up=int(2 * stream.rate), rate=stream.rate
        )
        cases += [_paced(system, work) for system in stream.systems]
    for size, systems in _FLOODS.items():
        cases += [_flood(plan, system, size) for system in systems]
    frames = replace(_FRAME, count=plan.choose(30, 150), gives_turns=False)
    cases += [
        Case(_name(_IMAGES, system, _FRAME.size), partial(camera.measure, system, frames), system.missing())
        for system in _OF_ROS
    ]
    calls = plan.choose(100, 1000)
    cases += [
        Case(f"{_CALLS}, {system.name}", partial(measure_calls, system, calls), system.missing())
        for system in _OF_ROS
    ]
    bridges = missing("zenoh")
    crowd = partial(measure_crowd, Crowd(_ENDPOINTS, "/crowd"), plan.choose(*_WATCH_S))
    cases.append(Case(_CROWD, crowd, bridges))
    for name, is_theirs in ((_CROWD_OF_ROS, True), (_CROWD_TO_ROS, False)):
        crowd = partial(measure_crowd_of_ros, Crowd(_ENDPOINTS, "/crowd"), plan.choose(*_WATCH_S), is_theirs)
        cases.append(Case(name, crowd, without_ros()))
    cases.append(Case(_HANG, partial(measure_hang, _TORRENT, plan.choose(*_HANGS_S)), bridges))
    repetitions = min(plan.repetitions, _ROUNDS)
    outcomes = interleave(cases, repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    rows = [Row.of(outcomes[case.name]) for case in cases]
    title = "Bridges: between two buses, and to DDS"
    return Section(NAME, title, _COLUMNS, rows, comparisons(outcomes), _NOTES)


def comparisons(outcomes: Mapping[str, Outcome]) -> list[Comparison]:
    """The ratios that the bridges should reach."""
    found: list[Comparison] = []
    found += _against_both(outcomes, BY_ZENOH, PLAIN_ZENOH, buses=2)
    large = _name(_LATENCY, BY_ZENOH, _LARGE)
    found += against(outcomes, large, _name(_LATENCY, PLAIN_ZENOH, _LARGE), "p50", at_most=1.0)
    for size, key, what in ((_SMALL, "per_s", "messages/s"), (_LONG, "bytes_per_s", "bytes/s")):
        ours, theirs = (_name(_FLOOD, system, size) for system in (BY_ZENOH, PLAIN_ZENOH))
        found += against(outcomes, ours, theirs, key, at_least=0.6, what=what)
        numbered = _name(_FLOOD, NUMBERED_ZENOH, size)
        found += against(outcomes, ours, numbered, key, what=what)
    for system in (TO_DDS, FROM_DDS, TO_DDS_BY_RTPS, FROM_DDS_BY_RTPS):
        found += _against_both(outcomes, system, PLAIN_DDS, buses=1)
        ours, theirs = (_name(_FLOOD, one, _SMALL) for one in (system, PLAIN_DDS))
        found += against(outcomes, ours, theirs, "per_s", at_least=0.5, what="messages/s")
    for system in (TO_ROS, FROM_ROS):
        found += _against_both(outcomes, system, ROS, buses=1)
        for kind, size in ((_LATENCY, _LARGE), (_IMAGES, _FRAME.size)):
            found += against(outcomes, _name(kind, system, size), _name(kind, ROS, size), "p50")
        found += against(outcomes, f"{_CALLS}, {system.name}", f"{_CALLS}, {ROS.name}", "p50")
    for name, key, what, goal in (
        (_CROWD_OF_ROS, "there_s", "s until they are there", 10.0),
        (_CROWD_TO_ROS, "there_s", "s until they are there", 10.0),
        (_CROWD, "there_s", "s until they are there", 10.0),
        (_CROWD, "idle_percent", "CPU % of the busier bridge then", 1.0),
        (_HANG, "grown_mib", "MiB that the near one grows by", 100.0),
    ):
        held = outcomes[name].repetitions if name in outcomes else []
        found += compare(f"{name}: {what}", [one[key] for one in held], at_most=goal)
    return found


def _against_both(
    outcomes: Mapping[str, Outcome], ours: System, theirs: System, *, buses: int
) -> list[Comparison]:
    """The p50 relative to the sum of the transport's and of `buses` times busd's, in each repetition."""
    names = [_name(_LATENCY, system, _SMALL) for system in (ours, theirs, BUS)]
    if any(name not in outcomes for name in names):
        return []
    values = [
        our["p50"] / (their["p50"] + buses * bus["p50"])
        for our, their, bus in zip(*(outcomes[name].repetitions for name in names), strict=False)
    ]
    parts = f"{theirs.name} + {buses} x {BUS.name}"
    return compare(f"{names[0]} / ({parts}), p50", values, at_most=1.4)


def measure_calls(system: System, count: int) -> Figures:
    """The time of calls of a service. The system's publisher is the client. Raises Failure."""
    words = ("-m", "benchmarks.adapters.round_trips", "call")
    with Group() as group:
        system.start_servers(group)
        runners = {"server": system.runner, "client": system.publisher_runner or system.runner}
        for role, runner in runners.items():
            child = group.start(role, *runner, *words, role, str(count), stop_signal=signal.SIGTERM)
            group.expect(child, "ready", within_s=START_S)
        child.send("go")
        taken = group.expect(child, "taken", within_s=_CALLS_LIMIT_S)
    return percentiles(taken["ns"], scale=1e-3)


def measure_crowd(crowd: Crowd, watch_s: float) -> Figures:
    """The time until a crowd's endpoints are on the other bus, and the load of the bridges after that."""
    with Group() as group:
        *_, far_bridge, near_bridge = serve_two(group, "")
        child = start_worker(group, "crowd", crowd)
        far = group.folder / f"{FAR}.sock"
        wait_for_mirrors(far, crowd.prefix, 0)
        child.send("go")
        began = monotonic()
        wait_for_mirrors(far, crowd.prefix, crowd.endpoints)
        there_s = monotonic() - began
        sleep(1)
        used = [cpu_percent(one, watch_s) for one in (near_bridge, far_bridge)]
    return {"there_s": there_s, "idle_percent": max(used)}


def measure_crowd_of_ros(crowd: Crowd, watch_s: float, is_theirs: bool) -> Figures:
    """As `measure_crowd`, with programs of ROS 2 on the other side. `is_theirs`: they make the crowd."""
    words = (*ROS.runner, "-m", "benchmarks.adapters.crowd_rclpy")
    shape = msgspec.json.encode(crowd).decode()
    with Group() as group:
        _, bridge = serve_with_ros(group)
        theirs = group.start("theirs", *words, "crowd" if is_theirs else "watch", shape)
        group.expect(theirs, "ready", within_s=START_S)
        ours = theirs if is_theirs else start_worker(group, "crowd", crowd)
        ours.send("go")
        began = monotonic()
        if is_theirs:
            wait_for_mirrors(group.folder / "busd.sock", crowd.prefix, crowd.endpoints)
        else:
            group.expect(theirs, "all", within_s=_CROWD_LIMIT_S)
        there_s = monotonic() - began
        sleep(1)
        return {"there_s": there_s, "idle_percent": cpu_percent(bridge, watch_s)}


def measure_hang(torrent: Torrent, hangs_s: float) -> Figures:
    """The growth of the near bridge while the far one is stopped, and messages continue."""
    with Group() as group:
        *_, far_bridge, near_bridge = serve_two(group, "")
        sink = start_worker(group, "sink", torrent, bus=FAR)
        child = start_worker(group, "torrent", torrent)
        child.send("go")
        group.expect(sink, "flows", within_s=START_S)
        before = paced.memory_mib(near_bridge)
        os.kill(far_bridge.pid, signal.SIGSTOP)
        try:
            end, most = monotonic() + hangs_s, before
            while monotonic() < end:
                sleep(_LOOK_S * 10)
                most = max(most, paced.memory_mib(near_bridge))
        finally:
            os.kill(far_bridge.pid, signal.SIGCONT)
    return {"grown_mib": most - before}


def start_worker(
    group: Group, role: str, what: msgspec.Struct, *, bus: str = "busd", name: str = ""
) -> Child:
    """Start a process of `adapters.bridging` on the bus with that name; returns when it is ready."""
    environ = {"BUSD_SOCKET": str(group.folder / f"{bus}.sock")}
    words = ("-m", _MODULE, role, msgspec.json.encode(what).decode())
    child = group.start(name or role, sys.executable, *words, environ=environ)
    group.expect(child, "ready", within_s=START_S)
    return child


def wait_for_mirrors(path: Path, prefix: str, count: int) -> None:
    """Wait until the bus at `path` has `count` endpoints on topics with that prefix. Raises Failure."""
    end = monotonic() + _CROWD_LIMIT_S
    with Query(path, may_start=False) as query:
        while (found := count_endpoints(query, prefix)) < count:
            if monotonic() > end:
                raise Failure(f"{found} of {count} endpoints are there after {_CROWD_LIMIT_S:g} s")
            sleep(_LOOK_S)


def count_endpoints(query: Query, prefix: str) -> int:
    """The number of endpoints on a bus on topics with that prefix."""
    graph = query.graph()
    return sum(one.topic.startswith(prefix) for one in (*graph.publishers, *graph.subscriptions))


def cpu_percent(child: Child, watch_s: float) -> float:
    """The CPU time of a process over `watch_s`, in percent of one CPU."""
    began, before_ns = monotonic(), child.cpu_ns()
    sleep(watch_s)
    return (child.cpu_ns() - before_ns) / 1e7 / (monotonic() - began)


def _paced(system: System, work: Work) -> Case:
    work = replace(work, take_by=system.takes_by)
    name = _name(_LATENCY, system, work.size)
    return Case(name, partial(paced.measure, system, work), system.missing(), system.name, work.size)


def _flood(plan: Plan, system: System, size: int) -> Case:
    work = throughput.work_of(plan, system.guess, size, take_by=system.takes_by)
    lasting = throughput.Lasting(partial(throughput.measure, system), work, throughput.least_s(plan))
    return Case(_name(_FLOOD, system, size), lasting, system.missing(), system.name, size)


def _name(kind: str, system: System, size: int) -> str:
    return f"{kind} {bytes_text(size)}, {system.name}"
