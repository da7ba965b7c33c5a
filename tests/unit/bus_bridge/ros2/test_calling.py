"""bus_bridge.ros2.calling: a client waits for a server, and each of its calls for its turn."""

import asyncio

import pytest

from bus_bridge.errors import BridgeError
from bus_bridge.ros2 import calling
from bus_bridge.ros2.calling import CallingClient
from bus_bridge.ros2.calls import NoServer, Response
from bus_bridge.ros2.turns import Turns

Answer = asyncio.Future[Response]


class Client(CallingClient[Answer]):
    """A client whose server and answers are the test's."""

    is_ready = False

    def __init__(self) -> None:
        super().__init__("rq/ask", Turns())

    async def _ask(self, cdr: bytes) -> Response:
        number = len(self._calls)
        self._calls[number] = asyncio.get_running_loop().create_future()
        try:
            return await self._calls[number]
        finally:
            del self._calls[number]

    def answer(self, number: int) -> None:
        self._calls[number].set_result(Response(b"answer", b"server"))

    def close(self) -> None:
        self._is_closed = True


async def begin(client: Client, count: int) -> list[asyncio.Task[Response]]:
    tasks = [asyncio.create_task(client.call(b"ask")) for _ in range(count)]
    for _ in range(3):
        await asyncio.sleep(0)
    return tasks


async def end(tasks: list[asyncio.Task[Response]]) -> None:
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def test_an_answer_gives_the_waiting_calls_their_turn() -> None:
    client = Client()
    tasks = await begin(client, 10)
    assert (len(client._calls), client.waiting) == (8, 10)
    client.answer(7)
    assert await tasks[7] == Response(b"answer", b"server")
    await asyncio.sleep(0)
    assert (len(client._calls), client.waiting) == (9, 9)
    await end(tasks)
    assert client.waiting == 0


async def test_calls_that_were_not_sent_count_for_the_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(calling, "_MOST_CALLS", 9)
    client = Client()
    tasks = await begin(client, 9)
    assert len(client._calls) == 8
    with pytest.raises(BridgeError, match="9 calls of rq/ask wait for an answer, which is the limit"):
        await client.call(b"ask")
    await end(tasks)


async def test_a_call_that_is_given_up_in_line_is_never_sent() -> None:
    client = Client()
    tasks = await begin(client, 9)
    await end([tasks[8]])
    assert (client.waiting, client._in_line) == (8, 0)
    await end(tasks)


async def test_a_server_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(calling, "_POLL_S", 0.0)
    client = Client()
    waiting = asyncio.create_task(client.wait_until_ready())
    for _ in range(5):
        await asyncio.sleep(0)
    assert not waiting.done()
    client.is_ready = True
    await waiting


async def test_who_waits_for_a_server_learns_that_the_client_is_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(calling, "_POLL_S", 0.0)
    client = Client()
    waiting = asyncio.create_task(client.wait_until_ready())
    await asyncio.sleep(0)
    client.close()
    with pytest.raises(NoServer, match="the client of rq/ask is closed"):
        await waiting
