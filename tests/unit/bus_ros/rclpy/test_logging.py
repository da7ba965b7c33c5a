"""Loggers of the facade: filters and their rules, levels, names."""

import itertools
import logging as python_logging
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from bus.logger import LogEntry
from bus_ros.rclpy import logging
from bus_ros.rclpy.clock import ROSClock
from bus_ros.rclpy.impl import rcutils_logger
from bus_ros.rclpy.impl.implementation_singleton import rclpy_implementation
from bus_ros.rclpy.impl.rcutils_logger import Once, RcutilsLogger, SkipFirst, Throttle
from bus_ros.rclpy.logging import LoggingSeverity
from bus_ros.rclpy.time import ClockType, Time

_numbers = itertools.count()


@pytest.fixture
def log() -> RcutilsLogger:
    """A logger with its own level and sinks, which no other test uses."""
    return logging.get_logger(f"rclpy_test_{next(_numbers)}")


@pytest.fixture
def entries(log: RcutilsLogger) -> Iterator[list[LogEntry]]:
    found: list[LogEntry] = []
    log.add_sink(found.append)
    yield found
    log.remove_sink(found.append)


@pytest.fixture
def levels() -> Iterator[None]:
    yield
    logging.clear_config()


def simulated(seconds: float) -> ROSClock:
    clock = ROSClock()
    clock.set_ros_time_override(Time(seconds=seconds, clock_type=ClockType.ROS_TIME))
    clock._set_ros_time_is_active(True)
    return clock


def test_lines_and_places(
    log: RcutilsLogger, entries: list[LogEntry], capsys: pytest.CaptureFixture[str]
) -> None:
    assert log.debug("hidden") is False
    assert log.info("a") and log.warn("b") and log.warning("c") and log.error("d") and log.fatal("e")
    assert log.log("f", LoggingSeverity.WARN)
    lines = capsys.readouterr().err.splitlines()
    assert re.fullmatch(r"\[INFO\] \[\d+\.\d{9}\] \[rclpy_test_\d+\]: a", lines[0])
    assert [line.split("]")[0][1:] for line in lines] == ["INFO", "WARN", "WARN", "ERROR", "FATAL", "WARN"]
    assert {(entry.file, entry.function) for entry in entries} == {(__file__, "test_lines_and_places")}


def test_once_and_skip_first(log: RcutilsLogger, entries: list[LogEntry]) -> None:
    for number in range(3):
        log.info(f"once {number}", once=True)
        log.info(f"not first {number}", skip_first=True)
        log.info(f"second {number}", skip_first=True, once=True)
        log.info(f"all {number}", once=False)
    assert [entry.text for entry in entries] == [
        "once 0",
        "all 0",
        "not first 1",
        "second 1",
        "all 1",
        "not first 2",
        "all 2",
    ]


def test_throttle_by_the_steady_clock(
    log: RcutilsLogger, entries: list[LogEntry], monkeypatch: pytest.MonkeyPatch
) -> None:
    now_ns = iter([0, 900_000_000, 1_000_000_000, 1_900_000_000, 2_000_000_000])
    monkeypatch.setattr(rcutils_logger.time, "monotonic_ns", lambda: next(now_ns))  # type: ignore[attr-defined]
    logged = [log.info(number, throttle_duration_sec=1) for number in range(5)]
    assert logged == [True, False, True, False, True]


def test_throttle_by_a_clock_of_the_program(log: RcutilsLogger) -> None:
    clock = simulated(0)
    logged = []
    for seconds in (0, 4, 5, 9, 10, 2):  # 2 is the restart of the simulation
        clock.set_ros_time_override(Time(seconds=seconds, clock_type=ClockType.ROS_TIME))
        logged.append(log.warn("x", throttle_duration_sec=5.0, throttle_time_source_type=clock))  # type: ignore[call-arg]
    assert logged == [False, False, True, False, True, True]


def test_filters_belong_to_the_place_that_calls(log: RcutilsLogger, entries: list[LogEntry]) -> None:
    log.info("a", once=True), log.info("b", once=True)
    same = lambda text: log.info(text, once=True)  # noqa: E731
    same("c")
    same("d")
    assert [entry.text for entry in entries] == ["a", "b", "c"]


def test_what_must_not_change_at_one_place(log: RcutilsLogger) -> None:
    def call(severity: int, **filters: Any) -> bool:
        return log.log("x", severity, **filters)

    def call_again(severity: int, **filters: Any) -> bool:
        return log.log("x", severity, **filters)

    assert call(20)
    with pytest.raises(ValueError, match=r"Logger severity cannot be changed between calls."):
        call(30)
    with pytest.raises(ValueError, match=r"Requested logging filters cannot be changed between calls."):
        call(20, once=True)
    with pytest.raises(ValueError, match=r"Logger name cannot be changed between calls."):
        call(20, name="other")
    assert call(20, once=False)
    assert call_again(20, throttle_duration_sec=1.0)
    with pytest.raises(ValueError, match=r"Logging filter parameters cannot be changed between calls."):
        call_again(20, throttle_duration_sec=2.0)


