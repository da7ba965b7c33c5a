"""Answers of a service server that find no room (QoS keep all). No bus, no clock."""

import asyncio
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from bus.endpoint.core import NodeContext
from bus.errors import ConnectionClosed, PayloadTooLarge, SharedMemoryError
from bus.qos import QoSProfile
from bus.service import server_core as module
from bus.service.server_core import ServerCore
from bus.srv.std_srvs import SetBool
from bus.types.service import Request

CLIENT = b"client gid......"
LIMIT = 1000


class World(ServerCore):
    """A server whose two endpoints are played by the test. `answers` has number, error and text of each
    answer."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, callback: Any = None, on_request: Any = None) -> None:
        self.answers: list[tuple[int, str, str]] = []
        self.room = 0
        self.errors: list[BaseException] = []
        self.faults: list[Exception] = []
        self._has_changed = asyncio.Event()
        self._is_closed = False
        loop = asyncio.get_running_loop()
        self.endpoint: Any = SimpleNamespace(link=SimpleNamespace(loop=loop), refused=0, max_bytes=LIMIT)
        monkeypatch.setattr(module, "warn", lambda logger, text: None)
        node: Any = NodeContext(self.endpoint.link, "/server", None, self.errors.append)  # type: ignore[arg-type]
        super().__init__(node, "/set", SetBool, QoSProfile(), callback=callback, on_request=on_request)

    def make_publisher(self, *_: object) -> Any:
        return SimpleNamespace(
            publish_encoded=self._publish_encoded,
            wait_for_room=self._wait,
            topic_name="/set",
            _core=self.endpoint,
        )

    def make_subscription(self, topic: str, support: object, callback: Any, *_: object) -> Any:
        self.arrive = callback
        return SimpleNamespace(_core=self.endpoint, matches=[])

    def _publish_encoded(self, payload: bytes) -> bool:
        if self._is_closed:
            raise ConnectionClosed("it was closed")
        if self.faults and self.room:
            raise self.faults.pop()
        if len(payload) > LIMIT:
            raise PayloadTooLarge("/set", size_bytes=len(payload), limit_bytes=LIMIT)
        if not self.room:
            self.endpoint.refused += 1
            return False
        self.room -= 1
        _, number, error, body = msgspec.msgpack.decode(payload)
        self.answers.append((number, error, body and body[1]))
        return True

    async def _wait(self) -> None:
        self._has_changed.clear()
        await self._has_changed.wait()
        if self._is_closed:
            raise ConnectionClosed("it was closed")

    def ask(self, number: int) -> Any:
        return self.arrive(Request(CLIENT, number, SetBool.Request(data=True)))

    async def make_room(self, number: int) -> None:
        self.room += number
        self._has_changed.set()
        await turns()

    def shut(self) -> None:
        self._is_closed = True
        self._has_changed.set()


async def turns() -> None:
    for _ in range(10):
        await asyncio.sleep(0)


def said(text: str) -> SetBool.Response:
    return SetBool.Response(success=True, message=text)


async def test_answers_without_room_follow_in_their_order(monkeypatch: pytest.MonkeyPatch) -> None:
    texts = iter("abcd")
    world = World(monkeypatch, lambda request: said(next(texts)))
    for number in (1, 2, 3):
        world.ask(number)
    await turns()
    await world.make_room(1)
    assert world.answers == [(1, "", "a")]
    world.room = 1
    world.ask(4)  # there is room, but others came first
    await world.make_room(1)
    assert world.answers == [(1, "", "a"), (2, "", "b"), (3, "", "c")]
    await world.make_room(5)
    assert world.answers[3:] == [(4, "", "d")]
    assert world.endpoint.refused == 0


async def test_an_answer_above_the_limit_holds_back_no_later_one(monkeypatch: pytest.MonkeyPatch) -> None:
    texts = iter(("a", "b" * LIMIT, "c"))
    world = World(monkeypatch, lambda request: said(next(texts)))
    for number in (1, 2, 3):
        world.ask(number)
    await turns()
    await world.make_room(3)
    assert [(number, text) for number, _, text in world.answers] == [(1, "a"), (2, None), (3, "c")]
    assert world.answers[1][1].startswith("PayloadTooLarge: ") and "the limit is 1000" in world.answers[1][1]


async def test_an_answer_that_cannot_be_published_holds_back_no_later_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    texts = iter("abc")
    world = World(monkeypatch, lambda request: said(next(texts)))
    for number in (1, 2, 3):
        world.ask(number)
    await turns()
    world.faults = [SharedMemoryError("memory is short")]
    await world.make_room(3)
    assert [number for number, _, _ in world.answers] == [2, 3]
    assert world.endpoint.refused == 1 and not world.at_work


async def test_a_large_answer_pushes_out_none_that_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its client gets a short error, which waits instead."""
    monkeypatch.setattr(module, "_LATE_BYTES", LIMIT)
    texts = iter(("a", "b" * 10 * LIMIT, "c"))
    world = World(monkeypatch, lambda request: said(next(texts)))
    for number in (1, 2, 3):
        world.ask(number)
    await turns()
    await world.make_room(3)
    assert [(number, text) for number, _, text in world.answers] == [(1, "a"), (2, None), (3, "c")]


