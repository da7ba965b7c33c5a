"""`python -m benchmarks.fleet`: measures many buses on one machine, each with a bridge and some topics.

It measures the time until every bus shows all topics of all others, and the load of the bridges until then
and after that. It prints a table of the growth of both with buses and topics, for docs/bridge.md. It is not
part of `make bench`: one machine runs all buses, so the times depend on its CPUs.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from statistics import mean
from time import monotonic, sleep
from typing import Literal, NamedTuple, get_args

from benchmarks import paced
from benchmarks.adapters.bridging import Crowd
from benchmarks.bridge import count_endpoints, start_worker
from benchmarks.bridged import free_port, missing, start_bridge
from benchmarks.harness import Child, Failure, Group
from benchmarks.machine import look_at_machine
from bus_cli.query import Query

Shape = Literal["mesh", "star", "router", "groups"]
"""Mesh: each bridge connects to all others. Star: all connect to the bridge of one bus, which forwards
(`transit`). Router: all use a router of zenoh. Groups: the same, with the first bus as the operator: the
others see only it."""
_TRANSIT = '[[bridge.zenoh.topics]]\npattern = "/**"\ntransit = true\n'
_PREFIX = "/fleet"
_LIMIT_S, _LOOK_S = 240.0, 0.1
_SETTLE_S, _WATCH_S = 3.0, 5.0
_SMALL = ((2, 50), (5, 50), (10, 50), (10, 25), (10, 100))
_LARGE = (20, 50)


class Found(NamedTuple):
    """The figures of one fleet. MiB and percent are per bridge, and so are CPU seconds, until all was
    mirrored."""

    shape: Shape
    buses: int
    topics: int
    there_s: float
    cpu_s: float
    mib: float
    most_mib: float
    idle_percent: float


class Fleet:
    """A number of buses, from bus_0 on, each with a bridge."""

    def __init__(self, group: Group, shape: Shape, buses: int) -> None:
        self.group = group
        few = buses if shape != "groups" else min(buses, 2)
        self._seen = [buses if number == 0 else few for number in range(buses)]
        """For each bus, the number of buses whose topics it shows, including itself."""
        self.names = [f"bus_{number}" for number in range(buses)]
        self.bridges = [*self._join(shape)]

    def _join(self, shape: Shape) -> Iterator[Child]:
        endpoints = [f"tcp/127.0.0.1:{free_port()}" for _ in self.names]
        config = self.group.folder / "bridge.toml"
        config.write_text(_TRANSIT)
        if shape in ("router", "groups"):
            command = (sys.executable, "-m", "benchmarks.adapters.zenoh_router", endpoints[0])
            self.group.start("router", *command)
        for number, name in enumerate(self.names):
            words = ["--id", name]
            match shape:
                case "mesh":
                    words += ["--listen", endpoints[number]]
                    words += [word for one in endpoints[:number] for word in ("--connect", one)]
                case "star" if number == 0:
                    words += ["--config", str(config), "--listen", endpoints[0]]
                case "star":
                    words += ["--connect", endpoints[0]]
                case "router" | "groups":
                    words += ["--router", endpoints[0]]
            if shape == "groups":
                words += ["--group", "robots", "--see", "operators"] if number else ["--group", "operators"]
            self.group.start_busd(name=name)  # it ends soon without a client
            yield start_bridge(self.group, "zenoh", *words, name=f"bridge_{number}", bus=name)

    def wait_until_all_have(self, topics: int) -> None:
        """Wait until every bus shows `topics` topics of each bus that it sees. Raises Failure."""
        end = monotonic() + _LIMIT_S
        waiting = {name: topics * self._seen[number] for number, name in enumerate(self.names)}
        while waiting:
            if monotonic() > end:
                raise Failure(f"after {_LIMIT_S:g} s these buses lack topics: {', '.join(waiting)}")
            sleep(_LOOK_S)
            for name, wanted in sorted(waiting.items()):  # stop at the first unready bus: queries cost time
                with Query(self.group.folder / f"{name}.sock", may_start=False) as query:
                    if count_endpoints(query, _PREFIX) < wanted:
                        break
                del waiting[name]


def measure(shape: Shape, buses: int, topics: int) -> Found:
    """Measure the start of a fleet. Raises Failure."""
    with Group() as group:
        fleet = Fleet(group, shape, buses)
        crowds = [
            start_worker(
                group, "crowd", Crowd(topics, f"{_PREFIX}/{name}", both=False), bus=name, name=f"crowd_{name}"
            )
            for name in fleet.names
        ]
        fleet.wait_until_all_have(0)
        sleep(_SETTLE_S)
        before_ns = [bridge.cpu_ns() for bridge in fleet.bridges]
        began = monotonic()
        for crowd in crowds:
            crowd.send("go")
        fleet.wait_until_all_have(topics)
        there_s = monotonic() - began
        used = [bridge.cpu_ns() - before for bridge, before in zip(fleet.bridges, before_ns, strict=True)]
        sleep(_SETTLE_S)
        idle = _cpu_percent_of_all(fleet.bridges)
        memory = [paced.memory_mib(bridge) for bridge in fleet.bridges]
    return Found(shape, buses, topics, there_s, mean(used) / 1e9, mean(memory), max(memory), max(idle))


def _cpu_percent_of_all(children: Sequence[Child]) -> list[float]:
    began, before_ns = monotonic(), [child.cpu_ns() for child in children]
    sleep(_WATCH_S)
    took_s = monotonic() - began
    return [
        (child.cpu_ns() - before) / 1e7 / took_s for child, before in zip(children, before_ns, strict=True)
    ]


def table(found: Sequence[Found]) -> str:
    """The figures as a table in Markdown."""
    lines = [
        "| joined by | buses | topics each | mirrors on each bus | s until all are there "
        "| CPU s of a bridge for that | MiB of a bridge (the largest) | CPU % of a bridge, then |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for one in found:
        mirrors = f"{(one.buses - 1) * one.topics:,}"
        if one.shape == "groups":
            mirrors = f"{one.topics:,} (the first: {mirrors})"
        lines.append(
            f"| {one.shape} | {one.buses} | {one.topics} | {mirrors} | {one.there_s:.1f} | {one.cpu_s:.2f} "
            f"| {one.mib:.0f} ({one.most_mib:.0f}) | {one.idle_percent:.1f} |"
        )
    return "\n".join(lines)


def main() -> int:
    """Measure; returns 0, or 1 if a measurement failed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fleet", description=__doc__)
    parser.add_argument("--shape", choices=get_args(Shape), action="append", help="(default: all)")
    parser.add_argument("--buses", type=int, metavar="N", help="one fleet of so many (default: several)")
    parser.add_argument("--topics", type=int, default=50, metavar="N", help="of each of --buses")
    parser.add_argument("--quick", action="store_true", help="no fleet of 20")
    options = parser.parse_args()
    if reason := missing("zenoh"):
        print(reason)
        return 1
    sizes = (
        ((options.buses, options.topics),)
        if options.buses
        else (*_SMALL, *(() if options.quick else (_LARGE,)))
    )
    print(look_at_machine().describe(), flush=True)
    found, code = [], 0
    for shape in options.shape or get_args(Shape):
        for buses, topics in sizes:
            try:
                found.append(measure(shape, buses, topics))
            except Failure as failure:
                print(f"{shape}, {buses} buses, {topics} topics: failed: {failure}", flush=True)
                code = 1
            else:
                print(found[-1], flush=True)
    print(f"\n{table(found)}")
    return code


if __name__ == "__main__":
    sys.exit(main())
