"""Many at once: a program's matches after a restart of busd, and programs that start in a storm of
connections."""

import sys
from time import monotonic_ns

import msgspec

from benchmarks.adapters.arriving import Programs
from benchmarks.adapters.hostile.attack import Attack
from benchmarks.adapters.returning import Many
from benchmarks.cases import Figures
from benchmarks.fairness.beside import start_attack
from benchmarks.figures import percentiles
from benchmarks.harness import START_S, Group

_LIMIT_S = 60.0
"""The longest wait for a process."""


def come_back(each: int, program: str = "") -> Figures:
    """Kill busd and restart it, beside a program with `each` publishers and as many subscriptions of one
    topic.

    Raises Failure if not all matches are back within a minute.
    """
    many = msgspec.json.encode(Many(each)).decode()
    with Group() as group:
        busd = group.start_busd(program)
        begin_ns = monotonic_ns()
        child = group.start_python("many", "-m", "benchmarks.adapters.returning", many)
        group.expect(child, "ready", within_s=_LIMIT_S)
        declared_ns = monotonic_ns() - begin_ns
        group.kill(busd)
        group.expect(child, "lost", within_s=START_S)
        group.start_busd(program)
        begin_ns = monotonic_ns()
        back = group.expect(child, "back", within_s=_LIMIT_S)
        return {"matched_s": declared_ns / 1e9, "back_s": (back["at_ns"] - begin_ns) / 1e9}


def arrive(programs: Programs, attack: Attack | None, said: set[str], program: str = "") -> Figures:
    """Start programs beside an attack: the number that get in, and their times. Adds the errors of the others
    to `said`."""
    with Group() as group:
        group.start_busd(program)
        text = msgspec.json.encode(programs).decode()
        child = group.start("arriving", sys.executable, "-m", "benchmarks.adapters.arriving", text)
        group.expect(child, "ready", within_s=START_S)
        if attack is not None:
            group.expect(start_attack(group, 0, attack), "ready", within_s=START_S)
        child.send("go")
        events = [group.expect(child, "arrived", within_s=_LIMIT_S) for _ in range(programs.number)]
    said |= {str(one["error"]).replace(str(group.folder), "<folder>") for one in events if one["error"]}
    took_s = [float(one["took_s"]) for one in events if not one["error"]]
    figures = {"got_in": float(len(took_s))}
    return figures | (percentiles(took_s, prefix="arrived_") if took_s else {})
