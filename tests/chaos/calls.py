"""Calls of a service, and goals of an action, from one bus to another while faults happen.

Invariants:

- Each call and each goal ends: with its answer, or with an error of the bus.
- None is carried out twice, and no answer is that of another one.
"""

import asyncio
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

import bus
from bridged_world import until
from bus.srv.example_interfaces import AddTwoInts
from bus_actions import ActionClient, ActionServer, find_action
from conftest import SOON_S

__all__ = ["Calls", "Doubled", "goals", "services"]

_EVERY_S = 0.05
_MOST = 200
"""Calls without an end. While there are so many, no further ones begin."""
_END_S = 30.0
"""Longest time until a call has ended: zenoh notices the end of a silent link after ten seconds."""
Fibonacci: Any = find_action("example_interfaces/action/Fibonacci")


class Doubled(Exception):
    """A call was carried out twice, or got the answer of another one."""


class Calls:
    """Numbered calls. `ask` makes one, raises BusError if it fails, and returns the number that was
    answered."""

    soon_s = SOON_S
    """Longest time until a call is answered after the last fault."""

    def __init__(self, name: str, ask: Callable[[int], Awaitable[int]]) -> None:
        self.name = name
        self.done: Counter[int] = Counter()
        """How often each call was carried out."""
        self.begun = 0
        self.failed = 0
        self.answered: list[int] = []
        self._ask = ask
        self._wrong: list[str] = []
        self._open: dict[int, asyncio.Task[None]] = {}

    def __str__(self) -> str:
        return f"{self.name}: {self.begun} begun, {len(self.answered)} answered, {self.failed} errors"

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Begin further calls until the end of the block."""
        task = asyncio.create_task(self._run())
        try:
            yield
        finally:
            for one in (task, *self._open.values()):
                one.cancel()
            await asyncio.gather(task, *self._open.values(), return_exceptions=True)

    async def flows(self) -> None:
        """Wait for the answer of a call that begins from now on."""
        last = self.begun
        await until(lambda: any(one > last for one in self.answered), f"an answer: {self}", self.soon_s)

    async def settle(self) -> None:
        """Wait until all present calls have ended. Raises Doubled."""
        present = dict(self._open)
        if present:
            await asyncio.wait(present.values(), timeout=_END_S)
            late = [f"{number} ({self.done[number]})" for number, task in present.items() if not task.done()]
            assert not late, (
                f"calls (carried out) without an end after {_END_S:g} s: {', '.join(late)}; {self}"
            )
        twice = [number for number, count in self.done.items() if count > 1]
        if twice or self._wrong:
            raise Doubled(f"{self}: carried out twice: {twice[:10]}; wrong answers: {self._wrong[:3]}")

    async def _run(self) -> None:
        while True:
            if len(self._open) < _MOST:
                self.begun += 1
                task = self._open[self.begun] = asyncio.create_task(self._call(self.begun))
                task.add_done_callback(lambda _, number=self.begun: self._open.pop(number))  # type: ignore[misc]
            await asyncio.sleep(_EVERY_S)

    async def _call(self, number: int) -> None:
        try:
            answered = await self._ask(number)
        except bus.BusError:
            self.failed += 1
        else:
            self.answered.append(number)
            if answered != number:
                self._wrong.append(f"{number} got {answered}")


@asynccontextmanager
async def services(name: str, server: bus.Node, client: bus.Node) -> AsyncIterator[Calls]:
    """Calls of a service `name`."""

    async def answer(request: AddTwoInts.Request) -> AddTwoInts.Response:
        calls.done[request.a] += 1
        await asyncio.sleep(request.b / 1000)
        return AddTwoInts.Response(sum=request.a)

    async def ask(number: int) -> int:
        response = await asking.call(AddTwoInts.Request(a=number, b=number % 100))
        return int(response.sum)

    calls = Calls(f"service {name}", ask)
    await server.create_service(AddTwoInts, name, answer)
    asking = await client.create_client(AddTwoInts, name)
    await asking.wait_for_service()
    async with calls.running():
        yield calls


@asynccontextmanager
async def goals(name: str, server: bus.Node, client: bus.Node) -> AsyncIterator[Calls]:
    """Goals of an action `name`."""

    async def execute(goal: Any) -> AsyncIterator[Any]:
        calls.done[goal.request.order] += 1
        for step in range(3):
            yield Fibonacci.Feedback(sequence=[step])
            await asyncio.sleep(0.03)
        yield Fibonacci.Result(sequence=[goal.request.order])

    async def ask(number: int) -> int:
        goal = await asking.send_goal(Fibonacci.Goal(order=number))
        result = await goal.result()
        return int(result.sequence[0])

    calls = Calls(f"action {name}", ask)
    async with (
        ActionServer(server, Fibonacci, name, execute),
        ActionClient(client, Fibonacci, name) as asking,
    ):
        await asking.wait_for_server()
        async with calls.running():
            yield calls
