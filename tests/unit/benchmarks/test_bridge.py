"""benchmarks/bridge.py: the costs of bridges, measured with few messages."""

import pytest

from benchmarks import bridge, bridged, paced, throughput
from benchmarks.adapters.bridging import Crowd, Torrent
from benchmarks.bridged import BY_ZENOH, FROM_DDS, FROM_ROS, NUMBERED_ZENOH, PLAIN_ZENOH, TO_DDS, TO_ROS
from benchmarks.cases import Outcome
from benchmarks.plan import Plan
from benchmarks.systems import System
from benchmarks.work import Work


def _name(value: object) -> str:
    return value.name if isinstance(value, System) else str(value)


def _or_skip(system: System) -> System:
    if reason := system.missing():
        pytest.skip(reason)
    return system


@pytest.mark.landing
@pytest.mark.parametrize(
    "system", [PLAIN_ZENOH, NUMBERED_ZENOH, BY_ZENOH, TO_DDS, FROM_DDS, TO_ROS, FROM_ROS], ids=_name
)
def test_what_is_paced_arrives_with_its_stamps(system: System) -> None:
    work = Work(size=64, count=50, warm_up=10, rate=500, take_by=system.takes_by)
    found = paced.measure(_or_skip(system), work)
    assert 0 < found["p50"] <= found["p99"]


@pytest.mark.landing
@pytest.mark.parametrize("system", [PLAIN_ZENOH, NUMBERED_ZENOH, BY_ZENOH, TO_DDS, FROM_DDS], ids=_name)
def test_a_flood_loses_nothing(system: System) -> None:
    work = Work(size=64, count=3000, warm_up=100, take_by=system.takes_by)
    assert throughput.measure(_or_skip(system), work)["per_s"] > 0


@pytest.mark.landing
def test_a_crowd_and_a_far_side_that_hangs() -> None:
    _or_skip(BY_ZENOH)
    found = bridge.measure_crowd(Crowd(10, "/crowd"), 0.1)
    assert found["there_s"] > 0 and found["idle_percent"] >= 0
    assert bridge.measure_hang(Torrent("/torrent", 1 << 10, 100.0), 0.3)["grown_mib"] >= 0


@pytest.mark.landing
@pytest.mark.parametrize("system", [TO_ROS, FROM_ROS], ids=_name)
def test_calls_between_a_bus_and_ros(system: System) -> None:
    found = bridge.measure_calls(_or_skip(system), 5)
    assert 0 < found["p50"] <= found["p99"]


@pytest.mark.landing
@pytest.mark.parametrize("is_theirs", [True, False])
def test_a_crowd_between_a_bus_and_ros(is_theirs: bool) -> None:
    _or_skip(TO_ROS)
    found = bridge.measure_crowd_of_ros(Crowd(10, "/crowd"), 0.1, is_theirs)
    assert found["there_s"] > 0 and found["idle_percent"] >= 0


def test_the_goals() -> None:
    zenoh, dds, ros = "eclipse-zenoh, TCP", "cyclonedds", "rclpy, Fast DDS"
    figures = {
        f"latency 64 B, {zenoh}": {"p50": 100.0},
        f"latency 64 B, {dds}": {"p50": 100.0},
        "latency 64 B, busd, shared memory": {"p50": 50.0},
        "latency 64 B, busd - zenoh - busd": {"p50": 279.0},  # compared with 100 + 2 * 50
        "latency 64 B, busd - cyclonedds": {"p50": 211.0},  # compared with 100 + 50
        "latency 64 B, cyclonedds - busd": {"p50": 209.0},
        f"latency 1 MiB, {zenoh}": {"p50": 3.0},
        "latency 1 MiB, busd - zenoh - busd": {"p50": 3.1},
        f"lossless 64 B, {zenoh}": {"per_s": 100.0},
        f"lossless 64 B, {zenoh}, numbered": {"per_s": 50.0},
        "lossless 64 B, busd - zenoh - busd": {"per_s": 61.0},
        f"lossless 64 B, {dds}": {"per_s": 100.0},
        "lossless 64 B, busd - cyclonedds": {"per_s": 51.0},
        "lossless 64 B, cyclonedds - busd": {"per_s": 49.0},
        f"lossless 64 KiB, {zenoh}": {"bytes_per_s": 100.0},
        "lossless 64 KiB, busd - zenoh - busd": {"bytes_per_s": 59.0},
        f"latency 64 B, {ros}": {"p50": 200.0},
        f"latency 64 B, busd, rclpy - {ros}": {"p50": 351.0},  # compared with 200 + 50
        "500 mirrored endpoints": {"there_s": 10.1, "idle_percent": 0.9},
        "500 mirrored endpoints of ROS 2": {"there_s": 10.1},
        "the far bridge hangs": {"grown_mib": 99.0},
    }
    outcomes = {name: Outcome(name, [held]) for name, held in figures.items()}
    found = bridge.comparisons(outcomes)
    assert [one.name for one in found if not one.is_met] == [
        f"latency 1 MiB, busd - zenoh - busd / latency 1 MiB, {zenoh}, p50",
        f"lossless 64 KiB, busd - zenoh - busd / lossless 64 KiB, {zenoh}, bytes/s",
        f"latency 64 B, busd - cyclonedds / ({dds} + 1 x busd, shared memory), p50",
        f"lossless 64 B, cyclonedds - busd / lossless 64 B, {dds}, messages/s",
        f"latency 64 B, busd, rclpy - {ros} / ({ros} + 1 x busd, shared memory), p50",
        "500 mirrored endpoints of ROS 2: s until they are there",
        "500 mirrored endpoints: s until they are there",
    ]
    assert sum(one.has_goal for one in found) == 13


def test_without_the_engines_there_is_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bridged, "find_spec", lambda name: None)
    assert BY_ZENOH.missing() == "zenoh is not installed: pip install 'eclipse-zenoh>=1.10,<2'"
    assert TO_DDS.missing() == "cyclonedds is not installed: pip install 'cyclonedds>=11.0.1'"
    monkeypatch.setattr("benchmarks.ros.version", str)
    monkeypatch.setattr("benchmarks.systems.find_spec", lambda name: None)
    monkeypatch.setattr("benchmarks.systems.shm.why_not", lambda: "no shared memory")
    section = bridge.run(Plan(quick=True, repetitions=1))
    assert all(row.trouble.startswith("missing") for row in section.rows) and not section.comparisons
