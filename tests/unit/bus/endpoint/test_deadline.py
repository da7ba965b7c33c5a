"""bus.endpoint.deadline: when it reports, and its end. No event loop, no clock."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from bus.endpoint import deadline
from bus.endpoint.deadline import DeadlineWatch

DEADLINE_NS = 1_000


class Loop:
    """The timers of a loop; its time is set by `pass_to`."""

    def __init__(self) -> None:
        self.now_ns = 0
        self.calls: dict[object, tuple[int, Callable[[], object]]] = {}

    def later(self, delay_s: float, call: Callable[[], object], /) -> Any:
        timer = Timer(self)
        self.calls[timer] = self.now_ns + round(delay_s * 1e9), call
        return timer

    def pass_to(self, now_ns: int) -> None:
        """Let time pass, with all calls that become due."""
        while self.calls:
            timer, (due_ns, call) = min(self.calls.items(), key=lambda item: item[1][0])
            if due_ns > now_ns:
                break
            del self.calls[timer]
            self.now_ns = due_ns
            call()
        self.now_ns = now_ns


class Timer(asyncio.TimerHandle):
    def __init__(self, loop: Loop) -> None:
        self._of = loop

    __hash__ = object.__hash__

    def cancel(self) -> None:
        self._of.calls.pop(self, None)


@pytest.fixture
def loop(monkeypatch: pytest.MonkeyPatch) -> Loop:
    made = Loop()
    monkeypatch.setattr(deadline, "monotonic_ns", lambda: made.now_ns)
    return made


def test_each_deadline_without_a_message_is_reported(loop: Loop) -> None:
    missed: list[int] = []
    newest_ns = 0
    watch = DeadlineWatch(loop, DEADLINE_NS, lambda: newest_ns, lambda: missed.append(loop.now_ns))
    loop.pass_to(5_000)
    assert missed == []  # the first message starts it
    watch.last_ns = 5_000
    loop.pass_to(5_900)
    newest_ns = 5_900  # as by ring
    loop.pass_to(6_800)
    assert missed == []
    loop.pass_to(9_000)
    assert missed == [6_900, 7_900, 8_900]
    watch.end()
    loop.pass_to(20_000)
    assert len(missed) == 3 and not loop.calls


def test_the_report_may_end_the_watch(loop: Loop) -> None:
    """A callback may close its endpoint."""
    watch = DeadlineWatch(loop, DEADLINE_NS, lambda: 0, lambda: watch.end())
    watch.last_ns = 10
    loop.pass_to(20_000)
    assert not loop.calls
