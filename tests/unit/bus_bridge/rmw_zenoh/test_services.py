"""bus_bridge.rmw_zenoh.services: servers and clients of ours, without zenoh: each call ends once."""

import asyncio
from collections.abc import Callable
from typing import Any, cast

import pytest

from bus_bridge.engine import LocalNode
from bus_bridge.errors import BridgeError
from bus_bridge.ros2.calls import NoServer, RequestId
from bus_bridge.ros2.service_types import ServiceTypes

pytest.importorskip("zenoh", reason="needs the extra rmw-zenoh: make setup installs it")
pytest.importorskip("xxhash", reason="needs the extra rmw-zenoh: make setup installs it")

from bus_bridge.rmw_zenoh import attachment, services
from bus_bridge.rmw_zenoh.attachment import Attachment
from bus_bridge.rmw_zenoh.graph import ServiceKind
from bus_bridge.rmw_zenoh.services import RosClient, RosServer, RosServices

TRIGGER = ServiceTypes.find("std_srvs/srv/Trigger")
NODE = LocalNode(1, "node", "/")
ONE, OTHER, SERVER = b"1" * 16, b"2" * 16, b"s" * 16
KEY = f"0/trigger/std_srvs::srv::dds_::Trigger_/{TRIGGER.type_hash}"


class Declared:
    def __init__(self, name: str) -> None:
        self.name = name
        self.is_there = True

    def undeclare(self) -> None:
        self.is_there = False


class Source:
    def __init__(self, take: Callable[[Any], None], lose: Callable[[Any], None]) -> None:
        self.take, self.lose = take, lose

    def close(self) -> None: ...


class Question:
    """A request as zenoh delivers it."""

    def __init__(
        self, number: int, gid: bytes = ONE, payload: bytes = b"ask", head: bytes | None = None
    ) -> None:
        self.payload = payload
        self.attachment = attachment.write(number, 1, gid) if head is None else head
        self.answers: list[tuple[str, bytes, Attachment | None]] = []
        self.is_dropped = False

    def reply(self, key: str, payload: bytes, head: bytes) -> None:
        self.answers.append((key, payload, attachment.read(head)))
        self.is_dropped = True

    def drop(self) -> None:
        self.is_dropped = True


class Asking:
    """A client in zenoh, whose answers the test gives."""

    is_matched = True

    def __init__(self, session: "Session", key: str) -> None:
        session.asking = self
        self.key = key
        self.asked: list[tuple[bytes, Any, Any, Any]] = []
        self.given_up = 0
        self.is_there = True

    def ask(self, payload: bytes, head: bytes, on_answer: Any, on_end: Any) -> Callable[[], None]:
        self.asked.append((payload, attachment.read(head), on_answer, on_end))
        return self._give_up

    def _give_up(self) -> None:
        self.given_up += 1

    def undeclare(self) -> None:
        self.is_there = False


class Sending:
    def add(self, job: Callable[[], object], size: int) -> bool:
        job()
        return True


class Session:
    def __init__(self) -> None:
        self.sending = Sending()
        self.sources: list[Source] = []
        self.declared: list[Declared] = []
        self.asking: Asking

    def source(self, take: Any, bound: int, lose: Any, *, keeps_oldest: bool) -> Source:
        self.sources.append(Source(take, lose))
        return self.sources[-1]

    def serve(self, key: str, source: Source) -> Declared:
        return self._declare(key)

    def token(self, key: str) -> Declared:
        return self._declare(key)

    def _declare(self, key: str) -> Declared:
        self.declared.append(Declared(key))
        return self.declared[-1]


class World:
    def __init__(self) -> None:
        self.session = cast(Any, Session())
        self.servers: dict[bytes, str] = {SERVER: "ab"}
        self.warnings: list[str] = []
        self.requests: list[tuple[RequestId, bytes]] = []
        self.services = RosServices(
            self.session,
            0,
            lambda node, kind, *more: f"token/{kind}/{node.name}",
            self._find,
            self.warnings.append,
        )
        self._end = self.services.for_end(NODE, TRIGGER)

    def _find(self, kind: ServiceKind) -> dict[bytes, str]:
        assert kind == ("/trigger", TRIGGER.type_name, TRIGGER.type_hash)
        return self.servers

    def serve(self) -> RosServer:
        return self._end.serve("/trigger", TRIGGER.type_name, lambda *one: self.requests.append(one))

    def client(self) -> RosClient:
        return self._end.make_client("/trigger", TRIGGER.type_name)

    def ask(self, question: Question) -> Question:
        self.session.sources[0].take(question)
        return question


