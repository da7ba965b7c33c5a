"""Several coroutines at once."""

import asyncio

import pytest

from bus.base.together import until_one_ends


class Work:
    """Ends when it is told to. `ends` has an entry for each end."""

    def __init__(self) -> None:
        self.ends: list[str] = []

    async def wait(self) -> None:
        try:
            await asyncio.Event().wait()
        except asyncio.CancelledError:
            await asyncio.sleep(0)  # it takes a turn to put things in order
            self.ends.append("cancelled")
            raise

    async def end(self) -> None:
        self.ends.append("ended")

    async def fail(self) -> None:
        raise ValueError("no")


async def test_the_others_have_ended_too() -> None:
    work = Work()
    await until_one_ends(work.wait(), work.end(), work.wait())
    assert work.ends == ["ended", "cancelled", "cancelled"]


async def test_the_error_of_the_one_that_ended() -> None:
    work = Work()
    with pytest.raises(ValueError, match="no"):
        await until_one_ends(work.wait(), work.fail())
    assert work.ends == ["cancelled"]


async def test_all_are_cancelled() -> None:
    work = Work()
    running = asyncio.ensure_future(until_one_ends(work.wait(), work.wait()))
    await asyncio.sleep(0)
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running
    assert work.ends == ["cancelled", "cancelled"]
