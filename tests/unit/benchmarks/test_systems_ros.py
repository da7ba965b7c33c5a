"""benchmarks/: one program on busd's facade, and on ROS 2's rclpy if it is installed; and messages for
both.
"""

import re
from pathlib import Path

import pytest

from benchmarks import fanout, paced, ros, startup, throughput
from benchmarks.machine import ROOT, look_at_machine
from benchmarks.systems import RCLPY, ROS, ROS_LARGE, System
from benchmarks.work import Work

pytestmark = pytest.mark.landing

BOTH = pytest.mark.parametrize("system", [RCLPY, ROS], ids=lambda system: system.name)


def _or_skip(system: System) -> System:
    reason = system.missing()
    if reason:
        pytest.skip(reason)
    return system


def test_both_run_the_same_program_which_knows_nothing_of_busd() -> None:
    assert RCLPY.module == ROS.module == ROS_LARGE.module
    programs = ("adapters/rclpy_string", "adapters/roles", "adapters/talkers", "work", "worker")
    for name in programs:
        text = (ROOT / "benchmarks" / f"{name}.py").read_text()

        assert not re.search(r"^(from|import) busd?\b", text, re.MULTILINE), name


@BOTH
def test_what_is_paced_arrives(system: System) -> None:
    work = Work(size=64, count=50, warm_up=5, rate=500, take_by="callback")

    found = paced.measure(_or_skip(system), work)

    assert 0 < found["p50"] <= found["p99"]
    assert found["cpu_publisher"] > 0


@pytest.mark.parametrize("system", [RCLPY, ROS, ROS_LARGE], ids=lambda system: system.name)
@pytest.mark.parametrize(("size", "count"), [(64, 1000), (1 << 20, 20)])
def test_a_flood_loses_nothing(system: System, size: int, count: int) -> None:
    work = Work(size=size, count=count, warm_up=5, take_by="callback")

    assert throughput.measure(_or_skip(system), work)["lost"] == 0


@BOTH
def test_all_of_three_subscribers_have_it(system: System) -> None:
    work = Work(size=64, count=200, warm_up=10, subscribers=3)

    assert fanout.measure_flood(_or_skip(system), work)["lost"] == 0


@BOTH
def test_the_first_message(system: System) -> None:
    assert startup.measure_first_message(_or_skip(system))["ms"] > 0


def test_where_it_is_not_installed_its_rows_say_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros, "ROS_VENV", tmp_path)
    monkeypatch.setattr("benchmarks.machine.ROS_VENV", tmp_path)

    assert ROS.missing() == "it is not installed here: make peers, which needs x86_64"
    assert look_at_machine().packages["rclpy"] == "missing"


def test_a_run_has_a_domain_of_its_own_on_this_machine(tmp_path: Path) -> None:
    found = ros.environ(tmp_path)

    assert 1 <= int(found["ROS_DOMAIN_ID"]) <= 100
    assert found == ros.environ(tmp_path)
    assert found["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"


def test_an_installation_is_as_large_as_what_it_needs() -> None:
    found = ros.busd_installed()

    assert found["packages"] >= 2
    assert 1 < found["mib"] < 100
    if not ROS.missing():
        assert ros.installed()["mib"] > found["mib"]


def test_sizes_are_those_of_all_that_is_required(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, needs, size in (
        ("ros-jazzy-rclpy", "Py.Yaml (>=6)", 1 << 20),
        ("py-yaml", "nothing; extra == 'dev'", 2 << 20),
        ("nothing", "", 1 << 20),
    ):
        folder = tmp_path / "lib/python3.11/site-packages" / f"{name.replace('-', '_')}-1.dist-info"
        folder.mkdir(parents=True)
        requires = f"Requires-Dist: {needs}\n" if needs else ""
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n{requires}")
        (folder.parent / f"{name}.so").write_bytes(b"x" * size)
        (folder.parent / f"{name}.pyc").write_bytes(b"x" * size)
        (folder / "RECORD").write_text(f"{name}.so,,\n{name}.pyc,,\n{name}.gone,,\n")
    monkeypatch.setattr(ros, "ROS_VENV", tmp_path)

    assert ros.installed() == {"mib": 3.0, "packages": 2.0}
