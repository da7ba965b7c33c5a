"""Memory of publishers and subscriptions with the default QoS: KiB, from the growth by many."""

from functools import partial

from benchmarks.adapters.holding import Holding, Usage, usage_of
from benchmarks.cases import Case, Figures, interleave
from benchmarks.harness import START_S, Child, Failure, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Row, Section
from benchmarks.systems import BUS, BUS_SOCKET, System

NAME = "memory"
_NUMBER = 100
_ADAPTER = "benchmarks.adapters.holding"
_STEPS = ("publisher", "subscription, matched", "match, at the publisher")
_COLUMNS = [
    Column("process", "KiB: its process", "lower"),
    Column("shared", "shared memory", "lower"),
    Column("busd", "busd", "lower"),
]
_NOTES = [
    f"growth by {_NUMBER} of the default QoS on as many topics, nothing published, divided by {_NUMBER}; of "
    "a process, the pages that are its own and no shared memory",
    "shared memory as it was reserved: a publisher's ring; a process also has one readers' segment",
]


def run(plan: Plan) -> Section:
    """Measure both routes."""
    cases: list[Case] = []
    rows: list[Row] = []
    for system in (BUS, BUS_SOCKET):
        cases.append(Case(system.name, partial(measure, system), system.missing()))
    outcomes = interleave(cases, plan.choose(1, 3), lambda text: plan.tell(f"{NAME} {text}"))
    for case in cases:
        outcome = outcomes[case.name]
        for step in _STEPS:
            found = [
                {key.removeprefix(f"{step}: "): value for key, value in one.items() if key.startswith(step)}
                for one in outcome.repetitions
            ]
            name = f"{step}, {case.name}"
            part = type(outcome)(name, found, outcome.failure, outcome.missing, case.name)
            rows.append(Row.of(part))
    return Section(NAME, "Memory: what an endpoint costs", _COLUMNS, rows, [], _NOTES)


def measure(system: System) -> Figures:
    """Measure publishers, then subscriptions to them. Raises Failure if one can't be made."""
    holding = Holding(_NUMBER)
    system = system._replace(module=_ADAPTER, route="")
    found: Figures = {}
    with Group() as group:
        (busd,) = system.start_servers(group)
        publisher = system.start_role(group, "publisher", holding)
        before, busd_before = _usage(publisher), _usage(busd)
        _make(group, publisher, "go")
        after, busd_after = _usage(publisher), _usage(busd)
        found |= _growth(_STEPS[0], before, after, busd_before, busd_after)

        subscriber = system.start_role(group, "subscriber", holding)
        before, busd_before, matching = _usage(subscriber), _usage(busd), _usage(publisher)
        _make(group, subscriber, "go")
        _make(group, publisher, "matched")
        after, busd_after = _usage(subscriber), _usage(busd)
        found |= _growth(_STEPS[1], before, after._replace(shared=before.shared), busd_before, busd_after)
        found |= _growth(_STEPS[2], matching, _usage(publisher), busd_after, busd_after)
    return found


def _make(group: Group, child: Child, word: str) -> None:
    child.send(word)
    group.expect(child, "made", within_s=START_S)


def _usage(child: Child) -> Usage:
    try:
        return usage_of(child.pid)
    except OSError:
        raise Failure(child.describe_end()) from None


def _growth(step: str, before: Usage, after: Usage, busd_before: Usage, busd_after: Usage) -> Figures:
    return {
        f"{step}: process": (after.private - before.private) / _NUMBER,
        f"{step}: shared": (after.shared - before.shared) / _NUMBER,
        f"{step}: busd": (busd_after.private - busd_before.private) / _NUMBER,
    }
