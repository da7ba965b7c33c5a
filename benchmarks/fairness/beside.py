"""The effect of a neighbour on a paced pair: by socket and by shared memory, in the same minute."""

import os
import sys
from time import monotonic

import msgspec

from benchmarks.adapters.hostile.attack import Attack
from benchmarks.cases import Figures
from benchmarks.fairness.neighbours import Neighbour
from benchmarks.figures import percentiles
from benchmarks.harness import START_S, Child, Group
from benchmarks.systems import BUS, BUS_SOCKET, System
from benchmarks.work import Arrivals, Work

RATE = 1000.0
_WARM_UP = 100
_DEPTH_BY_SOCKET = 20_000
"""Enough messages for a long pause of busd, so the pair by socket still measures its length."""
_DEPTH_BY_MEMORY = 1000
"""The ring has this size before the neighbour starts, because a ring only grows with the help of busd."""
_ADAPTER = "benchmarks.adapters.hostile"
_PREFIXES = {BUS_SOCKET.name: "socket_", BUS.name: "shm_"}


def pairs(seconds: float) -> list[tuple[System, Work]]:
    """The pair by socket, and the pair by shared memory, if it is available, for half the time."""
    work = Work(size=64, count=int(RATE * seconds), warm_up=_WARM_UP, rate=RATE, take_by=BUS.takes_by)
    found = [(BUS_SOCKET, msgspec.structs.replace(work, topic="by_socket", depth=_DEPTH_BY_SOCKET))]
    if not BUS.missing():
        grown = {"depth": _DEPTH_BY_MEMORY, "prefill": _DEPTH_BY_MEMORY, "count": work.count // 2}
        found.append((BUS, msgspec.structs.replace(work, topic="by_memory", **grown)))
    return found


def why_not(neighbour: Neighbour) -> str:
    """The reason why a neighbour can't be measured here; empty if it can."""
    if neighbour.rules and os.geteuid() != 0:
        return "only root can be another user"
    needs_memory = any(one.kind in ("shared memory", "rings") for one in neighbour.attacks)
    return BUS.missing() if needs_memory else ""


def measure(neighbour: Neighbour, seconds: float, program: str = "") -> Figures:
    """Measure once, with the busd of `program`. Raises Failure if it does not end.

    The pairs exist all the time, and exchange messages one after the other.
    """
    with Group() as group:
        busd = _start_busd(group, neighbour.rules, program)
        found = [(*_start_pair(group, system, work), system, work) for system, work in pairs(seconds)]
        pinger = group.start_python("pinger", "-m", "benchmarks.adapters.pinging")
        group.expect(pinger, "ready", within_s=START_S)
        _longest_ms(group, pinger)
        attackers = [start_attack(group, index, one) for index, one in enumerate(neighbour.attacks)]
        for child in attackers:
            group.expect(child, "ready", within_s=2 * START_S)
            _report(group, child)
        watched = (busd, *attackers)
        begin_s, before_ns = monotonic(), [child.cpu_ns() for child in watched]
        for publisher, subscriber, _, work in found:
            publisher.send("go")
            group.expect(subscriber, "complete", within_s=2 * work.total / work.rate + 2 * START_S)
        elapsed_s = monotonic() - begin_s
        used_ns = [child.cpu_ns() - before for child, before in zip(watched, before_ns, strict=True)]
        figures = {"silence": _longest_ms(group, pinger), "busd_cpu": used_ns[0] / 1e7 / elapsed_s}
        if attackers:
            done = [_report(group, child) for child in attackers]
            figures["neighbour_cpu"] = sum(used_ns[1:]) / 1e7 / elapsed_s
            figures["asked_per_s"] = sum(asked for asked, _ in done) / elapsed_s
            figures["refused_per_s"] = sum(refused for _, refused in done) / elapsed_s
        for _, subscriber, system, _ in found:
            subscriber.send("report")
            event = group.expect(subscriber, "received", within_s=START_S)
            ages_ns = msgspec.convert(event, Arrivals).age_ns
            figures |= percentiles(ages_ns, prefix=_PREFIXES[system.name], scale=1e-6)
    return figures


def start_attack(group: Group, index: int, attack: Attack) -> Child:
    """Start one neighbour without waiting for it."""
    # It may use any route, whatever the pair uses.
    environ = {"BUS_ROUTE": ""}
    text = msgspec.json.encode(attack).decode()
    return group.start(f"neighbour_{index}", sys.executable, "-m", _ADAPTER, text, environ=environ)


def _start_busd(group: Group, rules: str, program: str) -> Child:
    if not rules:
        return group.start_busd(program)
    group.folder.chmod(0o711)  # other users must reach the socket
    config = group.folder / "busd.toml"
    config.write_text(rules)
    return group.start_busd(program, "--config", str(config))


def _start_pair(group: Group, system: System, work: Work) -> tuple[Child, Child]:
    """Start a pair; returns the publisher and the subscriber."""
    group.environ["BUS_ROUTE"] = system.environ.get("BUS_ROUTE", "")
    name = system.route
    subscriber = system.start_role(group, "subscriber", work, name=f"subscriber_{name}")
    publisher = system.start_role(group, "publisher", work, name=f"publisher_{name}")
    if work.prefill:
        group.expect(subscriber, "warm", within_s=START_S)
    return publisher, subscriber


def _report(group: Group, child: Child) -> tuple[int, int]:
    """The neighbour's counters since the last call."""
    child.send("report")
    event = group.expect(child, "flooded", within_s=2 * START_S)
    return event["asked"], event["refused"]


def _longest_ms(group: Group, pinger: Child) -> float:
    """The longest silence of busd since the last call."""
    pinger.send("report")
    return float(group.expect(pinger, "pinged", within_s=2 * START_S)["longest_ms"])
