"""benchmarks/: each system at each size, the choice of the best system, and losses that a system may have."""

import os
import sys
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path

import pytest

from benchmarks import bulk, copying, cost, facade, fanout, foreign, goals, growth, latency, paced, throughput
from benchmarks.cases import Figures, Outcome
from benchmarks.figures import best
from benchmarks.harness import START_S, Failure, Group
from benchmarks.installed import Installed
from benchmarks.plan import SIZES, Plan
from benchmarks.report import Section
from benchmarks.systems import (
    BUS,
    BUS_SOCKET,
    ECAL_SHIPPED,
    ICEORYX,
    NATS,
    PIPE,
    PYZMQ,
    PYZMQ_BLOCKING,
    RCLPY,
    RIVALS,
    SYSTEMS,
    TUNED,
    Speed,
    System,
    of_kind,
    tuned,
)
from benchmarks.versus import against_best
from benchmarks.work import Work
from bus.transport import memory
from bus_cli.bench.figures import bytes_text

pytestmark = pytest.mark.landing

QUICK, THOROUGH = Plan(quick=True, repetitions=1), Plan(quick=False, repetitions=2)

# --- the best of the others


def test_best_has_the_least_or_the_greatest_median() -> None:
    found: dict[str, list[Figures]] = {
        "steady": [{"p50": 5.0}, {"p50": 5.0}, {"p50": 5.0}],
        "lucky once": [{"p50": 1.0}, {"p50": 9.0}, {"p50": 9.0}],
        "without": [{"p99": 1.0}],
        "never": [],
    }

    assert best(found, "p50", is_least=True) == "steady"
    assert best(found, "p50", is_least=False) == "lucky once"
    assert best(found, "per_s", is_least=True) == ""


def _outcomes() -> dict[str, Outcome]:
    return {
        "64 B, ours": Outcome("64 B, ours", [{"per_s": 9.0}, {"per_s": 8.0}], series="ours"),
        "64 B, fast": Outcome("64 B, fast", [{"per_s": 3.0}, {"per_s": 4.0}], series="fast"),
        "64 B, slow": Outcome("64 B, slow", [{"per_s": 1.0}, {"per_s": 1.0}], series="slow"),
        "64 B, loses": Outcome("64 B, loses", [{"per_s": 6.0, "lost": 0.1}], series="loses"),
        "64 B, failed": Outcome("64 B, failed", [{"per_s": 7.0}], failure="it hangs", series="failed"),
        "64 B, missing": Outcome("64 B, missing", missing="not installed", series="missing"),
    }


def test_ours_is_compared_with_the_best_that_lost_nothing_and_did_not_fail() -> None:
    outcomes = _outcomes()
    theirs = [name for name in outcomes if name != "64 B, ours"]

    (fastest,) = against_best(outcomes, "64 B, ours", theirs, "per_s", at_least=3.0, what="messages/s")
    (slowest,) = against_best(outcomes, "64 B, ours", theirs, "per_s", at_most=1.0)

    assert fastest.name == "64 B, ours / best rival (fast), messages/s"
    assert (fastest.value.min, fastest.value.max, fastest.at_least) == (2.0, 3.0, 3.0)
    assert slowest.name == "64 B, ours / best rival (slow), per_s"
    assert not slowest.is_met


def test_where_nobody_is_left_nothing_is_compared() -> None:
    outcomes = _outcomes()

    assert against_best(outcomes, "64 B, ours", ["64 B, loses", "64 B, missing", "no such"], "per_s") == []
    assert against_best(outcomes, "64 B, missing", ["64 B, fast"], "per_s") == []


# --- every system at every size


def test_a_flood_has_as_many_messages_as_take_so_long() -> None:
    speed = Speed(per_s=100_000, bytes_per_s=1e9)

    assert speed.messages_in(0.5, 1) == pytest.approx(50_000, rel=0.02)
    assert speed.messages_in(0.5, 1 << 20) == pytest.approx(500e6 / (1 << 20), rel=0.05)
    assert speed.messages_in(0.001, 4 << 20) == 20


