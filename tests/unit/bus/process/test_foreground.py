"""The loop of the blocking API: one for each thread. It runs while a call waits, and ends with its last
user.
"""

import asyncio
import signal
import threading
import time
from collections.abc import Iterator

import pytest

from bus.errors import ConfigurationError, LocalProtocolError
from bus.process.foreground import Condition, Foreground, Signal, deadline_after
from bus.process.termination import Terminated
from conftest import WAIT_S
from rows import for_each

SECOND_NS = 10**9


@pytest.fixture
def foreground() -> Iterator[Foreground]:
    foreground = Foreground.acquire("something else")
    yield foreground
    foreground.release()


def test_a_thread_has_one_for_all_and_another_thread_another(foreground: Foreground) -> None:
    again = Foreground.acquire("something else")
    assert again is foreground
    again.release()
    assert not foreground.loop.is_closed()
    others: list[Foreground] = []

    def acquire() -> None:
        others.append(Foreground.acquire("something else"))
        others[0].release()

    thread = threading.Thread(target=acquire)
    thread.start()
    thread.join(WAIT_S)
    assert others[0] is not foreground and others[0].loop.is_closed()


def test_signals_are_given_back_with_the_last_one() -> None:
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    foreground = Foreground.acquire("something else")
    assert signal.getsignal(signal.SIGTERM) == foreground._on_signal
    foreground.release()
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


async def test_not_where_an_event_loop_runs() -> None:
    with pytest.raises(LocalProtocolError, match="must not be blocked: use the other way"):
        Foreground.acquire("the other way")


def test_what_is_there_already_is_not_waited_for(foreground: Foreground) -> None:
    began_s = time.monotonic()
    with foreground.loop:
        assert foreground.wait(Condition(lambda: True), time.monotonic_ns() + 60 * SECOND_NS)
    assert time.monotonic() - began_s < 30


def test_what_takes_too_long_is_cancelled(foreground: Foreground) -> None:
    ends: list[str] = []

    async def sleep() -> None:
        try:
            await asyncio.Event().wait()
        finally:
            ends.append("cancelled")

    with pytest.raises(TimeoutError, match=r"it did not come within 0\.01 s"):
        foreground.run_or_tell(sleep, 0.01, lambda: "it did not come")
    assert ends == ["cancelled"]


def test_an_error_of_its_own_stays(foreground: Foreground) -> None:
    async def fail() -> None:
        raise TimeoutError("of its own")

    with pytest.raises(TimeoutError, match="of its own"):
        foreground.run_or_tell(fail, 1, lambda: "it did not come")


@pytest.mark.parametrize(
    ("number", "kind"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, Terminated)]
)
def test_a_signal_ends_a_wait(
    foreground: Foreground,
    number: signal.Signals,
    kind: type[KeyboardInterrupt],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A signal that comes during a callback of the loop ends the wait after that callback."""
    went_on: list[bool] = []
    monkeypatch.setattr("bus.process.foreground.say_nothing_of_signals", lambda: None)

    def interrupt() -> None:
        signal.raise_signal(number)
        went_on.append(True)

    with pytest.raises(kind) as caught, foreground.loop:
        foreground.loop.call_soon(interrupt)
        foreground.wait(Signal())
    assert went_on == [True] and type(caught.value) is kind


@for_each("timeout", [-0.1, 1e10, float("nan"), "1"])
def test_times_that_are_none(timeout: float) -> None:
    with pytest.raises(ConfigurationError, match="is not a number of seconds from 0, or None"):
        deadline_after(timeout)


def test_who_publishes_without_a_pause_asks_the_system_rarely(
    foreground: Foreground, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop, asked, called = foreground.loop, 0, 0
    has_events = loop.has_events

    def ask() -> bool:
        nonlocal asked
        asked += 1
        return has_events()

    def call() -> None:
        nonlocal called
        called += 1

    monkeypatch.setattr(loop, "has_events", ask)
    begin = time.monotonic()
    for _ in range(10_000):
        foreground.attend_often()
    assert 1 <= asked <= (time.monotonic() - begin) / 0.0001 + 1
    for number in range(100):  # due callbacks run at once
        loop.call_soon(call)
        foreground.attend_often()
        assert called == number + 1
