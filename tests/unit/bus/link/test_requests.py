"""bus.link.requests: how long a client waits for answers. The test has its own clock."""

import asyncio
import logging
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from bus.errors import ConnectionClosed
from bus.link import requests as module
from bus.link.reach import TELL_S
from bus.link.requests import ANSWER_S, Requests


class Timer:
    def __init__(self, due_s: float, callback: Callable[[], None]) -> None:
        self.due_s = due_s
        self.callback = callback
        self.is_cancelled = False

    def cancel(self) -> None:
        self.is_cancelled = True


class Wait:
    """Requests to a broker, and a clock that the test sets."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 100.0
        self.futures = asyncio.new_event_loop()
        self.timers: list[Timer] = []
        self.path = "/busd.sock"
        self.heard_ns = 0
        self.is_quiet = True
        self.warnings: list[str] = []
        loop = SimpleNamespace(create_future=self.futures.create_future, call_later=self.call_later)
        monkeypatch.setattr(asyncio, "get_running_loop", lambda: loop)
        monkeypatch.setattr(module, "monotonic_ns", self.now_ns)
        monkeypatch.setattr(module, "_log", SimpleNamespace(warning=self.warnings.append))
        self.requests = Requests(self)

    def now_ns(self) -> int:
        return int(self.now_s * 1e9)

    def call_later(self, delay_s: float, callback: Callable[[], None]) -> Timer:
        timer = Timer(self.now_s + delay_s, callback)
        self.timers.append(timer)
        return timer

    def hear(self) -> None:
        self.heard_ns = self.now_ns()

    def pass_time(self, seconds: float, *, late_s: float = 0.0) -> None:
        """Run the timers that are due, each `late_s` too late."""
        end_s = self.now_s + seconds
        while due := [one for one in self.timers if one.due_s <= end_s and not one.is_cancelled]:
            timer = min(due, key=lambda one: one.due_s)
            self.timers.remove(timer)
            self.now_s = max(self.now_s, timer.due_s + late_s)
            timer.callback()
        self.now_s = max(self.now_s, end_s)


@pytest.fixture
def wait(monkeypatch: pytest.MonkeyPatch) -> Iterator[Wait]:
    wait = Wait(monkeypatch)
    yield wait
    wait.futures.close()


def failed(answer: "asyncio.Future[Any]") -> str:
    error = answer.exception()
    assert isinstance(error, TimeoutError)
    return str(error)


def test_a_silent_broker_is_given_up(wait: Wait) -> None:
    answer = wait.requests.begin(1)
    wait.pass_time(TELL_S - 0.01)
    assert not wait.warnings
    wait.pass_time(0.02)
    assert wait.warnings == ["busd at /busd.sock has said nothing for 5 s; still waiting for its answer"]
    wait.pass_time(ANSWER_S - TELL_S - 0.02)
    assert not answer.done()
    wait.pass_time(0.02)
    assert failed(answer) == "busd at /busd.sock does not answer: it has said nothing for 10 s"
    assert len(wait.warnings) == 1
    assert not wait.timers


def test_one_that_says_something_is_not(wait: Wait) -> None:
    answer = wait.requests.begin(1)
    for _ in range(20):
        wait.pass_time(4.0)
        wait.hear()
    assert not answer.done()
    assert not wait.warnings
    wait.pass_time(ANSWER_S)
    assert failed(answer)


def test_the_log_says_it_again_after_a_sign_of_life(wait: Wait) -> None:
    wait.requests.begin(1)
    for count in (1, 2):
        wait.pass_time(TELL_S + 1)
        assert len(wait.warnings) == count
        wait.hear()


def test_each_has_its_own_time(wait: Wait) -> None:
    first = wait.requests.begin(1)
    wait.pass_time(3.0)
    second = wait.requests.begin(2)
    assert len(wait.timers) == 1, "they share one timer"
    wait.pass_time(ANSWER_S - 3.0)
    assert failed(first)
    assert not second.done()
    wait.pass_time(3.0)
    assert failed(second)
    assert len(wait.warnings) == 1


def test_one_that_is_answered_is_not_waited_for(wait: Wait) -> None:
    answer = wait.requests.begin(1)
    answer.set_result("the answer")
    wait.pass_time(2 * ANSWER_S)
    assert answer.result() == "the answer"
    assert not wait.warnings
    assert not wait.timers


def test_what_has_come_and_was_not_read_may_be_the_answer(wait: Wait) -> None:
    answer = wait.requests.begin(1)
    wait.is_quiet = False
    wait.pass_time(ANSWER_S + 1)
    assert not answer.done()
    assert not wait.warnings
    assert [one.due_s - wait.now_s < 0.06 for one in wait.timers] == [True]
    wait.is_quiet = True
    wait.pass_time(0.1)
    assert failed(answer)


@pytest.mark.parametrize(("late_s", "is_given_up"), [(0.9, True), (1.1, False)])
def test_a_standstill_of_this_process_does_not_count(wait: Wait, late_s: float, is_given_up: bool) -> None:
    answer = wait.requests.begin(1)
    wait.pass_time(TELL_S, late_s=late_s)
    wait.pass_time(ANSWER_S - TELL_S)
    assert answer.done() is is_given_up
    wait.pass_time(TELL_S + 2)
    assert failed(answer)


def test_the_end_of_the_connection_fails_all(wait: Wait, caplog: pytest.LogCaptureFixture) -> None:
    answers = [wait.requests.begin(number) for number in range(3)]
    answers[0].set_result("the answer")
    answers[1].cancel()
    wait.requests.end(reason := ConnectionClosed("a test"))
    assert answers[0].result() == "the answer"
    assert answers[2].exception() is reason
    assert not wait.requests.waiting
    assert all(one.is_cancelled for one in wait.timers)
    with caplog.at_level(logging.ERROR):
        del answers
    assert not caplog.records, "an error that nobody awaits is not reported"
    wait.requests.end(reason)
    later = wait.requests.begin(7)
    wait.pass_time(ANSWER_S)
    assert failed(later)