def test_systems_have_a_name_each_and_are_of_one_kind() -> None:
    names = [system.name for system in SYSTEMS]

    assert len(set(names)) == len(names)
    assert list(RIVALS) == of_kind("direct", "brokered")
    assert all(rival.largest == max(SIZES) for rival in RIVALS)
    assert [rival for rival in RIVALS if not rival.floods] == [PYZMQ_BLOCKING]


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, Work]]:
    """Calls of `measure`. It measures nothing: each system seems to be installed and has the same figures."""
    done: list[tuple[str, Work]] = []

    def measure(
        system: System, work: Work, on_cpus: Sequence[int] = (), neighbours: int | None = None
    ) -> Figures:
        done.append((system.name, work))
        keys = ("p50", "p99", "cpu", "per_s", "bytes_per_s", "published_per_s", "delivered", "seconds")
        more = ("mib_publisher", "mib_subscriber", "talker_ms", "listener_ms")
        return dict.fromkeys((*keys, *more), 2.0)

    monkeypatch.setattr(System, "missing", str)
    monkeypatch.setattr(throughput, "no_c_program", lambda _: "")
    for module in (paced, throughput):
        monkeypatch.setattr(module, "measure", measure)
    for name in ("measure_lossy", "measure_start"):
        monkeypatch.setattr(facade, name, measure)
    monkeypatch.setattr(facade, "measure_round_trips", lambda *_: {"p50": 1.0})
    monkeypatch.setattr(facade, "installed", lambda: nullcontext(Installed(sys.executable)))
    for name in ("measure_codec", "measure_copying"):
        module = throughput if name == "measure_codec" else copying
        monkeypatch.setattr(module, name, lambda *_: {"per_s": 1.0, "bytes_per_s": 1.0})
    return done


@pytest.mark.parametrize("plan", [QUICK, THOROUGH], ids=["quick", "thorough"])
@pytest.mark.parametrize("run", [latency.run, throughput.run], ids=["latency", "throughput"])
def test_each_size_has_every_rival_and_is_compared_with_the_best(
    measured: list[tuple[str, Work]], run: Callable[[Plan], Section], plan: Plan
) -> None:
    section = run(plan)

    names = [row.name for row in section.rows]
    assert len(set(names)) == len(names)
    assert {row.at for row in section.rows} == set(plan.sizes)
    for size in plan.sizes:
        text = bytes_text(size)
        rivals = [rival for rival in RIVALS if run is latency.run or (rival.floods and size in (64, 1 << 20))]
        assert {f"{text}, {rival.name}" for rival in rivals} <= set(names)
        best_of = [
            one.name
            for one in section.comparisons
            if one.name.startswith(f"{text}, busd") and "best rival" in one.name
        ]
        assert any("shared memory" in name for name in best_of)
        assert any("socket" in name for name in best_of) == bool(of_kind("brokered"))
    assert all(row.name == f"{bytes_text(int(row.at))}, {row.series}" for row in section.rows)
    assert section.axis == "size in B" and all(column.better for column in section.columns)


@pytest.mark.parametrize("run", [bulk.run, cost.run, facade.run], ids=["bulk", "cost", "facade"])
def test_other_sections_can_be_drawn_and_compared(
    measured: list[tuple[str, Work]], run: Callable[[Plan], Section]
) -> None:
    section = run(THOROUGH)

    assert all(row.series and row.at for row in section.rows)
    assert section.axis and section.comparisons
    assert all(column.better for column in section.columns)


def test_who_waits_for_events_is_asked_to_in_its_own_way(measured: list[tuple[str, Work]]) -> None:
    latency.run(QUICK)

    ways = {(name, work.take_by) for name, work in measured if not work.busy_poll_s and not work.publish_by}
    assert {(rival.name, rival.takes_by) for rival in RIVALS} <= ways


def test_plain_programs_give_no_turns_where_cpu_time_is_counted(measured: list[tuple[str, Work]]) -> None:
    cost.run(QUICK)

    assert dict(measured)["busd, shared memory"].gives_turns
    assert all(work.gives_turns == by_name(name).gives_turns for name, work in measured)


def by_name(name: str) -> System:
    return next(system for system in (*SYSTEMS, ECAL_SHIPPED, RCLPY) if system.name == name)


def test_long_messages_are_measured_as_they_come_and_with_malloc_set_alike(
    measured: list[tuple[str, Work]],
) -> None:
    for plan, least in ((QUICK, [BUS, PIPE, ICEORYX]), (THOROUGH, [BUS, BUS_SOCKET, PIPE, PYZMQ_BLOCKING])):
        names = {row.name for row in latency.run(plan).rows}

        assert {f"1 MiB, {name}" for one in least for name in (one.name, tuned(one).name)} <= names
        assert not any(TUNED in name for name in names if not name.startswith("1 MiB, "))
    assert {key: int(value) for key, value in tuned(PIPE).environ.items()} == {
        "MALLOC_MMAP_THRESHOLD_": 32 << 20,
        "MALLOC_TRIM_THRESHOLD_": memory._KEPT_BYTES,
        "MALLOC_TOP_PAD_": 1 << 20,
    }
    assert tuned(BUS_SOCKET).environ["BUS_ROUTE"] == "socket"


