"""Calls between the bus and ROS 2, over two participants of ours: each ends once."""

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import pytest

from bridged_world import until
from bus.srv.example_interfaces import AddTwoInts
from bus.types.service import Reply, service_support
from bus_bridge.dds.services import Services, ServiceServer
from bus_bridge.ros2 import open_requests, service_calls
from bus_bridge.ros2.calls import RequestId
from bus_bridge.ros2.open_requests import OpenRequests
from bus_bridge.ros2.service_calls import CallsFromRos, CallsToRos
from bus_bridge.ros2.service_types import ServiceTypes
from ports import own_domain

DOMAIN = own_domain()
ADD = ServiceTypes.find("example_interfaces/srv/AddTwoInts")
SUPPORT = service_support(AddTwoInts)
CLIENT = b"c" * 16


def server_of(calls: CallsFromRos) -> ServiceServer:
    assert isinstance(calls.server, ServiceServer)
    return calls.server


class World:
    """A server on one bus, a client on another, and DDS between them."""

    def __init__(self) -> None:
        self.warnings: list[str] = []
        self.here = Services(DOMAIN, self.warnings.append)
        self.there = Services(DOMAIN, self.warnings.append)
        self.asked: list[Any] = []
        self.replies: list[Reply] = []
        self.senders: list[bytes] = []
        self.answers = True
        self.served = CallsFromRos(self.here, "/add", ADD, self.on_request)
        self.calls = CallsToRos(self.there, "/add", ADD, self.on_reply)

    def on_request(self, client: bytes, payload: bytes) -> None:
        request = SUPPORT.requests.decode(payload)
        assert request.client == client == self.calls.client.guids[1]
        self.asked.append(request)
        if self.answers:
            self.answer(request)

    def answer(self, request: Any) -> None:
        response = AddTwoInts.Response(sum=request.body.a + request.body.b)
        self.served.reply(SUPPORT.encode_response(request.client, request.number, response))

    def on_reply(self, server: bytes, payload: bytes) -> None:
        self.senders.append(server)
        self.replies.append(SUPPORT.replies(CLIENT).decode(payload))

    def call(self, number: int) -> None:
        request = AddTwoInts.Request(a=number, b=1)
        self.calls.request(SUPPORT.encode_request(CLIENT, number, request))

    async def replied(self, count: int = 1) -> Reply:
        await until(lambda: len(self.replies) == count)
        return self.replies[-1]

    async def hold(self) -> None:
        """A call that the server has, and does not answer."""
        self.answers = False
        self.call(1)
        await until(lambda: self.asked)


@pytest.fixture
async def world() -> AsyncIterator[World]:
    made = World()
    yield made
    made.calls.close()
    made.served.close()
    made.there.close()
    made.here.close()


async def test_a_hundred_calls_from_the_first_moment(world: World) -> None:
    for number in range(1, 101):
        world.call(number)
        world.call(number)  # sent once more, after busd had restarted
    await world.replied(100)
    assert {reply.number: reply.body.sum for reply in world.replies} == {
        number: number + 1 for number in range(1, 101)
    }
    assert len(world.asked) == 100
    assert {*world.senders} == {world.served.server.guids[1]}
    assert (world.calls.waiting, world.served.waiting, world.warnings) == (0, 0, [])


async def test_calls_keep_their_order_while_they_wait_for_a_server(world: World) -> None:
    """The server is there when the second call comes, before the first one has looked again."""
    begun: list[asyncio.Future[None]] = []
    real = world.calls.client.wait_until_ready

    async def wait_until_ready() -> None:
        begun.append(asyncio.get_running_loop().create_future())
        if len(begun) == 1:
            await begun[0]
        await real()

    await real()
    world.calls.client.wait_until_ready = wait_until_ready  # type: ignore[method-assign]
    world.call(1)
    await until(lambda: begun)
    world.call(2)
    for _ in range(5):
        await asyncio.sleep(0)
    begun[0].set_result(None)
    await world.replied(2)
    assert [request.body.a for request in world.asked] == [1, 2]


async def test_a_question_about_a_call(world: World) -> None:
    await world.hold()
    world.calls.request(SUPPORT.encode_question(CLIENT, 1))
    world.calls.request(SUPPORT.encode_question(CLIENT, 9))
    reply = await world.replied()
    assert (reply.number, reply.error, reply.body, world.senders) == (9, "", None, [b""])
    world.answer(world.asked[0])
    assert (await world.replied(2)).body.sum == 2


async def test_an_answer_for_another_client_and_a_second_one(world: World) -> None:
    await world.hold()
    response = AddTwoInts.Response(sum=5)
    world.served.reply(SUPPORT.encode_response(CLIENT, 1, response))
    assert world.served.waiting == 1
    for _ in range(2):
        world.served.reply(SUPPORT.encode_response(world.asked[0].client, 1, response))
    assert (await world.replied()).body.sum == 5
    world.call(2)
    await until(lambda: len(world.asked) == 2)
    assert len(world.replies) == 1


