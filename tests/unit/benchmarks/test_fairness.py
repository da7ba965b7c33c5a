"""benchmarks/fairness: the comparisons, the measurement of pairs, and every attack."""

from typing import get_args

import pytest

from benchmarks import discovery, fairness
from benchmarks.adapters.arriving import Programs
from benchmarks.adapters.hostile.__main__ import FLOODS
from benchmarks.adapters.hostile.attack import Attack, Kind
from benchmarks.adapters.hostile.raw import control, run
from benchmarks.cases import Figures
from benchmarks.fairness import Version, beside, crowds
from benchmarks.fairness.neighbours import BUSY, ESSENTIAL, NEIGHBOURS, QUIET, Neighbour
from benchmarks.harness import START_S, Child, Group
from benchmarks.plan import Plan
from benchmarks.systems import BUS, System
from bus import shm

pytestmark = pytest.mark.landing


@pytest.fixture
def pretended(monkeypatch: pytest.MonkeyPatch) -> None:
    """Measures nothing. All figures are ten times as bad with a numbered attack, and twice as bad with
    another busd.
    """

    def measure(neighbour: Neighbour, seconds: float, program: str = "") -> Figures:
        attacks = neighbour.attacks
        worse = (1 + len(attacks)) * (10 if any(one.number for one in attacks) else 1) * (1 + bool(program))
        return {"socket_p99": 4.0 * worse, "shm_p99": 0.1 * worse}

    def come_back(each: int, program: str = "") -> Figures:
        return {"matched_s": 1.0, "back_s": each / 10}

    def arrive(programs: Programs, attack: Attack | None, said: set[str], program: str = "") -> Figures:
        said.add("BrokerLeft: without a word")
        return {"got_in": 99.0, "arrived_p50": 1.0, "arrived_max": 4.0}

    def discover(system: System, topics: int) -> Figures:
        return {"matched_s": 1.0}

    monkeypatch.setattr(beside, "measure", measure)
    monkeypatch.setattr(beside, "why_not", lambda neighbour: "")
    monkeypatch.setattr(crowds, "come_back", come_back)
    monkeypatch.setattr(crowds, "arrive", arrive)
    monkeypatch.setattr(discovery, "measure", discover)
    monkeypatch.setattr(fairness, "BUS", BUS._replace(missing=str))


@pytest.mark.usefixtures("pretended")
def test_each_neighbour_has_the_goals_and_what_asks_nothing_of_busd_has_none() -> None:
    section = fairness.measure(Plan(quick=False, repetitions=1), [Version()], lambda name: True)

    values = {one.name: one for one in section.comparisons}
    hostile = [name for name, one in NEIGHBOURS.items() if not one.is_floor]
    assert len(values) == 2 * len(hostile) + 3
    for name in hostile:
        is_bad = any(one.number for one in NEIGHBOURS[name].attacks)
        by_socket, by_memory = (
            values[f"{name}: p99 by {way}"] for way in (f"socket / {BUSY}", f"shared memory / {QUIET}")
        )
        assert (by_socket.value.median, by_memory.value.median) == pytest.approx(
            (10.0, 20.0) if is_bad else (1.0, 2.0)
        )
        assert by_socket.has_goal and by_socket.is_met is by_memory.is_met is not is_bad
    rows = {row.name: row.figures for row in section.rows}
    assert rows["two busy loops"]["socket_busy"].median == 1.5
    assert rows["two busy loops"]["shm_quiet"].median == pytest.approx(3.0)


@pytest.mark.usefixtures("pretended")
def test_what_is_linear_and_who_did_not_get_in() -> None:
    section = fairness.measure(Plan(quick=False, repetitions=1), [Version()], lambda name: "0" in name)

    by_name = {one.name: one for one in section.comparisons}
    assert by_name["36,100 matches come back / 10,000"].value.median == pytest.approx(1.9)
    missed = [name for name, one in by_name.items() if "100 programs" in name and not one.is_met]
    assert missed == ["100 programs start: connections with garbage: in"]
    assert "who did not get in: BrokerLeft: without a word" in section.notes


@pytest.mark.usefixtures("pretended")
def test_in_a_run_of_all_benchmarks_only_the_essential_neighbours() -> None:
    section = fairness.run(Plan(quick=True, repetitions=1))

    assert [row.name for row in section.rows] == [*ESSENTIAL]
    more = {row.name for row in fairness.run(Plan(quick=False, repetitions=1)).rows}
    assert more & NEIGHBOURS.keys() == NEIGHBOURS.keys() & {*ESSENTIAL} and len(more) > len(ESSENTIAL)