def test_a_p99_rests_on_enough_messages_and_a_flood_lasts(measured: list[tuple[str, Work]]) -> None:
    for run in (latency.run, cost.run, facade.run):
        run(THOROUGH)
    timed = [work for _, work in measured if work.rate and work.warm_up]
    for size, least in ((64, 5000), (1 << 20, 500)):
        assert min(work.count for work in timed if work.size == size) >= least

    asked: list[int] = []

    def flood(work: Work) -> Figures:
        asked.append(work.count)
        return {"seconds": work.count / 1000}

    lasting = throughput.Lasting(flood, Work(size=64, count=100, warm_up=10), 2.0)

    assert lasting()["seconds"] >= 2.0
    assert asked[0] == 100 and len(asked) <= 3
    asked.clear()
    assert lasting()["seconds"] >= 2.0
    assert len(asked) == 1  # the second run uses the rate that the first one measured
    slow = throughput.Lasting(flood, Work(size=64, count=20_000, warm_up=10), 2.0)
    assert (slow()["seconds"], slow()["seconds"]) == (20.0, pytest.approx(2.4))


def test_what_is_not_essential_takes_part_in_fewer_rounds(measured: list[tuple[str, Work]]) -> None:
    latency.run(Plan(quick=False, repetitions=4))

    done = [name for name, work in measured if work.size == 64]
    assert (done.count(NATS.name), done.count(PYZMQ.name)) == (1, 4)


def test_a_flood_is_compared_with_who_takes_as_it_does(measured: list[tuple[str, Work]]) -> None:
    for run in (throughput.run, bulk.run):
        for one in run(THOROUGH).comparisons:
            ours, slash, theirs = one.name.partition(" / ")
            if slash and "iceoryx2" in theirs and "copied" not in ours:
                assert ("polling" in ours) == ("polling" in theirs), one.name


def test_pairs_beside_a_busy_process_have_publishers_that_are_alike(measured: list[tuple[str, Work]]) -> None:
    section = foreign.run(THOROUGH)

    assert {row.at for row in section.rows} == {0, 1}
    assert not any(work.gives_turns for _, work in measured)
    assert any("best rival" in one.name and one.has_goal for one in section.comparisons)


def test_every_goal_has_cases_to_be_made_of(measured: list[tuple[str, Work]]) -> None:
    sections = [run(THOROUGH) for run in (latency.run, throughput.run, bulk.run, cost.run)]

    found = {one.headline for section in sections for one in section.comparisons if one.headline}
    measured_here = {section.name for section in sections}
    assert found == {goal.headline for goal in goals.GOALS if goal.section in measured_here}
    assert len({goal.headline for goal in goals.GOALS}) == len(goals.GOALS)


def test_goals_name_cases_of_the_other_sections_too() -> None:
    names = {
        "fanout": {fanout.name_of(system, number) for system in (BUS, ICEORYX) for number in (8, 16)},
        "growth": {step.name for step in growth.steps(THOROUGH)},
        "startup": {
            f"first message{of}, {system.name}" for of in ("", " of a listener") for system in (BUS, PYZMQ)
        },
    }
    for goal in goals.GOALS:
        if goal.section in names:
            assert {goal.ours, goal.theirs} <= names[goal.section]


# --- permitted losses, with a system that says what the test wants

LOSER = """
import json, os, sys
def tell(**event): print(json.dumps(event), flush=True)
tell(event="ready")
seen = json.loads(os.environ["SEEN"])
for word in map(str.strip, sys.stdin):
    if word == "look":
        tell(event="seen", end_ns=1500000000, count=seen.pop(0) if len(seen) > 1 else seen[0])
    elif word == "go":
        tell(event="sent", begin_ns=1000000000)
"""
FLOOD = Work(size=100, count=1000, warm_up=10)


