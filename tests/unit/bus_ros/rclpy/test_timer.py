"""The times of a timer's calls, by a clock of the test."""

from typing import Any, cast

from bus_ros.rclpy.time import Time
from bus_ros.rclpy.timer import BaseTimer

PERIOD_NS = 100


class Clock:
    """Simulated time, which the test sets."""

    ros_time_is_active = True

    def __init__(self) -> None:
        self.ns = 1000

    def now(self) -> Time:
        return Time(nanoseconds=self.ns)


class Times(BaseTimer):
    """A timer without callback."""

    is_destroyed = False

    def __init__(self) -> None:
        self.ticks = Clock()
        super().__init__(PERIOD_NS, cast(Any, self.ticks), autostart=True)

    def _times_changed(self) -> None:
        pass


def test_calls_that_were_missed_are_skipped_and_the_phase_stays() -> None:
    timer = Times()
    timer.ticks.ns = 1100
    assert timer.is_ready()
    timer._advance(1100)
    assert timer.time_until_next_call() == 100
    timer.ticks.ns = 1550  # the calls of 1200 to 1500 are due: one is made
    timer._advance(1550)
    assert not timer.is_ready()
    assert timer.time_until_next_call() == 50


def test_a_call_at_the_time_of_the_next_one_skips_that() -> None:
    timer = Times()
    timer.ticks.ns = 1200
    timer._advance(1200)
    assert timer.time_until_next_call() == 100


def test_a_reset_ends_a_cancellation_and_begins_a_period() -> None:
    timer = Times()
    timer.cancel()
    timer.ticks.ns = 1450
    assert not timer.is_ready() and timer.time_until_next_call() is None
    timer.reset()
    assert not timer.is_canceled() and timer.time_until_next_call() == 100
    timer.ticks.ns = 1550
    assert timer.is_ready()
