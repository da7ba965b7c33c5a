"""The judge of calls finds each fault."""

import asyncio

import pytest

import bus
from chaos import calls as module
from chaos.calls import Calls, Doubled
from semantics import until


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_EVERY_S", 0.0)
    monkeypatch.setattr(module, "_END_S", 0.01)


async def test_answers_and_errors_are_ends() -> None:
    async def ask(number: int) -> int:
        calls.done[number] += 1
        if number % 2:
            raise bus.ServiceError("/s", "odd")
        return number

    calls = Calls("s", ask)
    async with calls.running():
        await calls.flows()
        await calls.settle()
    assert calls.failed and 2 in calls.answered


@pytest.mark.parametrize(("times", "more"), [(2, 0), (1, 1)])
async def test_a_call_that_is_carried_out_twice_or_has_another_answer(times: int, more: int) -> None:
    async def ask(number: int) -> int:
        calls.done[number] += times
        return number + more

    calls = Calls("s", ask)
    async with calls.running():
        await until(lambda: calls.answered)
        with pytest.raises(Doubled):
            await calls.settle()


async def test_a_call_without_an_end() -> None:
    async def ask(number: int) -> int:
        return await asyncio.Future()

    calls = Calls("s", ask)
    async with calls.running():
        await until(lambda: calls.begun)
        with pytest.raises(AssertionError, match="without an end"):
            await calls.settle()
