"""Frequency and age of updates. The clock stands until a test sets it."""

from typing import Any

import pytest

from bus_ros.diagnostic_updater import (
    CompositeDiagnosticTask,
    DiagnosticStatusWrapper,
    FrequencyStatus,
    FrequencyStatusParam,
    FunctionDiagnosticTask,
    Heartbeat,
    TimeStampStatus,
    TimeStampStatusParam,
)
from bus_ros.rclpy.time import Time

OK, WARN, ERROR = b"\x00", b"\x01", b"\x02"


class StillClock:
    seconds = 1000.0

    def now(self) -> Time:
        return Time(nanoseconds=round(self.seconds * 1e9))


def judged(task: Any) -> tuple[bytes, str, dict[str, str]]:
    status = task.run(DiagnosticStatusWrapper())
    return status.level, status.message, {one.key: one.value for one in status.values}


def test_frequency() -> None:
    clock = StillClock()
    task = FrequencyStatus(FrequencyStatusParam({"min": 10, "max": 20}, 0.5, 2), clock=clock)
    texts = []
    for events, seconds in ((1, 0.02), (1, 0.05), (1, 0.3), (1, 0.15), (0, 0.3), (0, 0.1)):
        clock.seconds += seconds
        for _ in range(events):
            task.tick()
        texts.append(judged(task)[:2])
    assert texts == [
        (WARN, "Frequency too high."),
        (OK, "Desired frequency met"),
        (OK, "Desired frequency met"),
        (WARN, "Frequency too low."),
        (WARN, "Frequency too low."),
        (ERROR, "No events recorded."),
    ]
    task.clear()
    clock.seconds += 0.5
    task.tick()
    assert judged(task)[2] == {
        "Events in window": "1",
        "Events since startup": "1",
        "Duration of window (s)": "0.500000",
        "Actual frequency (Hz)": "2.000000",
        "Minimum acceptable frequency (Hz)": "5.000000",
        "Maximum acceptable frequency (Hz)": "30.000000",
    }
    assert task.getName() == "FrequencyStatus"


def test_frequency_at_its_edges() -> None:
    clock = StillClock()
    exact = FrequencyStatus(FrequencyStatusParam({"min": 0, "max": 0}), clock=clock)
    assert judged(exact)[2]["Target frequency (Hz)"] == "0.000000"
    unlimited = FrequencyStatus(FrequencyStatusParam({"min": 1}), clock=clock)
    unlimited.tick()
    level, text, values = judged(unlimited)
    assert (level, text, values["Actual frequency (Hz)"]) == (OK, "Desired frequency met", "inf")
    assert "Maximum acceptable frequency (Hz)" not in values
    with pytest.raises(ValueError, match="window_size must be at least 1, not 0"):
        FrequencyStatusParam({"min": 1}, window_size=0)


def test_stamps() -> None:
    clock = StillClock()
    task = TimeStampStatus(TimeStampStatusParam(-1, 5), clock=clock)
    assert judged(task)[:2] == (WARN, "No data since last update.")
    for ages, found in (
        ((-2,), (ERROR, "Timestamps too far in future seen.")),
        ((0, 4, -1), (OK, "Timestamps are reasonable.")),
        ((0, 6), (ERROR, "Timestamps too far in past seen.")),
        ((0, 1000), (ERROR, "Zero timestamp seen.")),
        ((1000,), (WARN, "No data since last update.")),
    ):
        for age in ages:
            task.tick(clock.seconds - age)
        assert judged(task)[:2] == found
    task.tick(Time(nanoseconds=998_500_000_000))
    assert judged(task)[2] == {
        "Earliest timestamp delay:": "1.500000",
        "Latest timestamp delay:": "1.500000",
        "Earliest acceptable timestamp delay:": "-1.000000",
        "Latest acceptable timestamp delay:": "5.000000",
        "Late diagnostic update count:": "1",
        "Early diagnostic update count:": "1",
        "Zero seen diagnostic update count:": "1",
    }


def test_several_in_one() -> None:
    both = CompositeDiagnosticTask("both")
    both.addTask(Heartbeat())
    both.addTask(
        FunctionDiagnosticTask("warm", lambda status: status.summary(WARN, "warm"))
    )  # returns nothing
    both.addTask(FunctionDiagnosticTask("idle", lambda status: status))
    status = DiagnosticStatusWrapper(level=ERROR, message="No message was set")
    assert both.run(status) is status
    assert (status.level, status.message) == (ERROR, "warm; No message was set")


def test_a_rate_at_its_limits_is_fine() -> None:
    for bound in ({"min": 8.0}, {"min": 2.0, "max": 8.0 / 3.0}):
        clock = StillClock()
        task = FrequencyStatus(FrequencyStatusParam(bound, 0.5, 1), clock=clock)
        clock.seconds += 0.25
        task.tick()
        assert judged(task)[:2] == (OK, "Desired frequency met")
