"""A node's clock and rates: with the machine's time and with simulated time."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from bus.clock import Clock, Rate
from bus.errors import ConfigurationError, ConnectionClosed
from bus.timer import Timer
from jumping_loop import play
from rows import for_each

S = 10**9


def simulated(seconds: float = 0.0) -> Clock:
    clock = Clock("/robot")
    clock.simulate(True)
    clock.set(round(seconds * S))
    return clock


def raise_(error: BaseException) -> None:
    raise error


def now_s() -> float:
    return asyncio.get_running_loop().time()


async def turns(count: int = 5) -> None:
    """Let all other tasks run for `count` turns of the loop."""
    for _ in range(count):
        await asyncio.sleep(0)


class Sleeper:
    """Sleeps at a rate, again and again, and records the times at which it wakes."""

    def __init__(self, rate: Rate, now: Callable[[], float]) -> None:
        self.woken: list[float] = []
        self._rate = rate
        self._now = now
        self.task = asyncio.create_task(self._run())

    async def _run(self) -> None:
        while True:
            await self._rate.sleep()
            self.woken.append(self._now())


class TestBySystemTime:
    def test_the_phase_stays(self) -> None:
        async def story() -> None:
            began = now_s()
            rate = Rate(0.1, Clock("/robot"))
            woken = []
            for work_s in (0.0, 3.0, 9.0, 5.0):
                await asyncio.sleep(work_s)
                await rate.sleep()
                woken.append(now_s() - began)
            assert woken == pytest.approx([10, 20, 30, 40], abs=0.5)

        play(story)

    def test_what_was_missed_is_not_made_up_for(self) -> None:
        async def story() -> None:
            began = now_s()
            rate = Rate(0.1, Clock("/robot"))
            await asyncio.sleep(35)
            woken = []
            for _ in range(3):
                await rate.sleep()
                woken.append(now_s() - began)
            assert woken == pytest.approx([35, 40, 50], abs=0.5)

        play(story)

    def test_one_that_is_always_late_lets_others_work(self) -> None:
        async def story() -> None:
            rate = Rate(1e9, Clock("/robot"))
            others = 0

            async def work() -> None:
                nonlocal others
                while True:
                    others += 1
                    await asyncio.sleep(0)

            task = asyncio.create_task(work())
            for _ in range(20):
                await rate.sleep()
            assert others >= 10
            task.cancel()

        play(story)

    def test_a_cancelled_sleep_leaves_the_rate_as_it_is(self) -> None:
        async def story() -> None:
            began = now_s()
            clock = Clock("/robot")
            rate = Rate(0.1, clock)
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(rate.sleep(), 4.0)
            assert not clock._waiting
            await rate.sleep()
            assert now_s() - began == pytest.approx(10, abs=0.5)

        play(story)

    def test_several_sleep_by_one(self) -> None:
        async def story() -> None:
            began = now_s()
            rate = Rate(0.1, Clock("/robot"))
            sleepers = [Sleeper(rate, lambda: now_s() - began) for _ in range(3)]
            await asyncio.sleep(35)
            for one in sleepers:
                assert one.woken == pytest.approx([10, 20, 30], abs=0.5)
                one.task.cancel()

        play(story)

    def test_the_end_of_the_node_ends_the_sleep(self) -> None:
        async def story() -> None:
            clock = Clock("/robot")
            rate = Rate(0.001, clock)
            sleeping = asyncio.create_task(rate.sleep())
            await turns()
            clock.close()
            with pytest.raises(ConnectionClosed, match="node /robot is closed"):
                await sleeping
            with pytest.raises(ConnectionClosed):
                await rate.sleep()

        play(story)

    @for_each("hz", [0, -1.0, float("nan"), float("inf"), 2e9])
    def test_no_rates(self, hz: float) -> None:
        with pytest.raises(ConfigurationError, match="is not above 0 and up to 1000000000"):
            Rate(hz, Clock("/robot"))


class TestTimers:
    def test_it_goes_by_the_simulation_while_there_is_one(self) -> None:
        async def story() -> None:
            clock = Clock("/robot")
            calls: list[float] = []
            timer = Timer(1.0, lambda: calls.append(clock.steady_ns() / S), raise_, clock)
            await asyncio.sleep(2.5)
            assert (len(calls), timer.missed) == (2, 0)
            clock.simulate(True)
            await asyncio.sleep(1000)
            assert len(calls) == 2
            for at in (100, 100.5, 101, 101.9, 102.05, 105.5, 106, 50, 50.9, 51):
                clock.set(round(at * S))
            assert calls[2:] == [101, 102.05, 105.5, 106, 51]
            assert timer.missed == 2
            timer.cancel()
            clock.set(60 * S)
            timer.reset()
            clock.set(60_900_000_000)
            clock.set(61 * S)
            assert calls[7:] == [61]
            clock.simulate(False)
            await asyncio.sleep(1.5)
            assert len(calls) == 9
            timer.close()
            clock.simulate(True)
            assert timer.is_canceled and not clock.timers

        play(story)

    def test_an_async_callback_that_still_runs(self) -> None:
        async def story() -> None:
            clock = simulated(5.0)
            begun = asyncio.Semaphore(0)

            async def call() -> None:
                begun.release()
                await asyncio.Event().wait()

            timer = Timer(1.0, call, raise_, clock)
            for at in (6, 7, 8):
                clock.set(at * S)
                await turns()
            await begun.acquire()
            assert (begun.locked(), timer.calls, timer.missed) == (True, 1, 2)
            timer.close()

        play(story)

    async def test_one_that_cancels_its_neighbour(self) -> None:
        clock = simulated(5.0)
        calls: list[int] = []
        timers: list[Timer] = []

        def call() -> None:
            calls.append(1)
            for timer in timers:
                timer.cancel()

        timers += [Timer(1.0, call, raise_, clock) for _ in range(3)]
        clock.set(6 * S)
        assert calls == [1]


class TestBySimulatedTime:
    async def test_the_clock_shows_it_while_it_is_active(self) -> None:
        clock = Clock("/robot")
        clock.set(5 * S)
        assert clock.now_ns() > 10**18
        clock.simulate(True)
        assert clock.now_ns() == clock.steady_ns() == 5 * S
        clock.simulate(False)
        assert clock.now_ns() > 10**18

    async def test_a_rate_follows(self) -> None:
        clock = simulated(100.0)
        sleeper = Sleeper(Rate(10.0, clock), lambda: clock.now_ns() / S)
        for at in (100.05, 100.1, 100.15, 100.19, 100.2, 107.33, 107.39, 107.4):
            await turns()
            clock.set(round(at * S))
        await turns()
        assert sleeper.woken == [100.1, 100.2, 107.33, 107.4]
        sleeper.task.cancel()

    async def test_after_a_jump_back_the_period_is_counted_anew(self) -> None:
        clock = simulated(100.0)
        sleeper = Sleeper(Rate(1.0, clock), lambda: clock.now_ns() / S)
        for at in (101.0, 50.0, 50.9, 51.0, 51.9, 52.0):
            await turns()
            clock.set(round(at * S))
        await turns()
        assert sleeper.woken == [101.0, 51.0, 52.0]
        sleeper.task.cancel()

    async def test_a_jump_back_while_nobody_sleeps(self) -> None:
        clock = simulated(100.0)
        rate = Rate(1.0, clock)
        clock.set(5 * S)
        clock.set(6 * S)
        sleeping = asyncio.create_task(rate.sleep())
        await turns()
        clock.set(6_500_000_000)
        await turns()
        assert not sleeping.done()
        clock.set(7 * S)
        await sleeping

    @pytest.mark.parametrize("from_simulation", [True, False])
    def test_another_source_of_time(self, from_simulation: bool) -> None:
        async def story() -> None:
            clock = simulated(100.0)
            clock.simulate(from_simulation)
            sleeping: Any = asyncio.create_task(Rate(0.1, clock).sleep())
            await turns()
            clock.simulate(not from_simulation)
            await turns()
            if from_simulation:
                await asyncio.sleep(9)
                assert not sleeping.done()
                await asyncio.sleep(2)
            else:
                await asyncio.sleep(1000)
                assert not sleeping.done()
                clock.set(110 * S)
                await turns()
            assert sleeping.done()

        play(story)
