"""Services over RTPS, between two participants of ours on loopback."""

import asyncio
from collections.abc import AsyncIterator

import pytest

from bridged_world import until
from bus_bridge.dds.services import ServiceClient, Services, ServiceServer
from bus_bridge.ros2 import turns
from bus_bridge.ros2.calls import NoServer, RequestId, Response
from bus_bridge.rtps.reader import Reader
from bus_bridge.rtps.writer import Writer
from conftest import WAIT_S
from ports import own_domain

DOMAIN = own_domain()
SERVICE, TYPE = "/s", "std_srvs/srv/Trigger"
CDR = b"\0\1\0\0"


class World:
    """A server and a client, each in a participant of its own."""

    def __init__(self) -> None:
        self.warnings: list[str] = []
        self.here = Services(DOMAIN, self.warnings.append)
        self.there = Services(DOMAIN, self.warnings.append)
        self.requests: list[tuple[RequestId, bytes]] = []
        self.arrived = asyncio.Event()
        self.answers = True
        self.server: ServiceServer = self.here.serve(SERVICE, TYPE, self.on_request)
        self.client: ServiceClient = self.there.make_client(SERVICE, TYPE)

    def on_request(self, request: RequestId, cdr: bytes) -> None:
        self.requests.append((request, cdr))
        self.arrived.set()
        if self.answers:
            assert self.server.answer(request, cdr + b"!")

    async def call(self, text: bytes) -> bytes:
        return (await asyncio.wait_for(self.client.call(CDR + text), WAIT_S)).cdr

    async def ready(self) -> None:
        await asyncio.wait_for(self.client.wait_until_ready(), WAIT_S)

    async def hold(self) -> asyncio.Task[Response]:
        """A call that the server has, and does not answer."""
        self.answers = False
        self.arrived.clear()
        task = asyncio.create_task(self.client.call(CDR + b"held"))
        await asyncio.wait_for(self.arrived.wait(), WAIT_S)
        return task


@pytest.fixture
async def world() -> AsyncIterator[World]:
    made = World()
    yield made
    made.there.close()
    made.here.close()
    assert made.warnings == []


async def test_the_first_call(world: World) -> None:
    with pytest.raises(NoServer, match="no server of rq/sRequest"):
        await world.client.call(CDR)
    await world.ready()
    assert await world.call(b"one") == CDR + b"one!"
    assert world.server.waiting == world.client.waiting == 0


async def test_a_hundred_at_once(world: World) -> None:
    await world.ready()
    answers = await asyncio.gather(*[world.call(b"%d" % number) for number in range(100)])
    assert answers == [CDR + b"%d!" % number for number in range(100)]
    assert len(world.requests) == 100


async def test_each_client_gets_its_own_answers(world: World) -> None:
    other = world.there.make_client(SERVICE, TYPE)
    await world.ready()
    await asyncio.wait_for(other.wait_until_ready(), WAIT_S)
    sent = ((world.client, b"1"), (other, b"2"), (world.client, b"3"))
    calls = [asyncio.wait_for(client.call(CDR + text), WAIT_S) for client, text in sent]
    found = await asyncio.gather(*calls)
    assert [one.cdr for one in found] == [CDR + b"1!", CDR + b"2!", CDR + b"3!"]
    assert {one.writer for one in found} == {world.server.guids[1]}
    assert (world.client.late, other.late) == (0, 0)


async def test_two_servers_in_one_process(world: World) -> None:
    def on_request(request: RequestId, cdr: bytes) -> None:
        assert other.answer(request, cdr + b"!")

    other = world.here.serve(SERVICE, TYPE, on_request)
    await world.ready()
    await until(lambda: len(world.client._reader.matched) == 2)
    assert await world.call(b"one") == CDR + b"one!"
    world.server.close()
    await until(lambda: len(world.client._reader.matched) == 1)
    assert await world.call(b"two") == CDR + b"two!"


async def test_the_newest_server_is_called(world: World) -> None:
    """An older one may be dead, and nothing tells so before its lease ends."""
    await world.ready()
    world.answers = False
    newer = Services(DOMAIN, world.warnings.append)

    def on_request(request: RequestId, cdr: bytes) -> None:
        assert server.answer(request, cdr + b"?")

    try:
        server = newer.serve(SERVICE, TYPE, on_request)
        found = world.client._find_server()
        await until(lambda: world.client._find_server() != found)
        assert await world.call(b"one") == CDR + b"one?"
    finally:
        newer.close()
    await until(lambda: len(world.client._reader.matched) == 1)
    world.answers = True
    assert await world.call(b"two") == CDR + b"two!"