async def test_an_error_of_the_server(world: World) -> None:
    await world.hold()
    world.served.reply(SUPPORT.encode_error(world.asked[0].client, 1, "no fuel"))
    assert (world.served.failed, world.served.waiting, server_of(world.served).waiting) == (1, 0, 0)
    assert world.warnings == ["a call of /add by a node of ROS 2 gets no answer: no fuel"]
    assert world.calls.waiting == 1  # ROS 2 has no errors


async def test_a_server_here_that_goes(world: World) -> None:
    await world.hold()
    world.served.close()
    assert (world.served.failed, world.served.waiting) == (1, 0)
    reply = await world.replied()
    assert reply.error == "a call of rq/addRequest gets no answer: its server has gone"
    assert (world.calls.failed, world.calls.waiting) == (1, 0)


async def test_no_server(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service_calls, "_PATIENCE_S", 0.01)
    nowhere = CallsToRos(world.there, "/nowhere", ADD, world.on_reply)
    nowhere.request(SUPPORT.encode_request(CLIENT, 1, AddTwoInts.Request()))
    assert (await world.replied()).error == "no server of /nowhere in ROS 2"
    nowhere.close()


async def test_a_client_that_is_closed_meanwhile(world: World) -> None:
    nowhere = CallsToRos(world.there, "/nowhere", ADD, world.on_reply)
    nowhere.request(SUPPORT.encode_request(CLIENT, 1, AddTwoInts.Request()))
    nowhere.close()
    await until(lambda: nowhere.waiting == 0)
    assert world.replies == []


async def test_limits(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service_calls, "_MOST_TASKS", 1)
    await world.hold()
    world.call(2)
    assert "1 calls of /add wait for an answer" in (await world.replied()).error
    monkeypatch.setattr(open_requests, "_MOST", 1)
    monkeypatch.setattr(service_calls, "_MOST_TASKS", 9)
    world.call(3)
    await until(lambda: len(world.asked) == 2)
    assert (world.served.waiting, world.served.failed) == (1, 1)
    assert "too many later calls" in world.warnings[0]


async def test_a_result_waits_for_the_last_feedback(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service_calls, "_FEEDBACK_FIRST_S", 3600.0)
    asked: list[Any] = []
    service = "/a/_action/get_result"
    served = CallsFromRos(world.here, service, ADD, lambda _, one: asked.append(SUPPORT.requests.decode(one)))
    calls = CallsToRos(world.there, service, ADD, world.on_reply)
    calls.request(SUPPORT.encode_request(CLIENT, 1, AddTwoInts.Request()))
    await until(lambda: asked)
    served.reply(SUPPORT.encode_response(asked[0].client, 1, AddTwoInts.Response(sum=3)))
    assert (served.waiting, server_of(served).waiting, world.replies) == (0, 1, [])
    monkeypatch.setattr(calls, "_result_pause_s", 0.0)
    served.close()  # its node ends: the result goes at once
    assert (await world.replied()).body.sum == 3
    assert (served.failed, server_of(served).waiting) == (0, 0)
    calls.close()


async def test_two_servers_of_a_service_share_its_requests(world: World) -> None:
    """A client in ROS 2 sends a request to both; each server here gets what one of them publishes."""
    requests = OpenRequests()
    one, other = (
        CallsFromRos(world.here, "/two", ADD, lambda _, one: two.append(one), requests=requests)
        for _ in range(2)
    )
    two: list[bytes] = []
    client = b"w" * 16
    cdr = b"\0\1\0\0" + bytes(16)

    def send(number: int, *ends: CallsFromRos) -> None:
        request = RequestId(client, number, client)
        for end in ends:
            server_of(end)._open[client][request] = None
            end._request(request, cdr)

    send(1, one, other)
    send(2, other)
    decoded = [SUPPORT.requests.decode(one) for one in two]
    assert [(request.client, request.number) for request in decoded] == [(client, 1), (client, 2)]
    response = SUPPORT.encode_response(client, 1, AddTwoInts.Response(sum=5))
    other.reply(response)
    one.reply(response)
    assert (one.waiting, server_of(one).waiting, server_of(other).waiting) == (1, 0, 1)
    send(1, one)  # late
    assert (len(two), server_of(one).waiting) == (2, 0)
    send(3, one, other)
    other.close()
    assert world.warnings == ["a call of /two by a node of ROS 2 gets no answer: its server has gone"]
    assert (one.waiting, server_of(one).waiting) == (1, 1)
    one.reply(SUPPORT.encode_response(client, 3, AddTwoInts.Response(sum=5)))
    assert (one.waiting, server_of(one).waiting) == (0, 0)
    one.close()