def test_filters_that_make_no_sense(log: RcutilsLogger) -> None:
    with pytest.raises(TypeError, match='parameter "onec" is not one of the recognized logging options'):
        log.info("x", onec=True)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="got multiple values for argument 'severity'"):
        log.info("x", severity=20)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match='required parameter "throttle_duration_sec" not specified'):
        log.info("x", throttle_time_source_type=simulated(0))  # type: ignore[call-arg]
    with pytest.raises(ValueError, match='throttle_time_source_type of "SUN" is not a clock instance'):
        log.info("x", throttle_duration_sec=1, throttle_time_source_type="SUN")  # type: ignore[call-arg]
    assert log.info("x", throttle_duration_sec=1, throttle_time_source_type="RCUTILS_STEADY_TIME")  # type: ignore[call-arg]


def test_a_severity_that_is_off_looks_at_nothing(log: RcutilsLogger) -> None:
    class Text:
        def __str__(self) -> str:
            raise AssertionError("nobody reads it")

    for severity in (10, 10):
        assert log.log(Text(), severity, nonsense=1) is False
    assert log.debug(Text(), once=True) is False
    log.set_level("debug")
    assert log.debug("now", once=True)


def test_levels(log: RcutilsLogger, levels: None) -> None:
    child = log.get_child("sub")
    assert child.name == f"{log.name}.sub"
    log.set_level(LoggingSeverity.ERROR)
    assert child.get_effective_level() is LoggingSeverity.ERROR
    assert logging.get_logger_level(log.name) is LoggingSeverity.ERROR
    assert logging.get_logger_level(child.name) is LoggingSeverity.UNSET
    assert not child.is_enabled_for(LoggingSeverity.WARN) and child.is_enabled_for(LoggingSeverity.FATAL)
    logging.set_logger_level(log.name, LoggingSeverity.UNSET)
    logging.set_logger_level("", 40)
    assert logging.get_logger_effective_level(child.name) is LoggingSeverity.ERROR
    with pytest.raises(ValueError, match="11"):
        log.set_level(11)
    logging.clear_config()
    assert log.get_effective_level() is LoggingSeverity.INFO


def test_the_root_logger_without_a_level_logs_everything(log: RcutilsLogger, levels: None) -> None:
    for unset in (LoggingSeverity.UNSET, 0):
        logging.set_logger_level("", unset)
        assert logging.get_logger_level("") is LoggingSeverity.UNSET
        assert logging.get_logger_effective_level("") is LoggingSeverity.UNSET
        assert log.get_effective_level() is LoggingSeverity.UNSET
        assert log.is_enabled_for(LoggingSeverity.DEBUG)
        logging.set_logger_level(log.name, LoggingSeverity.WARN)
        assert log.get_effective_level() is LoggingSeverity.WARN
        logging.clear_config()
        assert logging.get_logger_level("") is LoggingSeverity.INFO
        assert log.get_effective_level() is LoggingSeverity.INFO


def test_clear_config_forgets_the_loggers_own_levels(log: RcutilsLogger, levels: None) -> None:
    log.set_level(50)
    stranger = python_logging.getLogger("stranger")
    stranger.setLevel(30)
    logging.clear_config()
    assert log.get_effective_level() is LoggingSeverity.INFO
    assert stranger.level == 30
    stranger.setLevel(0)


def test_names(log: RcutilsLogger, entries: list[LogEntry]) -> None:
    with pytest.raises(ValueError, match=r"Logger name must not be empty."):
        logging.get_logger("")
    with pytest.raises(ValueError, match=r"Child logger name must not be empty."):
        log.get_child("")
    assert RcutilsLogger().get_child("a").name == "a"
    other = f"{log.name}.other"
    for _ in range(2):
        log.log("x", 20, name=other, once=True)
        log.info("y", name=other, once=True)  # type: ignore[call-arg]
    assert [(entry.name, entry.text) for entry in entries] == [(other, "x"), (other, "y")]
    logging.set_logger_level(other, 40)
    assert not log.warning("z", name=other)  # type: ignore[call-arg]


def test_severities() -> None:
    assert [int(one) for one in LoggingSeverity] == [0, 10, 20, 30, 40, 50]
    assert logging.get_logging_severity_from_string("warn") is LoggingSeverity.WARN
    with pytest.raises(RuntimeError, match="'loud'"):
        logging.get_logging_severity_from_string("loud")


def test_directory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_LOG_DIR", raising=False)
    monkeypatch.delenv("ROS_HOME", raising=False)
    assert logging.get_logging_directory() == Path.home() / ".ros" / "log"
    monkeypatch.setenv("ROS_HOME", "/ros")
    assert logging.get_logging_directory() == Path("/ros/log")
    monkeypatch.setenv("ROS_LOG_DIR", "~/logs")
    assert logging.get_logging_directory() == Path.home() / "logs"


def test_names_that_programs_import() -> None:
    assert all(issubclass(one, rcutils_logger.LoggingFilter) for one in (Once, SkipFirst, Throttle))
    assert rclpy_implementation.RCLError is import_module("bus_ros.rclpy._rclpy_pybind11").RCLError
    logging.initialize()
    logging.shutdown()
