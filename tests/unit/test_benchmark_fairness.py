"""benchmarks/fairness.py: what it compares; that the pair is measured, and that every flood floods."""

import pytest

from benchmarks import fairness
from benchmarks.adapters.flooding import Flood, Kind
from benchmarks.cases import Figures
from benchmarks.harness import START_S, Child, Group
from benchmarks.plan import Plan
from benchmarks.systems import BUS, BUS_SOCKET, System
from benchmarks.work import Work


@pytest.mark.parametrize("quick", [True, False])
def test_each_flood_is_compared_with_quiet_and_busy_loops_have_no_goal(
    quick: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def measure(system: System, work: Work, floods: tuple[Kind, ...]) -> Figures:
        return {"p99": 10.0 + 15 * len(floods) + 100 * ("queries" in floods)}

    monkeypatch.setattr(fairness, "measure", measure)
    monkeypatch.setattr(fairness, "BUS", BUS._replace(missing=str))  # also where no memory is shared

    section = fairness.run(Plan(quick=quick, repetitions=1))

    assert len(section.rows) == (6 if quick else len(fairness.FLOODS) + 6)
    ratios = {one.name: one for one in section.comparisons}
    assert len(ratios) == (5 if quick else len(fairness.FLOODS) + 4)
    ours = {
        name.removeprefix(f"{BUS.name}, ").removesuffix(" / quiet, p99"): one
        for name, one in ratios.items()
        if name.startswith(BUS.name)
    }
    values = [one.value.median for one in ours.values()]
    assert values == ([2.5, 2.5, 2.5, 12.5, 2.5] if quick else [2.5, 4.0, 2.5, 2.5, 2.5, 12.5, 2.5, 2.5])
    floors = {"two that talk by a socket"} | (set() if quick else {"a busy loop", "two busy loops"})
    assert {name for name, one in ours.items() if not one.has_goal} == floors
    assert [name for name, one in ours.items() if not one.is_met] == ["a flood of queries"]
    assert not any(one.has_goal for name, one in ratios.items() if name.startswith(BUS_SOCKET.name))


def test_a_pair_beside_a_flood_is_measured() -> None:
    work = Work(size=64, count=40, warm_up=10, rate=200.0, take_by="callback")

    found = fairness.measure(BUS_SOCKET, work, ("samples",))

    assert 0 < found["p50"] <= found["p99"] <= found["max"]
    assert min(found["asked_per_s"], found["busd_cpu"], found["flooder_cpu"]) > 0


def _did(group: Group, child: Child) -> int:
    """What a flooder does from now on, once it has done something."""
    asked = 0
    while not asked:
        child.tell("report")
        asked = group.expect(child, "flooded", within_s=START_S)["asked"]
    return asked


def test_every_flood_floods_and_ends() -> None:
    kinds: dict[str, Kind] = {kind: kind for floods in fairness.FLOODS.values() for kind in floods}
    assert set(kinds) == set(Flood.__annotations__["kind"].__args__)
    with Group() as group:
        group.start_busd()
        children = [fairness.start_flooder(group, index, kind) for index, kind in enumerate(kinds)]
        for child in children:
            group.expect(child, "ready", within_s=START_S)
        for child in children:
            assert _did(group, child) > 0
