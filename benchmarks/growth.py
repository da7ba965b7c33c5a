"""Growth of the cost of a message with the size of the system, and of an endpoint with their number.

Each series varies one number: topics, nodes, subscriptions of a topic, messages a second, endpoints.
"""

from functools import partial
from typing import NamedTuple

import msgspec

from benchmarks.adapters.growing import Load
from benchmarks.cases import Case, Figures, Outcome, interleave
from benchmarks.figures import percentiles, ratios
from benchmarks.goals import reached
from benchmarks.harness import START_S, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Comparison, Row, Section, compare
from benchmarks.systems import BUS, BUS_SOCKET, System

NAME = "growth"
_ADAPTER = "benchmarks.adapters.growing"
_PROCESSES = 4
_ENDPOINTS = "endpoints of a process"
_COLUMNS = [
    Column("cpu", "CPU µs per delivery: all", "lower"),
    Column("p50", "µs: p50", "lower"),
    Column("p99", "p99", "lower"),
    Column("cpu_publisher", "CPU µs per message: publisher", "lower"),
    Column("cpu_broker", "broker", "lower"),
    Column("cpu_subscriber", "CPU µs per delivery: subscribers", "lower"),
    Column("endpoint_us", "µs per endpoint", "lower"),
    Column("endpoint_cpu", "CPU µs per endpoint", "lower"),
]
_NOTES = [
    "String of 64 B, one topic, node and subscription in each process and 1,000 messages/s, but for what "
    "grows; the messages go over the topics in turn; nodes have a topic each",
    "a ratio of 1 says that a message (a delivery, an endpoint) costs the same, however many there are",
    "at a low rate each message finds processes asleep and caches cold, and nothing shares its wake-ups",
    f"{_ENDPOINTS}: publishers and then the subscriptions to them, of the default QoS, each awaited, "
    "until all are matched; CPU time is that of the process and of busd",
]


class Step(NamedTuple):
    """One point: the varied number `at`, the `system`, and its work."""

    what: str
    at: int
    system: System
    load: Load

    @property
    def series(self) -> str:
        return f"{self.what}: {self.system.name}"

    @property
    def name(self) -> str:
        return f"{self.at} {self.series}"


def steps(plan: Plan) -> list[Step]:
    """All steps; a quick run only has the smallest and the largest of each kind by shared memory."""
    change = partial(msgspec.structs.replace, Load())
    grown = {
        "topics": {at: change(topics=at) for at in (1, 10, 100, 1000)},
        "nodes": {at: change(topics=at, nodes=at) for at in (1, 10, 50)},
        "subscriptions of a process": {at: change(subscriptions=at) for at in (1, 4, 16, 64)},
        f"subscriptions of {_PROCESSES} processes": {
            at: change(subscriptions=at, processes=_PROCESSES) for at in (4, 16, 64)
        },
        "messages/s": {at: change(rate=float(at)) for at in (100, 1000, 5000, 20_000)},
        _ENDPOINTS: {at: change(endpoints=at) for at in (10, 100, 1000)},
    }
    found = []
    for system in (BUS,) if plan.quick else (BUS, BUS_SOCKET):
        for what, loads in grown.items():
            chosen = (min(loads), max(loads)) if plan.quick else loads
            found += [Step(what, at, system, loads[at]) for at in chosen]
    return found


def run(plan: Plan) -> Section:
    """Measure each step; a step that is shared by several kinds is measured once."""
    todo = steps(plan)
    cases: dict[tuple[str, Load], Case] = {}
    for step in todo:
        measured = partial(measure_endpoints if step.load.endpoints else measure, step.system, step.load)
        case = Case(step.name, measured, step.system.missing())
        cases.setdefault((step.system.name, step.load), case)
    found = interleave(list(cases.values()), plan.choose(1, 2), lambda text: plan.tell(f"{NAME} {text}"))
    outcomes = [(step, found[cases[step.system.name, step.load].name]) for step in todo]
    rows = [
        msgspec.structs.replace(Row.of(outcome), name=step.name, series=step.series, at=step.at)
        for step, outcome in outcomes
    ]
    title = "Growth: what a message and an endpoint cost where there are many"
    goals = reached(NAME, {step.name: outcome for step, outcome in outcomes})
    return Section(NAME, title, _COLUMNS, rows, [*goals, *_compare(outcomes)], _NOTES, "how many")


def measure(system: System, load: Load) -> Figures:
    """One paced stream. Raises Failure if it did not end."""
    system = system._replace(module=_ADAPTER)
    with Group() as group:
        servers = system.start_servers(group)
        subscribers = [
            system.launch(group, "subscriber", load, name=f"subscriber_{index}")
            for index in range(load.processes)
        ]
        publisher = system.start_role(group, "publisher", load)
        for child in subscribers:
            group.expect(child, "ready", within_s=START_S)
        publisher.send("warm_up")
        for child in subscribers:
            group.expect(child, "warm", within_s=START_S)
        children = (publisher, *servers, *subscribers)
        before_ns = [child.cpu_ns() for child in children]
        publisher.send("go")
        for child in subscribers:
            group.expect(child, "complete", within_s=2 * load.seconds + START_S)
        cpu_us = [(child.cpu_ns() - before) / 1e3 for child, before in zip(children, before_ns, strict=True)]
        ages_ns: list[int] = []
        for child in subscribers:
            child.send("report")
            ages_ns += group.expect(child, "received", within_s=START_S)["age_ns"]
    of_servers, of_subscribers = sum(cpu_us[1 : 1 + len(servers)]), sum(cpu_us[1 + len(servers) :])
    return percentiles(ages_ns, scale=1e-3) | {
        "cpu": sum(cpu_us) / len(ages_ns),
        "cpu_publisher": cpu_us[0] / load.count,
        "cpu_broker": of_servers / load.count,
        "cpu_subscriber": of_subscribers / len(ages_ns),
    }


def measure_endpoints(system: System, load: Load) -> Figures:
    """Declarations of one process, one after the other. Raises Failure if they did not end."""
    system = system._replace(module=_ADAPTER)
    with Group() as group:
        servers = system.start_servers(group)
        children = (*servers, system.start_role(group, "declarer", load))
        before_ns = [child.cpu_ns() for child in children]
        children[-1].send("go")
        took_ns = group.expect(children[-1], "declared", within_s=START_S)["took_ns"]
        cpu_ns = sum(child.cpu_ns() - before for child, before in zip(children, before_ns, strict=True))
    return {
        "endpoint_us": took_ns / 1e3 / load.endpoints,
        "endpoint_cpu": cpu_ns / 1e3 / load.endpoints,
    }


def _compare(outcomes: list[tuple[Step, Outcome]]) -> list[Comparison]:
    """Compare the largest step of each kind with the smallest."""
    series: dict[str, list[tuple[Step, Outcome]]] = {}
    for step, outcome in outcomes:
        series.setdefault(step.series, []).append((step, outcome))
    comparisons = []
    for name, found in series.items():
        (least, few), (most, many) = found[0], found[-1]
        keys = {"endpoint_us": "time per endpoint"}
        if not least.load.endpoints:
            keys = {"cpu": "CPU per delivery", "p50": "p50"}
        for key, text in keys.items():
            values = ratios(many.repetitions, few.repetitions, key)
            goal = 1.5 if least.load.endpoints else None
            comparisons += compare(f"{name}, {most.at} / {least.at}: {text}", values, at_most=goal)
    return comparisons
