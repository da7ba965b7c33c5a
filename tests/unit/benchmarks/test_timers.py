"""benchmarks/timers: the figures made from the calls of a timer, and the timer of each program, measured."""

import pytest

from benchmarks import timers
from benchmarks.cases import Figures
from benchmarks.machine import ROOT
from benchmarks.plan import Plan
from benchmarks.systems import System
from benchmarks.ticks import Calls, Ticks

MS = 1_000_000


def test_lateness_and_missed_calls() -> None:
    at_ms = (100.25, 110.75, 120.5, 150.5, 160.5)  # a call is due every 10 ms; two are missing
    calls = Calls(due_ns=10 * MS, at_ns=[round(one * MS) for one in at_ms], cpu_s=0.003)

    found = timers.summary(calls, 10 * MS)

    assert (found["late_p50"], found["late_max"]) == (500, 750)
    assert found["missed"] == pytest.approx(100 * 2 / 7)
    assert found["per_s"] == pytest.approx(4 / 0.06025)
    assert found["cpu"] == pytest.approx(100 * 0.003 / 0.06025)


def test_the_program_of_rclpy_knows_nothing_of_busd() -> None:
    for name in ("adapters/ticking_rclpy", "ticks"):
        text = (ROOT / "benchmarks" / f"{name}.py").read_text()
        assert not {"import bus", "from bus"} & {line[:10] for line in text.splitlines()}, name
        assert "from bus" not in text


def test_what_is_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    def measure(system: System, ticks: Ticks) -> Figures:
        by_call_later = ticks.way == "call_later"
        return {"cpu": 90.0 if by_call_later else 9.0, "missed": 0.0, "late_p50": 50.0}

    monkeypatch.setattr(timers, "measure", measure)

    section = timers.run(Plan(True, 1))

    assert not section.has_failures
    names = {one.name for one in section.rows}
    assert {"2,500/s, busd, uvloop", "100/s, call_later, asyncio", "1,000/s, busd, rclpy"} <= names
    goals = {one.name: one.is_met for one in section.comparisons}
    assert goals["2,500/s, busd, asyncio: % of a CPU"]
    assert len(goals) >= 6


@pytest.mark.landing
@pytest.mark.parametrize("name", ["busd, uvloop", "call_later, asyncio", "busd, rclpy", "rclpy, Fast DDS"])
def test_each_is_measured(name: str) -> None:
    system, ticks = timers.ways(Ticks(500.0, 0.2))[name]
    if missing := system.missing():
        pytest.skip(missing)

    found = timers.measure(system, ticks)

    assert 0 < found["per_s"] < 600
    assert 0 <= found["late_p50"] <= found["late_max"] < 2000
    assert found["cpu"] > 0