@pytest.mark.usefixtures("pretended")
def test_two_versions_are_measured_in_turns_each_beside_its_own_busy_loop() -> None:
    versions = [Version(), Version("before", "busd-of-another-checkout")]

    section = fairness.measure(
        Plan(False, 1), versions, lambda name: name in ("acks", BUSY) or "topics" in name
    )

    names = [row.name for row in section.rows]
    assert names[:4] == [QUIET, f"{QUIET}, before", BUSY, f"{BUSY}, before"]
    ratios = {one.name: one.value.median for one in section.comparisons}
    assert ratios[f"acks, before: p99 by socket / {BUSY}"] == 1.0
    assert ratios["1,000 topics with 2,000 endpoints: busd, socket / before, all matched"] == 1.0


@pytest.mark.timeout(120)
def test_pairs_beside_a_neighbour_are_measured() -> None:
    found = beside.measure(Neighbour((Attack("runs"),)), 0.05)

    for way in ("socket", *(["shm"] if shm.is_available() else [])):
        assert 0 < found[f"{way}_p50"] <= found[f"{way}_p99"] <= found[f"{way}_max"]
    assert min(found["asked_per_s"], found["busd_cpu"], found["neighbour_cpu"], found["silence"]) > 0


def test_matches_come_back() -> None:
    assert crowds.come_back(3)["back_s"] > 0


def test_programs_arrive_or_say_why_not(monkeypatch: pytest.MonkeyPatch) -> None:
    said: set[str] = set()

    assert crowds.arrive(Programs(2, 0.0), None, said)["got_in"] == 2
    assert not said

    monkeypatch.setattr(
        Group, "start_busd", lambda group, program: group.environ.update(BUSD_SOCKET="/nowhere/0")
    )
    assert crowds.arrive(Programs(1, 0.0), None, said) == {"got_in": 0}
    (why,) = said
    assert "/nowhere/0" in why


def test_hostile_programs_speak_the_protocol_as_its_description_has_it() -> None:
    hello = control("hello", version=1, pid=4711, program="talker.py")
    assert hello == bytes.fromhex(
        "2f 00 00 00 01 00 00 00 84 a1 6d a5 68 65 6c 6c 6f a7 76 65 72 73 69 6f 6e 01 a3 70 69 64 cd 12"
        "67 a7 70 72 6f 67 72 61 6d a9 74 61 6c 6b 65 72 2e 70 79"
    )
    body = "04 00 00 00 00 ca 9a 3b 00 00 00 00 91 a2 68 69 04 00 00 00 f4 cb 9a 3b 00 00 00 00 91 a2 68 6f"
    assert run(7, 5, 2, bytes.fromhex(body)) == bytes.fromhex(
        "3c 00 00 00 02 00 00 00 07 00 00 00 00 00 00 00 05 00 00 00 00 00 00 00 02 00 00 00 00 00 00 00"
        + body
    )


def _did(group: Group, child: Child) -> int:
    """Wait until an attacker has made its first request, and return the number of requests of its next
    report.
    """
    asked = 0
    while not asked:
        child.send("report")
        asked = group.expect(child, "flooded", within_s=START_S)["asked"]
    return asked


_QUIET_KINDS = {"everything"}
"""Their presence is the load; they make no requests."""
_NEED_MEMORY = {"shared memory", "rings"}


def test_every_kind_of_attack_has_a_row_and_a_program() -> None:
    kinds = {one.kind for neighbour in NEIGHBOURS.values() for one in neighbour.attacks}
    assert kinds == set(get_args(Kind)) == set(FLOODS)


@pytest.mark.timeout(120)
def test_every_attack_attacks_and_ends() -> None:
    kinds = [kind for kind in FLOODS if shm.is_available() or kind not in _NEED_MEMORY]
    with Group() as group:
        group.start_busd()
        for kind in kinds:
            with Group() as attackers:  # one kind of attack at a time
                attackers.environ = group.environ
                child = beside.start_attack(attackers, 0, Attack(kind, connections=2, number=20, samples=4))
                attackers.expect(child, "ready", within_s=START_S)
                if kind not in _QUIET_KINDS:
                    assert _did(attackers, child) > 0, kind
