"""bus_actions.executions: the goals with a task, the goals that wait, and the effect of a cancellation."""

import asyncio

from bus_actions.executions import Executions


class Goals:
    """Goals are texts here. Their tasks last until they are cancelled or `release`d."""

    def __init__(self, at_once: int) -> None:
        self.begun: list[str] = []
        self.ended: list[str] = []
        self.released: dict[str, asyncio.Event] = {}
        self.executions = Executions[str](at_once, self.begin, self.ended.append)

    def begin(self, goal: str) -> "asyncio.Task[None]":
        self.begun.append(goal)
        self.released[goal] = asyncio.Event()
        return asyncio.get_running_loop().create_task(self.execute(goal))

    async def execute(self, goal: str) -> None:
        await self.released[goal].wait()

    def add(self, *goals: str) -> None:
        for goal in goals:
            self.executions.add(goal)

    async def release(self, goal: str) -> None:
        self.released[goal].set()
        await turns()


async def turns() -> None:
    for _ in range(5):
        await asyncio.sleep(0)


async def test_as_many_as_may_be_are_executed_side_by_side_and_the_others_in_their_order() -> None:
    goals = Goals(2)
    goals.add("a", "b", "c", "d")
    assert goals.begun == ["a", "b"]
    await goals.release("b")
    assert (goals.begun, goals.ended) == (["a", "b", "c"], ["b"])
    await goals.release("a")
    await goals.release("c")
    assert (goals.begun, goals.ended) == (["a", "b", "c", "d"], ["b", "a", "c"])
    await goals.release("d")


async def test_a_goal_that_waits_and_is_canceled_gets_no_task() -> None:
    goals = Goals(1)
    goals.add("a", "b", "c")
    assert goals.executions.cancel("b") is False
    await goals.release("a")
    assert goals.begun == ["a", "c"]
    await goals.release("c")


async def test_the_task_of_a_canceled_goal_is_cancelled_also_before_its_first_step() -> None:
    goals = Goals(2)
    goals.add("a")
    await turns()
    goals.add("b")
    assert goals.executions.cancel("a") is True
    assert goals.executions.cancel("b") is True
    await turns()
    assert sorted(goals.ended) == ["a", "b"]


async def test_stop_cancels_all_but_the_task_that_calls_it() -> None:
    goals = Goals(2)
    goals.add("a", "b", "c")
    task = goals.executions._running["a"]
    assert goals.executions.stop() == (["c"], ["a", "b"])
    await goals.executions.wait()
    await turns()
    assert task.cancelled()
    assert (goals.begun, goals.ended) == (["a", "b"], ["a", "b"])

    async def stop_and_wait() -> None:
        goals.executions.stop()
        await goals.executions.wait()

    found: list[asyncio.Task[None]] = []

    def begin(goal: str) -> "asyncio.Task[None]":
        found.append(asyncio.get_running_loop().create_task(stop_and_wait()))
        return found[0]

    goals.executions = Executions[str](1, begin, goals.ended.append)
    goals.add("d")
    await found[0]
    assert not found[0].cancelled()
