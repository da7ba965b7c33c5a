"""benchmarks/bags.py: recording and replaying, each measured with few messages."""

from pathlib import Path

import pytest
from msgspec.structs import replace

from benchmarks import bags
from benchmarks.adapters.bagging import COUNT, RECORD, WRITE, Instants, Robot, Topics
from benchmarks.cases import Outcome
from benchmarks.plan import Plan
from benchmarks.systems import BUS
from benchmarks.work import Work
from effort import is_nightly

pytestmark = pytest.mark.landing

pytest.importorskip("mcap")


@pytest.fixture(autouse=True)
def _shared_memory() -> None:
    reason = BUS.missing()
    if reason:
        pytest.skip(reason)


def test_floods_that_are_recorded_or_counted() -> None:
    work = Work(size=64, count=1_000, warm_up=100, publish_by="publish")
    for way in (RECORD, COUNT, WRITE) if is_nightly() else (RECORD,):
        found = bags.measure_flood(replace(work, take_by=way))
        assert found["per_s"] > 0 and found["cpu_taker"] >= 0  # so few take no measurable CPU time


def test_a_stream_that_is_recorded() -> None:
    found = bags.measure_stream(Work(size=64, count=100, warm_up=10, rate=1000.0, take_by=RECORD))
    assert found["lost"] == 0 and found["cpu_taker"] >= 0


def test_a_robot_that_is_recorded_or_written() -> None:
    robot = Robot(seconds=0.1, rates={"image": 30.0, "imu": 50.0, "tf": 20.0}, image=3 << 10)
    assert robot.total == 10 + 3
    for way in (RECORD, COUNT) if is_nightly() else (RECORD,):
        found = bags.measure_robot(replace(robot, take_by=way))
        assert found["lost"] == 0 and found["cpu_s"] > 0


def test_what_a_publishers_calls_take_beside_a_recorder() -> None:
    work = Work(size=64, count=20, warm_up=2, rate=1000.0, subscribers=2, take_by="callback")
    found = bags.measure_publisher(work, RECORD)
    assert 0 < found["publish_p50"] <= found["publish_p99"]


def test_a_replay_beside_a_timer() -> None:
    instants = Instants(20, 1000.0)
    for found in (bags.measure_replay(instants), bags.measure_timer(instants)):
        assert 0 <= found["late_p50"] <= found["late_p99"]


def test_many_topics() -> None:
    assert bags.measure_topics(Topics(6))["s"] > 0


def test_the_goals() -> None:
    figures = {
        "64 B, counted": {"per_s": 100.0, "cpu_taker": 1.0},
        "64 B, recorded": {"per_s": 59.0, "cpu_taker": 2.0},
        "64 KiB, written as it comes": {"per_s": 100.0},
        "64 KiB, recorded": {"per_s": 59.0},
        "best effort, 100,000 messages/s, recorded": {"lost": 1.0},
        "a robot, written as it comes": {"cpu_s": 1.0},
        "a robot, recorded": {"cpu_s": 1.4, "lost": 1.0},
        "a publisher with one more subscription": {"publish_p99": 10.0},
        "a publisher with one more recorder": {"publish_p99": 11.0},
        "a replay": {"late_p99": 2.0},
        "a timer of the event loop": {"late_p99": 1.0},
        "100 topics": {"s": 0.31},
    }
    outcomes = {name: Outcome(name, [held]) for name, held in figures.items()}
    missed = [one.name for one in bags.comparisons(outcomes) if not one.is_met]
    assert missed == [
        "64 B, recorded / counted, per_s",
        "64 KiB, recorded / written as it comes, per_s",
        "best effort, 100,000 messages/s, recorded: messages lost",
        "a robot, recorded: messages lost",
        "s until 100 topics are subscribed",
    ]


def test_without_mcap_there_is_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bags, "find_spec", lambda name: None)
    section = bags.run(Plan(quick=True, repetitions=1))
    assert (
        all(row.trouble == "missing: mcap is not installed" for row in section.rows)
        and not section.comparisons
    )


def test_a_bag_to_be_played(tmp_path: Path) -> None:
    from bus_bag.storage import open_bag

    bags.write_bag(tmp_path / "bag", Instants(3, 1000.0))
    with open_bag(tmp_path / "bag") as reader:
        times = [message.log_time for message in reader.messages()]
    assert [at - times[0] for at in times] == [0, 1_000_000, 2_000_000]
