"""bus.timer: calls at a period, and changes of the period."""

import asyncio
from typing import Any

import pytest

from bus.clock import Clock
from bus.errors import ConfigurationError, ConnectionClosed
from bus.timer import Timer
from jumping_loop import play
from rows import for_each

S = 10**9


class World:
    """A timer, and the times of its calls in whole seconds since it was made: the machine's own time goes on,
    too."""

    def __init__(self, period_s: float, clock: Clock | None = None) -> None:
        self.clock = clock or Clock("/robot")
        self.calls: list[int] = []
        self.errors: list[BaseException] = []
        self._begin_ns = self.clock.steady_ns()
        self.timer = Timer(period_s, self._note, self.errors.append, self.clock)

    def _note(self) -> None:
        self.calls.append(round((self.clock.steady_ns() - self._begin_ns) / S))
        self.then()

    def then(self) -> None:
        """The callback calls this, too."""


def test_a_shorter_period_holds_from_the_last_call_on() -> None:
    async def story() -> None:
        world = World(10)
        await asyncio.sleep(12)
        world.timer.period = 3
        await asyncio.sleep(8)
        assert world.calls == [10, 13, 16, 19]
        assert (world.timer.period, world.timer.period_s, world.timer.missed) == (3, 3, 0)

    play(story)


def test_the_next_call_comes_at_once_if_its_time_is_past() -> None:
    async def story() -> None:
        world = World(1000)
        await asyncio.sleep(50)
        world.timer.period = 20
        assert not world.calls  # the assignment itself makes no call
        await asyncio.sleep(45)
        assert (world.calls, world.timer.missed) == ([50, 70, 90], 0)

    play(story)


def test_a_longer_period() -> None:
    async def story() -> None:
        world = World(10)
        await asyncio.sleep(15)
        world.timer.period = 30
        await asyncio.sleep(60)
        assert world.calls == [10, 40, 70]

    play(story)


def test_from_within_the_callback() -> None:
    async def story() -> None:
        world = World(1)

        def grow() -> None:
            world.timer.period *= 2

        world.then = grow  # type: ignore[method-assign]
        await asyncio.sleep(40)
        assert world.calls == [1, 3, 7, 15, 31]
        assert not world.errors

    play(story)


@for_each(("method", "expected"), [("cancel", [10, 20]), ("reset", [10, 20, 35, 45, 55])])
def test_the_callback_cancels_or_resets_its_timer(method: str, expected: list[float]) -> None:
    async def story() -> None:
        world = World(10)
        loop: Any = asyncio.get_running_loop()

        def stop() -> None:
            if len(world.calls) == 2:
                loop.jumped_s += 5  # a reset counts from this time
                getattr(world.timer, method)()

        world.then = stop  # type: ignore[method-assign]
        await asyncio.sleep(58)
        assert (world.calls, world.timer.missed) == (expected, 0)

    play(story)


def test_an_exception_does_not_end_it() -> None:
    async def story() -> None:
        world = World(10)
        world.then = lambda: world.calls.append(1 // 0)  # type: ignore[method-assign]
        await asyncio.sleep(35)
        assert world.calls == [10, 20, 30]
        assert [type(error) for error in world.errors] == [ZeroDivisionError] * 3

    play(story)


def test_the_same_period_again_puts_nothing_off() -> None:
    async def story() -> None:
        world = World(10)
        for _ in range(5):
            await asyncio.sleep(6)
            world.timer.period = 10.0
        assert world.calls == [10, 20, 30]

    play(story)


def test_a_canceled_timer_stays_canceled() -> None:
    async def story() -> None:
        world = World(10)
        world.timer.cancel()
        world.timer.period = 2
        await asyncio.sleep(100)
        assert (world.calls, world.timer.is_canceled) == ([], True)
        world.timer.reset()
        await asyncio.sleep(5)
        assert world.calls == [102, 104]

    play(story)


async def test_by_simulated_time() -> None:
    clock = Clock("/robot")
    clock.simulate(True)
    clock.set(100 * S)
    world = World(10, clock)
    world.timer.period = 4
    for at in (103, 104, 107, 108):
        clock.set(at * S)
    assert world.calls == [4, 8]
    world.timer.close()


@for_each("period", [-0.1, float("nan"), float("inf"), 1.1e9, "0.5", None, [1]])
def test_no_periods(period: Any) -> None:
    async def story() -> None:
        text = "is not a number of seconds from 0 to 1000000000"
        with pytest.raises(ConfigurationError, match=text):
            World(period)
        world = World(10)
        with pytest.raises(ConfigurationError, match=text):
            world.timer.period = period
        assert world.timer.period == 10
        await asyncio.sleep(15)
        assert world.calls == [10]

    play(story)


def test_a_period_of_zero_leaves_the_loop_its_turns() -> None:
    async def story() -> None:
        world = World(0)
        for _ in range(100):
            await asyncio.sleep(0)
        world.timer.cancel()
        assert 10 < len(world.calls) <= 100
        assert world.timer.missed == 0

    play(story)


async def test_a_period_after_that_of_zero() -> None:
    clock = Clock("/robot")
    clock.set(S)
    clock.simulate(True)
    world = World(0, clock)
    clock.set(100 * S)
    world.timer.period = 10
    for now_s in (105, 110):
        clock.set(now_s * S)
    assert world.calls == [99, 109]


def test_calls_that_came_too_late_are_skipped() -> None:
    async def story() -> None:
        world = World(10)
        loop: Any = asyncio.get_running_loop()

        def stand_still() -> None:
            if len(world.calls) == 1:
                loop.jumped_s += 25

        world.then = stand_still  # type: ignore[method-assign]
        await asyncio.sleep(65)
        assert world.calls == [10, 35, 40, 50, 60]
        assert (world.timer.calls, world.timer.missed) == (5, 1)

    play(story)


async def test_a_closed_node_has_no_timers() -> None:
    world = World(10)
    world.timer.close()
    world.clock.close()
    with pytest.raises(ConnectionClosed, match="node /robot is closed"):
        world.timer.reset()
    assert world.timer.is_canceled
    world.timer.period = 1
    world.timer.cancel()