@pytest.mark.parametrize("is_async", [False, True])
async def test_the_error_of_a_callback_waits_for_room(
    monkeypatch: pytest.MonkeyPatch, is_async: bool
) -> None:
    def fail(request: Any) -> Any:
        raise ZeroDivisionError("by design")

    async def fail_later(request: Any) -> Any:
        fail(request)

    world = World(monkeypatch, fail_later if is_async else fail)
    if is_async:
        await world.ask(1)
    else:
        with pytest.raises(ZeroDivisionError):
            world.ask(1)
    await turns()
    await world.make_room(1)
    assert world.answers == [(1, "ZeroDivisionError: by design", None)]


async def test_an_error_without_a_text_reaches_its_client(monkeypatch: pytest.MonkeyPatch) -> None:
    class Odd(Exception):
        def __str__(self) -> str:
            raise ZeroDivisionError

    def fail(request: Any) -> Any:
        raise Odd

    world = World(monkeypatch, fail)
    world.room = 1
    with pytest.raises(Odd):
        world.ask(1)
    assert world.answers == [(1, "Odd", None)]


@pytest.mark.parametrize(("bound", "most"), [("_MOST_AT_WORK", 2), ("_LATE_BYTES", 60)])
async def test_so_many_answers_may_wait_and_the_oldest_is_lost_first(
    monkeypatch: pytest.MonkeyPatch, bound: str, most: int
) -> None:
    monkeypatch.setattr(module, bound, most)
    world = World(monkeypatch, lambda request: said("a"))
    for number in (1, 2, 3):
        world.ask(number)
    await turns()
    assert world.endpoint.refused == 1
    await world.make_room(3)
    assert [number for number, _, _ in world.answers] == [2, 3]


async def test_a_call_keeps_its_place_until_its_answer_has_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MOST_AT_ONCE", 2)
    begun: list[Any] = []

    async def answer(request: Any) -> Any:
        begun.append(request)
        return said("a")

    world = World(monkeypatch, answer)
    asking = [asyncio.ensure_future(world.ask(number)) for number in (1, 2, 3)]
    await turns()
    assert len(begun) == 2
    await world.make_room(2)
    assert len(begun) == 3
    await asyncio.gather(*asking)
    await world.make_room(1)
    assert [number for number, _, _ in world.answers] == [1, 2, 3]


async def test_no_answer_waits_for_room_after_the_close(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(monkeypatch, lambda request: said("a"))
    world.ask(1)
    await turns()
    world.shut()
    await turns()
    world.ask(2)
    assert not world._late and world.sending is None and world.errors == []
    assert world.endpoint.refused == 1