async def test_a_long_answer(world: World) -> None:
    await world.ready()
    assert await world.call(bytes(200_000)) == CDR + bytes(200_000) + b"!"


async def test_a_server_that_goes_fails_its_calls(world: World) -> None:
    await world.ready()
    task = await world.hold()
    world.server.close()
    world.server.close()
    with pytest.raises(NoServer, match="gets no answer: its server has gone"):
        await asyncio.wait_for(task, WAIT_S)
    assert not world.client.is_ready
    world.answers = True
    world.server = world.here.serve(SERVICE, TYPE, world.on_request)
    await world.ready()
    assert await world.call(b"again") == CDR + b"again!"


async def test_a_client_that_goes_leaves_nothing(world: World) -> None:
    await world.ready()
    task = await world.hold()
    assert world.server.waiting == 1
    world.client.close()
    world.client.close()
    with pytest.raises(NoServer, match="the client is closed"):
        await task
    await until(lambda: not world.server.waiting)
    assert not world.server.answer(world.requests[0][0], CDR)
    with pytest.raises(NoServer):
        await world.client.call(CDR)
    with pytest.raises(NoServer, match="is closed"):
        await world.client.wait_until_ready()


async def test_a_call_that_is_given_up(world: World) -> None:
    await world.ready()
    task = await world.hold()
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert world.client.waiting == 0
    assert world.server.answer(world.requests[0][0], CDR)
    assert not world.server.answer(world.requests[0][0], CDR)  # the second answer
    world.answers = True
    assert await world.call(b"next") == CDR + b"next!"
    assert world.client.late == 1


async def test_a_request_that_gets_no_answer(world: World) -> None:
    await world.ready()
    task = await world.hold()
    world.server.drop(world.requests[0][0])
    assert world.server.waiting == 0 and not task.done()
    task.cancel()


async def test_requests_of_a_client_have_a_limit(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bus_bridge.dds.services._MOST_OF_CLIENT", 1)
    await world.ready()
    tasks = [await world.hold(), asyncio.create_task(world.client.call(CDR))]
    await until(lambda: world.server.refused)
    assert "1 requests of a client in ROS 2 wait for answers on rq/sRequest" in world.warnings.pop()
    other = world.there.make_client(SERVICE, TYPE)
    await asyncio.wait_for(other.wait_until_ready(), WAIT_S)
    tasks.append(asyncio.create_task(other.call(CDR)))
    await until(lambda: world.server.waiting == 2)
    for task in tasks:
        task.cancel()


async def test_a_call_waits_until_the_server_knows_both_ends(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    await world.ready()
    for end, what in ((Reader, "is_following"), (Writer, "has_answered")):
        with monkeypatch.context() as patch:
            patch.setattr(end, what, lambda self, guid: False)
            assert not world.client.is_ready
    assert world.client.is_ready


async def test_an_answer_waits_for_the_announcement_of_its_reader(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    await world.ready()
    call = await world.hold()
    ((request, cdr),) = world.requests
    monkeypatch.setattr(type(world.server._writer), "matched", [])
    assert world.server.answer(request, cdr)
    assert [*world.server._unmatched] == [request.reader]
    world.server.reader_matched(b"other" + bytes(11))
    world.server.reader_matched(request.reader)
    assert not call.done()
    monkeypatch.undo()
    world.server.reader_matched(request.reader)
    assert (await asyncio.wait_for(call, WAIT_S)).cdr == cdr
    assert not world.server._unmatched


async def test_few_calls_are_open_at_the_same_time(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(turns, "_PAUSE_S", 3600.0)
    await world.ready()
    world.answers = False
    calls = [asyncio.create_task(world.client.call(CDR)) for _ in range(20)]
    await until(lambda: len(world.requests) == 8)
    assert world.client.waiting == 20
    world.answers = True
    for request, cdr in world.requests[:]:
        world.server.answer(request, cdr)
    await asyncio.wait_for(asyncio.gather(*calls), WAIT_S)
    assert (len(world.requests), world.client.waiting) == (20, 0)


async def test_waiting_calls_fail_with_their_client(world: World) -> None:
    await world.ready()
    world.answers = False
    calls = [asyncio.create_task(world.client.call(CDR)) for _ in range(20)]
    await until(lambda: len(world.requests) == 8)
    world.client.close()
    found = await asyncio.wait_for(asyncio.gather(*calls, return_exceptions=True), WAIT_S)
    assert [type(one) for one in found] == 20 * [NoServer]
