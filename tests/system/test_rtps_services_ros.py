"""Services between our own RTPS and ROS 2's rclpy, both ways: the first call, many at once, and ends."""

import asyncio
import time
from collections.abc import AsyncIterator
from typing import Any

import msgspec
import pytest

from bridged_world import until
from bus.schema import MessageSchema
from bus.types.classes import service_class
from bus_bridge.dds.services import Services
from bus_bridge.ros2.calls import NoServer, RequestId
from bus_ros.cdr import codec_of
from conftest import SOON_S, WAIT_S
from peers import peer
from ports import own_domain

DOMAIN = own_domain()
LIST = "rcl_interfaces/srv/ListParameters"
GET = "rcl_interfaces/srv/GetParameters"
_classes: Any = {name: service_class(name) for name in (LIST, GET)}
ListParameters, GetParameters = _classes[LIST], _classes[GET]


def cdr(message: Any) -> bytes:
    codec = codec_of(MessageSchema.of(type(message)))
    return b"".join(codec.encode(msgspec.msgpack.encode(message)))


def message(cls: Any, data: bytes) -> Any:
    return msgspec.msgpack.decode(codec_of(MessageSchema.of(cls)).decode(data), type=cls)


class Ours:
    """Our services, with a server that answers with what it was asked."""

    def __init__(self) -> None:
        self.warnings: list[str] = []
        self.services = Services(DOMAIN, self.warnings.append)
        self.requests: list[RequestId] = []
        self.answers = True

    def serve(self, service: str) -> None:
        self.server = self.services.serve(service, LIST, self.on_request)

    def on_request(self, request: RequestId, data: bytes) -> None:
        self.requests.append(request)
        asked = message(ListParameters.Request, data)
        response = ListParameters.Response()
        response.result.names = [*asked.prefixes, str(asked.depth)]
        if self.answers:
            assert self.server.answer(request, cdr(response))


@pytest.fixture
async def ours() -> AsyncIterator[Ours]:
    made = Ours()
    yield made
    made.services.close()
    assert made.warnings == [] and made.services.participant.core.faulty == 0


async def _ros(distro: peer.Distro) -> peer.Peer:
    return await asyncio.to_thread(peer.ros, distro, "ros_node", None, domain=DOMAIN)


async def _ask(ros: peer.Peer, order: str, **arguments: Any) -> Any:
    return await asyncio.to_thread(ros.ask, order, **arguments)


@peer.each_distro
async def test_they_call_us(ours: Ours, distro: peer.Distro) -> None:
    ours.serve("/ours")
    with await _ros(distro) as ros:
        call = {"service": "/ours", "type_name": LIST, "prefixes": ["grüß", ""], "depth": 2**40}
        (first,) = await _ask(ros, "call", **call)
        assert first["result"]["names"] == ["grüß", "", str(2**40)]
        for _ in range(10):
            assert await _ask(ros, "call", **call, count=10) == 10 * [first]
        # With 100 at once its reader drops answers: it keeps ten. Between two rclpy, 10 to 20 are answered.
        answers = await _ask(ros, "call", **call, count=100, time_s=1.0)
        assert answers.count(first) >= 10
        assert len(ours.requests) == 201 and ours.server.waiting == 0
        ours.answers = False
        assert await _ask(ros, "call", **call, time_s=0.1) == [None]
        await until(lambda: ours.server.waiting == 1)
        await _ask(ros, "end", topic="/ours")
        await until(lambda: ours.server.waiting == 0)
        await asyncio.to_thread(
            ros.wait_for, "has_server", lambda found: found, service="/ours", type_name=LIST
        )
        ours.server.close()
        await asyncio.to_thread(
            ros.wait_for, "has_server", lambda found: not found, service="/ours", type_name=LIST
        )
        assert await _ask(ros, "call", **call, time_s=0.1) == "no server"


@peer.each_distro
async def test_we_call_them(ours: Ours, distro: peer.Distro) -> None:
    client = ours.services.make_client("/theirs", LIST)
    answer = {"result": {"names": ["a", "ü"]}}
    request = cdr(ListParameters.Request(prefixes=["one"], depth=3))
    with await _ros(distro) as ros:
        await _ask(ros, "offer", service="/theirs", type_name=LIST, **answer)
        await asyncio.wait_for(client.wait_until_ready(), WAIT_S)
        first = await asyncio.wait_for(client.call(request), WAIT_S)
        assert message(ListParameters.Response, first.cdr).result.names == ["a", "ü"]
        heard = await asyncio.to_thread(ros.wait, "/theirs")
        assert heard == [{"prefixes": ["one"], "depth": 3}]
        # rclpy's server keeps ten requests: so more at once are too many for it, not for us.
        for _ in range(10):
            calls = [asyncio.wait_for(client.call(request), WAIT_S) for _ in range(10)]
            assert await asyncio.gather(*calls) == 10 * [first]
        assert (client.waiting, client.late, client.faulty) == (0, 0, 0)


@peer.each_distro
async def test_a_server_that_dies_in_a_call(ours: Ours, distro: peer.Distro) -> None:
    client = ours.services.make_client("/theirs", LIST)
    with await _ros(distro) as ros:
        await _ask(ros, "offer", service="/theirs", type_name=LIST, pause_s=100.0)
        await asyncio.wait_for(client.wait_until_ready(), WAIT_S)
        task = asyncio.create_task(client.call(cdr(ListParameters.Request())))
        await asyncio.to_thread(ros.wait, "/theirs")
        begun = time.monotonic()
        await _ask(ros, "end", topic="/theirs")
        with pytest.raises(NoServer, match="its server has gone"):
            await asyncio.wait_for(task, WAIT_S)
        assert time.monotonic() - begun < SOON_S
        ros.kill()


@peer.each_distro
async def test_parameters_of_their_node(ours: Ours, distro: peer.Distro) -> None:
    listing = ours.services.make_client("/ros_node/list_parameters", LIST)
    getting = ours.services.make_client("/ros_node/get_parameters", GET)
    with await _ros(distro):
        for client in (listing, getting):
            await asyncio.wait_for(client.wait_until_ready(), WAIT_S)
        names = message(ListParameters.Response, (await listing.call(cdr(ListParameters.Request()))).cdr)
        assert "use_sim_time" in names.result.names
        asked = GetParameters.Request(names=["use_sim_time"])
        answer = message(GetParameters.Response, (await getting.call(cdr(asked))).cdr)
        assert [(value.type, value.bool_value) for value in answer.values] == [(1, False)]
