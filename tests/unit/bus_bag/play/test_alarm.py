"""Waiting for a time, with an early wake-up."""

import asyncio
from collections.abc import AsyncIterator
from time import monotonic_ns

import pytest

from bus_bag.play.alarm import Alarm

MS = 1_000_000


@pytest.fixture(params=["kernel", "loop"])
async def clock(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Alarm]:
    if request.param == "loop":
        monkeypatch.setattr("bus.alarms.wake_up.has_kernel_timer", lambda: False)
    made = Alarm()
    yield made
    made.close()


async def wait_until(clock: Alarm, due_ns: int) -> None:
    while monotonic_ns() < due_ns:
        await clock.wait(due_ns)


async def test_it_waits_for_a_time(clock: Alarm) -> None:
    for delay_ns in (20 * MS, 5 * MS):
        begin_ns = monotonic_ns()
        await wait_until(clock, begin_ns + delay_ns)
    await clock.wait(begin_ns)
    await clock.wait(-5)


async def test_it_is_woken_also_beforehand(clock: Alarm) -> None:
    far_ns = monotonic_ns() + 3_600_000 * MS
    for due_ns in (far_ns, None):
        waiting = asyncio.create_task(clock.wait(due_ns))
        await asyncio.sleep(0)
        clock.wake()
        await waiting
        clock.wake()
        await clock.wait(due_ns)
    await wait_until(clock, monotonic_ns() + 2 * MS)


async def test_a_wait_that_was_given_up_leaves_nothing_behind(clock: Alarm) -> None:
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.001):
            await clock.wait(monotonic_ns() + 3_600_000 * MS)
    begin_ns = monotonic_ns()
    await wait_until(clock, begin_ns + 3 * MS)