@pytest.fixture
def loser(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> System:
    (tmp_path / "losing_system.py").write_text(LOSER)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    monkeypatch.setattr(throughput, "_QUIET_S", 0.01)
    return System("loser", "losing_system", may_lose=True)


@pytest.mark.parametrize(
    ("seen", "arrived"),
    [
        ("[10, 1010]", 1000),  # the system lost nothing
        ("[0, 4, 10, 10, 0, 300, 910, 910]", 900),  # the count is final only when two answers agree
        ("[8, 8, 508]", 500),  # the system lost messages of the warm-up, too
    ],
)
def test_of_a_system_that_may_lose_what_arrived_counts(
    loser: System, monkeypatch: pytest.MonkeyPatch, seen: str, arrived: int
) -> None:
    monkeypatch.setenv("SEEN", seen)

    found = throughput.measure(loser, FLOOD)

    assert found["per_s"] == pytest.approx(2 * arrived)
    assert found["bytes_per_s"] == pytest.approx(200 * arrived)
    assert found["lost"] == pytest.approx(100 - arrived / 10)


@pytest.mark.parametrize(
    ("seen", "text"),
    [("[10]", "0 of 1000 arrived"), ("[0]", "0 of 10 arrived within"), ("[10, 2000]", "1990 of")],
)
def test_a_flood_of_which_nothing_or_too_much_arrives_is_a_failure(
    loser: System, monkeypatch: pytest.MonkeyPatch, seen: str, text: str
) -> None:
    monkeypatch.setenv("SEEN", seen)
    monkeypatch.setattr(throughput, "_LIMIT_S", 0.1)

    with pytest.raises(Failure, match=text):
        throughput.measure(loser, FLOOD)


# --- CPUs, neighbours and memory


def test_a_pair_is_measured_beside_a_process_that_uses_a_cpu() -> None:
    work = Work(size=64, count=100, warm_up=10, rate=1000, take_by="blocking", gives_turns=False)

    found = paced.measure(PIPE, work, neighbours=1)

    assert 0 < found["p50"] <= found["max"]
    assert found["given_publisher"] > 0 and found["given_subscriber"] > 0
    assert min(found["taken_publisher"], found["taken_subscriber"]) >= 0
    assert "given_publisher" not in paced.measure(PIPE, work)


def test_processes_are_put_where_they_shall_be_and_who_is_gone_is_not() -> None:
    cpus = sorted(os.sched_getaffinity(0))[-2:]
    with Group() as group:
        children = [group.start_python(f"child_{cpu}", "-c", "input()") for cpu in cpus]
        for child, cpu in zip(children, cpus, strict=True):
            paced.put_on(child, cpu)
            assert os.sched_getaffinity(child.pid) == {cpu}
        with pytest.raises(Failure, match=r"child_.* can't be put on CPU 100000"):
            paced.put_on(children[0], 100_000)
        for child in children:
            child.send("enough")

    with pytest.raises(Failure, match="can't be put on CPU"):
        paced.put_on(children[0], cpus[0])


def test_a_thread_that_ends_meanwhile_is_no_process_that_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """zenoh starts and ends threads all the time."""
    with Group() as group:
        child = group.start_python("child", "-c", "input()")
        there = paced._threads(child)
        with Group() as others:
            other = others.start_python("other", "-c", "input()")
            ended = Path(f"/proc/{other.pid}/task/{other.pid}")
        monkeypatch.setattr(paced, "_threads", lambda child: [ended, *there])
        assert sum(paced.switches(child)) > 0
        cpu = min(os.sched_getaffinity(0))
        paced.put_on(child, cpu)
        assert os.sched_getaffinity(child.pid) == {cpu}
        child.send("enough")


@pytest.mark.parametrize(("cpus", "missing"), [({0}, "there is one CPU only"), ({0, 1}, "")])
def test_two_cpus_are_measured_where_there_are_two(
    measured: list[tuple[str, Work]], monkeypatch: pytest.MonkeyPatch, cpus: set[int], missing: str
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: cpus)

    rows = {row.series: row for row in latency.run(THOROUGH).rows if row.at == min(SIZES)}

    assert missing in rows["busd, shared memory, on two CPUs"].trouble
    assert bool(rows["busd, shared memory, on two CPUs"].figures) == (not missing)
    assert rows["busd, shared memory, on one CPU"].figures


def test_memory_of_a_process_is_told_and_one_that_is_gone_is_a_failure() -> None:
    with Group() as group:
        child = group.start_python("child", "-c", """print('{"event": "up"}', flush=True); input()""")
        group.expect(child, "up", within_s=START_S)
        assert 1 < paced.memory_mib(child) < 1000
        gone = group.start_python("gone", "-c", "raise SystemExit('no memory')")
        os.waitid(os.P_PIDFD, gone.exit_fd, os.WEXITED | os.WNOWAIT)
        with pytest.raises(Failure, match="gone exited with 1: no memory"):
            paced.memory_mib(gone)
        child.send("enough")
