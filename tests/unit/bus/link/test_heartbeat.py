"""bus.link.heartbeat: the time of the next heartbeat, and how long an event loop stood still."""

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest

from bus.link import heartbeat as module
from bus.link.heartbeat import LATE_NS, Heartbeat
from bus.process import shared_loop
from rows import for_each

S = 1_000_000_000


class Loop:
    def __init__(self) -> None:
        self.timers: list[tuple[Any, ...]] = []
        self.cancelled = 0

    def call_later(self, *timer: Any) -> Any:
        self.timers.append(timer)
        return SimpleNamespace(cancel=self.cancel)

    def cancel(self) -> None:
        self.cancelled += 1


class Resting(Loop):
    rests = True


def begun(monkeypatch: pytest.MonkeyPatch, loop: Any) -> Heartbeat:
    """A heartbeat started at 100 s, with an interval of 3 s."""
    monkeypatch.setattr(asyncio, "get_running_loop", lambda: loop)
    monkeypatch.setattr(module, "monotonic_ns", lambda: 100 * S)
    heartbeat = Heartbeat(print)
    heartbeat.stop()  # it is not running, so this changes nothing
    assert heartbeat.start(3.0) == 103 * S + LATE_NS
    return heartbeat


def test_each_start_replaces_the_one_before(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = Loop()
    heartbeat = begun(monkeypatch, loop)
    heartbeat.start(1.0)
    assert loop.timers == [(3.0, print, 3.0), (1.0, print, 1.0)]
    assert loop.cancelled == 1
    heartbeat.stop()
    assert loop.cancelled == 2


@for_each(
    ("now_s", "turn_s", "text"),
    [
        (109, 0, ""),  # shorter than the lease
        (110, 0, "7 to 10 s"),
        (110, 99, "7 to 10 s"),  # a turn before the heartbeat was started tells nothing
        (110, 102, "8 s"),
        (403, 0, "300 to 303 s"),
    ],
)
def test_how_long_the_loop_stood_still(now_s: int, turn_s: int, text: str) -> None:
    with pytest.MonkeyPatch.context() as monkeypatch:
        heartbeat = begun(monkeypatch, Loop())
        assert heartbeat.standstill(now_s * S, turn_s * S, 10.0) == text


def test_a_few_parts_of_a_second_are_one_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(asyncio, "get_running_loop", Loop)
    monkeypatch.setattr(module, "monotonic_ns", lambda: 100 * S)
    heartbeat = Heartbeat(print)
    heartbeat.start(0.1)
    assert heartbeat.standstill(120 * S, 0, 10.0) == "20 s"


def test_a_loop_that_rests_stands_still_for_good_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_loop, "GuardedLoop", Resting)
    loop = Resting()
    heartbeat = begun(monkeypatch, loop)
    assert heartbeat.standstill(200 * S, 0, 10.0) == ""
    loop.rests = False
    assert heartbeat.standstill(200 * S, 0, 10.0)
