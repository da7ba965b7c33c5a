"""bus_web.foxglove.tasks: bounds on the number and size of a client's calls in progress."""

import asyncio

import pytest

from bus_web.foxglove import tasks as module
from bus_web.foxglove.tasks import Tasks


async def test_number_and_bytes_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MOST", 2)
    monkeypatch.setattr(module, "_MOST_BYTES", 10)
    tasks, may_end = Tasks(), asyncio.Event()

    async def work() -> None:
        await may_end.wait()

    assert tasks.begin(work(), 11), "a single one may be larger"
    assert not tasks.begin(work(), 0), "its bytes count"
    may_end.set()
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    may_end.clear()
    assert tasks.begin(work(), 5)
    assert not tasks.begin(work(), 6)
    assert tasks.begin(work(), 5)
    assert not tasks.begin(work())


async def test_all_end_when_they_are_cancelled() -> None:
    tasks, ended = Tasks(), []

    async def work() -> None:
        try:
            await asyncio.Event().wait()
        finally:
            ended.append(1)

    assert tasks.begin(work())
    assert tasks.begin(work())
    await asyncio.sleep(0)
    await tasks.cancel()
    assert ended == [1, 1]
