"""benchmarks/camera.py: the count of lost images, the comparisons, and each camera measured with few
images.
"""

import json
import os
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from benchmarks import camera
from benchmarks.cases import Figures
from benchmarks.harness import Failure
from benchmarks.plan import Plan
from benchmarks.systems import BUS_BYTES, ICEORYX, RCLPY, ROS, ROS_LARGE, ZENOH, System
from benchmarks.work import IMAGE, Work

pytestmark = pytest.mark.landing

READER = """
import json, os, sys
print('{"event": "ready"}', flush=True)
if sys.argv[1] == "subscriber":
    says = json.loads(os.environ["SAYS"])
    if says.get("complete"):
        print('{"event": "complete"}', flush=True)
    if says.get("dies"):
        sys.exit(3)
for word in sys.stdin:
    if word.strip() == "report":
        print(json.dumps({"event": "received", "at_ns": 1} | says["received"]), flush=True)
"""
WORK = Work(size=1 << 16, count=4, warm_up=0, rate=1000.0, subscribers=2)


@pytest.fixture
def puppet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> System:
    (tmp_path / "puppet_camera.py").write_text(READER)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    monkeypatch.setattr(camera, "_LATE_S", 0.1)
    return System("puppet", "puppet_camera")


def _say(monkeypatch: pytest.MonkeyPatch, ages: list[int], **more: Any) -> None:
    received = {"age_ns": ages, "late_ns": [0 for _ in ages]}
    monkeypatch.setenv("SAYS", json.dumps({"received": received} | more))


def test_what_does_not_come_in_time_is_lost(puppet: System, monkeypatch: pytest.MonkeyPatch) -> None:
    _say(monkeypatch, [1000, 3000, 2000])

    found = camera.measure(puppet, WORK)

    assert (found["p50"], found["max"], found["lost"]) == pytest.approx((2, 3, 25))
    assert found["cpu_broker"] == 0


def test_nobody_waits_where_all_came(puppet: System, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera, "_LATE_S", 60.0)
    _say(monkeypatch, [1000] * 4, complete=True)

    assert camera.measure(puppet, WORK)["lost"] == 0


def test_where_nothing_came_all_is_lost(puppet: System, monkeypatch: pytest.MonkeyPatch) -> None:
    _say(monkeypatch, [])

    found = camera.measure(puppet, WORK)

    assert found["lost"] == 100
    assert "p50" not in found


def test_a_reader_that_ends_is_a_failure(puppet: System, monkeypatch: pytest.MonkeyPatch) -> None:
    _say(monkeypatch, [], dies=True)

    with pytest.raises(Failure, match="exited with 3"):
        camera.measure(puppet, WORK)


@pytest.mark.parametrize("quick", [True, False])
def test_every_camera_has_a_row_and_is_compared(monkeypatch: pytest.MonkeyPatch, quick: bool) -> None:
    figures: Figures = {"p50": 2.0, "p99": 2.0, "lost": 0.0, "cpu_publisher": 2.0, "cpu_reader": 2.0}
    monkeypatch.setattr(System, "missing", str)
    monkeypatch.setattr(camera, "measure", lambda system, work: figures if system != ROS else {"lost": 100.0})

    section = camera.run(Plan(quick, 3))

    systems = (BUS_BYTES, ICEORYX, ZENOH, RCLPY, ROS, ROS_LARGE)
    assert [row.name for row in section.rows] == [camera.name_of(one) for one in systems]
    names = [one.name for one in section.comparisons]
    assert any("best rival" in name and name.endswith("cpu_reader") for name in names)
    assert any(RCLPY.name in name and ROS_LARGE.name in name for name in names)
    assert not any(name.endswith(f"/ {ROS.name}, p50") for name in names)


@pytest.mark.parametrize(
    ("system", "way"),
    [
        (BUS_BYTES, {"publish_by": "loan", "take_by": "views"}),
        (ICEORYX, {"publish_by": "loan", "take_by": "event"}),
        (ZENOH, {"publish_by": "loan"}),
        (RCLPY, {"publish_by": IMAGE}),
        (ROS_LARGE, {"publish_by": IMAGE}),
    ],
    ids=lambda value: value.name if isinstance(value, System) else "",
)
def test_a_camera_of_each_system(system: System, way: dict[str, str]) -> None:
    if reason := system.missing():
        pytest.skip(reason)
    frame = Work(size=1 << 16, count=20, warm_up=2, rate=50.0, subscribers=2)

    found = camera.measure(system, replace(frame, **way))

    assert found["p50"] > 0
    assert 0 <= found["lost"] < 100
    assert found["cpu_publisher"] > 0 and found["cpu_reader"] > 0
