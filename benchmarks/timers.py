"""Periodic timers without work: CPU time, missed calls and lateness, of busd, asyncio and rclpy."""

from collections.abc import Callable
from functools import partial

import msgspec

from benchmarks.cases import Case, Figures, interleave
from benchmarks.figures import percentiles, ratios
from benchmarks.harness import START_S, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Comparison, Row, Section, compare
from benchmarks.systems import BUS, RCLPY, ROS, System
from benchmarks.ticks import Calls, Ticks

NAME = "timers"
RATES = (100.0, 1000.0, 2500.0)
_LOOPS = ("uvloop", "asyncio")
_OURS = tuple(f"busd, {loop}" for loop in _LOOPS)
_RCLPY, _GENUINE = RCLPY.name, ROS.name
_TICKING = BUS._replace(module="benchmarks.adapters.ticking", missing=str)
_TICKING_RCLPY = "benchmarks.adapters.ticking_rclpy"
_MOST_CPU, _MOST_LATE_US = 15.0, 100.0
_COLUMNS = [
    Column("per_s", "calls/s", "higher"),
    Column("missed", "% missed", "lower"),
    Column("cpu", "% of a CPU", "lower"),
    Column("late_p50", "µs late: p50", "lower"),
    Column("late_p99", "p99", "lower"),
    Column("late_max", "max", "lower"),
]
_NOTES = [
    "a program whose only work is one timer, which notes the time",
    "busd: `Node.create_timer`; call_later: of the event loop, called anew for each call, for the next "
    "multiple of the period; rclpy: `Node.create_timer` in `rclpy.spin`, on busd and on ROS 2",
    "late: since the call was due; a call that is a whole period late, or more, is the next one, and the one "
    "before is missed",
]


def run(plan: Plan) -> Section:
    """Measure each timer at each rate, in turns."""
    seconds = plan.choose(1, 5)
    cases: list[Case] = []
    for rate in RATES:
        for name, (system, one) in ways(Ticks(rate, seconds)).items():
            measured: Callable[[], Figures] = partial(measure, system, one)
            cases.append(Case(name_of(rate, name), measured, system.missing(), name, rate))
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    found = {name: outcome.repetitions for name, outcome in outcomes.items()}
    rows = [Row.of(outcomes[case.name]) for case in cases]
    title = "Timers: what a periodic call costs, and how late it is"
    return Section(NAME, title, _COLUMNS, rows, _compare(found), _NOTES, "calls/s")


def ways(ticks: Ticks) -> dict[str, tuple[System, Ticks]]:
    """The programs with such a timer, by name."""
    found: dict[str, tuple[System, Ticks]] = {}
    for loop in _LOOPS:
        for way, name in (("bus", f"busd, {loop}"), ("call_later", f"call_later, {loop}")):
            found[name] = _TICKING, msgspec.structs.replace(ticks, way=way, loop=loop)
    for system in (RCLPY, ROS):
        found[system.name] = system._replace(module=_TICKING_RCLPY), ticks
    return found


def name_of(rate: float, name: str) -> str:
    """The row of a system at a rate."""
    return f"{rate:,.0f}/s, {name}"


def measure(system: System, ticks: Ticks) -> Figures:
    """Measure one timer. Raises Failure if it does not end."""
    with Group() as group:
        system.start_servers(group)
        child = system.launch(group, "ticker", ticks)
        event = group.expect(child, "called", within_s=START_S + 2 * ticks.seconds)
    return summary(msgspec.convert(event, Calls), ticks.period_ns)


def summary(calls: Calls, period_ns: int) -> Figures:
    """Calls per second, missed calls and CPU time in percent, lateness in µs.

    Lateness is the time since the call was due. After a whole period, it belongs to the next call, and the
    call before counts as missed.
    """
    numbers = [(at_ns - calls.due_ns) // period_ns for at_ns in calls.at_ns]
    made, due = len(set(numbers)), numbers[-1] - numbers[0] + 1
    late_ns = [(at_ns - calls.due_ns) % period_ns for at_ns in calls.at_ns]
    seconds = (calls.at_ns[-1] - calls.at_ns[0]) / 1e9
    return percentiles(late_ns, prefix="late_", scale=1e-3) | {
        "per_s": (len(calls.at_ns) - 1) / seconds,
        "missed": 100 * (due - made) / due,
        "cpu": 100 * calls.cpu_s / seconds,
    }


def _compare(found: dict[str, list[Figures]]) -> list[Comparison]:
    slow, fast = RATES[0], RATES[-1]
    comparisons = []
    for name in _OURS:
        at_fast, at_slow = name_of(fast, name), name_of(slow, name)
        comparisons += compare(
            f"{at_fast}: % of a CPU", [one["cpu"] for one in found[at_fast]], at_most=_MOST_CPU
        )
        comparisons += compare(f"{at_fast}: % missed", [one["missed"] for one in found[at_fast]], at_most=0.0)
        late = [one["late_p50"] for one in found[at_slow]]
        comparisons += compare(f"{at_slow}: µs late, p50", late, at_most=_MOST_LATE_US)
    for rate in RATES:
        ours, theirs = (found[name_of(rate, name)] for name in (_RCLPY, _GENUINE))
        text = f"{rate:,.0f}/s, {_RCLPY} / {_GENUINE}, CPU"
        comparisons += compare(text, ratios(ours, theirs, "cpu"), at_most=1.0)
    return comparisons