@pytest.fixture
async def world(monkeypatch: pytest.MonkeyPatch) -> World:
    monkeypatch.setattr(services, "Asking", Asking)
    return World()


async def test_a_request_is_answered_once(world: World) -> None:
    server = world.serve()
    assert [one.name for one in world.session.declared] == [KEY, "token/SS/node"]
    question = world.ask(Question(7))
    request = RequestId(ONE, 7, ONE)
    assert world.requests == [(request, b"ask")]
    assert server.waiting == 1
    assert server.answer(request, b"answer")
    assert not server.answer(request, b"again")
    ((key, payload, head),) = question.answers
    assert (key, payload, head.number, head.gid) == (KEY, b"answer", 7, ONE)
    assert server.waiting == 0


async def test_requests_that_can_t_be_answered_are_dropped(world: World) -> None:
    server = world.serve()
    assert world.ask(Question(1, head=b"")).is_dropped
    assert world.ask(Question(1, payload=b"")).is_dropped
    assert server.faulty == 2
    first, second = world.ask(Question(1)), world.ask(Question(1))
    assert (first.is_dropped, second.is_dropped) == (False, True)
    server.drop(RequestId(ONE, 1, ONE))
    assert first.is_dropped
    assert len(world.requests) == 1


async def test_one_client_can_t_shut_out_the_others(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(services, "_MOST_OF_CLIENT", 3)
    world.serve()
    dropped = [world.ask(Question(number)).is_dropped for number in range(5)]
    assert dropped == [False, False, False, True, True]
    assert not world.ask(Question(1, OTHER)).is_dropped
    assert world.warnings[0].startswith("3 requests of a client in ROS 2 wait for answers of /trigger")


async def test_open_requests_have_a_limit_in_bytes(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(services, "_MOST_BYTES", 1 << 20)
    server = world.serve()
    large = bytes(600_000)
    assert not world.ask(Question(1, payload=large)).is_dropped
    assert world.ask(Question(2, OTHER, payload=large)).is_dropped
    assert not world.ask(Question(3, OTHER)).is_dropped
    assert world.warnings == [
        "1 MiB of requests in ROS 2 wait for answers of /trigger, which is the limit: "
        "further ones are ignored"
    ]
    assert server.refused == 1
    server.drop(RequestId(ONE, 1, ONE))
    assert not world.ask(Question(4, payload=large)).is_dropped
    left_out = Question(5)
    world.session.sources[0].lose(left_out)
    assert (left_out.is_dropped, server.left_out) == (True, 1)


async def test_requests_end_with_their_client_or_server(world: World) -> None:
    server = world.serve()
    mine, others = world.ask(Question(1)), world.ask(Question(1, OTHER))
    world.services.publisher_gone(ONE)
    assert (mine.is_dropped, others.is_dropped) == (True, False)
    server.close()
    server.close()
    assert others.is_dropped
    assert not [one for one in world.session.declared if one.is_there]


async def test_a_call_gets_the_first_right_answer(world: World) -> None:
    client = world.client()
    task = asyncio.create_task(client.call(b"ask"))
    await asyncio.sleep(0)
    ((payload, head, on_answer, on_end),) = world.session.asking.asked
    assert (payload, head.number, head.gid) == (b"ask", 1, client.guids[1])
    on_answer(b"false", attachment.write(2, 1, head.gid), "", "ab")
    on_answer(b"false", attachment.write(1, 1, OTHER), "", "ab")
    on_answer(b"false", b"", "", "ab")
    assert client.faulty == 3
    on_answer(b"right", attachment.write(1, 1, head.gid), "", "ab")
    on_answer(b"second", attachment.write(1, 1, head.gid), "", "cd")
    on_end()
    assert await task == (b"right", SERVER)
    assert (client.waiting, world.session.asking.given_up) == (0, 1)


async def test_the_answer_names_its_server(world: World) -> None:
    world.servers = {OTHER: "ab", SERVER: "cd"}
    client = world.client()
    for session, gid in (("cd", SERVER), ("ab", OTHER), ("ef", OTHER)):
        task = asyncio.create_task(client.call(b"ask"))
        await asyncio.sleep(0)
        _, head, on_answer, _ = world.session.asking.asked[-1]
        on_answer(b"", attachment.write(head.number, 1, head.gid), "", session)
        assert (await task).writer == gid


async def test_calls_that_get_no_answer(world: World) -> None:
    client = world.client()

    async def call(end: Callable[[Any, Any], object]) -> None:
        task = asyncio.create_task(client.call(b"ask"))
        await asyncio.sleep(0)
        end(*world.session.asking.asked[-1][2:])
        await task

    with pytest.raises(BridgeError, match="a call of /trigger failed: broken"):
        await call(lambda on_answer, on_end: on_answer(b"", b"", "broken", ""))
    with pytest.raises(NoServer, match="a call of /trigger gets no answer: its server sent none"):
        await call(lambda on_answer, on_end: on_end())

    def go(*_: Any) -> None:
        world.servers.clear()
        world.services.publisher_gone(SERVER)

    with pytest.raises(NoServer, match="its server has gone"):
        await call(go)
    with pytest.raises(NoServer, match="no server of /trigger"):
        await client.call(b"ask")
    world.servers[SERVER] = "ab"
    with pytest.raises(NoServer, match="the client is closed"):
        await call(lambda *_: world.services.close())
    with pytest.raises(NoServer, match="is closed"):
        await asyncio.gather(client.wait_until_ready(), _after(world.servers.clear))
    assert not world.session.asking.is_there


async def _after(what: Callable[[], object]) -> None:
    what()


async def test_a_client_waits_for_token_and_queryable(world: World) -> None:
    world.servers.clear()
    client = world.client()
    assert not client.is_ready
    world.servers[SERVER] = "ab"
    world.session.asking.is_matched = False
    assert not client.is_ready
    waiting = asyncio.create_task(client.wait_until_ready())
    await asyncio.sleep(0)
    assert not waiting.done()
    world.session.asking.is_matched = True
    await waiting


async def test_calls_wait_while_one_server_of_several_is_there(world: World) -> None:
    world.servers[OTHER] = "cd"
    client = world.client()
    task = asyncio.create_task(client.call(b"ask"))
    await asyncio.sleep(0)
    del world.servers[SERVER]
    world.services.publisher_gone(SERVER)
    await asyncio.sleep(0)
    assert not task.done()
    _, head, on_answer, _ = world.session.asking.asked[-1]
    on_answer(b"right", attachment.write(1, 1, head.gid), "", "cd")
    assert await task == (b"right", OTHER)


async def test_many_calls_take_turns(world: World) -> None:
    """A server of ROS 2 keeps ten requests, and forgets older ones."""
    client = world.client()
    asking = world.session.asking
    tasks = [asyncio.create_task(client.call(b"ask")) for _ in range(16)]
    await _turn()
    assert (len(asking.asked), client.waiting) == (8, 16)
    _, head, on_answer, _ = asking.asked[-1]
    on_answer(b"", attachment.write(head.number, 1, head.gid), "", "ab")
    await _turn()
    assert len(asking.asked) == 16  # it has taken the earlier ones, too
    client.close()
    await asyncio.gather(*tasks, return_exceptions=True)


async def test_a_closed_client_does_not_wait_for_the_calls_of_another_one(world: World) -> None:
    first, second = world.client(), world.client()
    tasks = [asyncio.create_task(first.call(b"ask")) for _ in range(8)]
    await _turn()
    last = asyncio.create_task(second.call(b"ask"))
    await _turn()
    assert second.waiting == 1
    second.close()
    await _turn()
    assert last.done()
    assert isinstance(last.exception(), NoServer)
    first.close()
    await asyncio.gather(*tasks, return_exceptions=True)


async def test_turns_of_results_don_t_slow_down(world: World) -> None:
    """A server answers requests for results when their goals end."""
    results = world.services.for_end(NODE, TRIGGER).make_client("/walk/_action/get_result", TRIGGER.type_name)
    assert (results._turns._growth, world.client()._turns._growth) == (1.0, 4.0)


async def _turn() -> None:
    """Let every task take the steps that it can take now."""
    for _ in range(5):
        await asyncio.sleep(0)


async def test_a_call_that_is_given_up(world: World) -> None:
    client = world.client()
    task = asyncio.create_task(client.call(b"ask"))
    await asyncio.sleep(0)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert (client.waiting, world.session.asking.given_up) == (0, 1)
