"""A client with several servers: a call is lost once none of them works on it, here and on other buses."""

import asyncio
from typing import Any

import pytest

import bus
from bridging import Made, world
from bus.endpoint.endpoint import core_of
from bus.service import client_core as client_module
from bus.srv.example_interfaces import AddTwoInts
from conftest import Daemon
from semantics import forget_calls, node, until

__all__ = ["node", "world"]

RELIABLE = bus.QoSProfile(1000)
BEST_EFFORT = bus.QoSProfile(1000, reliability="best_effort")


@pytest.fixture(autouse=True)
def short_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client_module, "_LOOK_S", 0.01)


class Server:
    """A server that keeps its calls."""

    def __init__(self) -> None:
        self.held: list[bus.RequestId] = []
        self.service: bus.ServiceServer

    async def open(self, node: bus.Node, qos: bus.QoSProfile = RELIABLE) -> "Server":
        self.service = await node.create_service(
            AddTwoInts, "add", on_request=lambda _, one: self.held.append(one), qos=qos
        )
        return self

    def respond(self) -> None:
        self.service.respond(self.held[0], AddTwoInts.Response(sum=3))


async def begin_call(client: bus.ServiceClient, *servers: Server) -> asyncio.Future[Any]:
    """A call that all servers have."""
    await until(lambda: client.statistics().servers == len(servers))
    call = asyncio.ensure_future(client.call(AddTwoInts.Request()))
    await until(lambda: all(one.held for one in servers))
    return call


@pytest.mark.usefixtures("route")
class TestOnThisBus:
    async def test_no_server_works_on_it(
        self, daemon: Daemon, node: bus.Node, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        async with bus.Node("caller", arguments=[]) as caller:
            one, two = await Server().open(node), await Server().open(caller)
            client = await caller.create_client(AddTwoInts, "add")
            call = await begin_call(client, one, two)
            denials = [forget_calls(server.service, monkeypatch, lost=1) for server in (one, two)]
            daemon.kill()
            daemon.restart()
            with pytest.raises(
                bus.ServiceUnavailable, match="busd, or a connection to it, has ended meanwhile"
            ):
                await call
            assert all(len(one) > 1 for one in denials)

    async def test_one_of_them_works_on_it(
        self, daemon: Daemon, node: bus.Node, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        async with bus.Node("caller", arguments=[]) as caller:
            one, two = await Server().open(node), await Server().open(caller)
            client = await caller.create_client(AddTwoInts, "add")
            call = await begin_call(client, one, two)
            denials = forget_calls(one.service, monkeypatch, lost=0)
            daemon.kill()
            daemon.restart()
            await until(lambda: len(denials) > 2)
            assert not call.done()
            two.respond()
            assert (await call).sum == 3

    async def test_a_server_whose_replies_do_not_match(
        self, daemon: Daemon, node: bus.Node, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Its word about a call never comes, so the others' is enough after some questions."""
        async with bus.Node("caller", arguments=[]) as caller:
            one, two = await Server().open(node), await Server().open(caller, BEST_EFFORT)
            client = await caller.create_client(AddTwoInts, "add", qos=RELIABLE)
            call = await begin_call(client, one, two)
            denials = forget_calls(one.service, monkeypatch, lost=0)
            daemon.kill()
            daemon.restart()
            with pytest.raises(
                bus.ServiceUnavailable, match="busd, or a connection to it, has ended meanwhile"
            ):
                await call
            assert len(denials) > 4

    async def test_the_quick_way_is_back_with_one_server(self, node: bus.Node) -> None:
        async with bus.Node("caller", arguments=[]) as caller:
            client = await caller.create_client(AddTwoInts, "add")
            dispatcher = core_of(core_of(client).replies).dispatcher
            assert dispatcher is not None
            one, two = await Server().open(node), await Server().open(caller)
            await begin_call(client, one, two)
            assert not dispatcher.is_plain
            await two.service.close()
            await until(lambda: dispatcher.is_plain)
            one.held.clear()
            call = await begin_call(client, one)
            one.respond()
            assert (await call).sum == 3


class TestOnAnotherBus:
    async def test_the_bridge_loses_both_answers(self, world: Made, monkeypatch: pytest.MonkeyPatch) -> None:
        async with world() as made:
            left, right, *_ = await made.pair()
            one = await Server().open(await left.node("one"))
            two = await Server().open(await left.node("two"))
            client = await (await right.node("caller")).create_client(AddTwoInts, "add")
            call = await begin_call(client, one, two)
            for server in (one, two):
                forget_calls(server.service, monkeypatch, lost=1)
            with pytest.raises(bus.ServiceUnavailable, match="was lost on the way to or from another bus"):
                await call

    async def test_one_is_here_and_works_on_it(self, world: Made, monkeypatch: pytest.MonkeyPatch) -> None:
        async with world() as made:
            left, right, *_ = await made.pair()
            caller = await right.node("caller")
            one, two = await Server().open(await left.node("one")), await Server().open(caller)
            client = await caller.create_client(AddTwoInts, "add")
            call = await begin_call(client, one, two)
            denials = forget_calls(one.service, monkeypatch, lost=0)
            await until(lambda: len(denials) > 2)
            assert not call.done()
            two.respond()
            assert (await call).sum == 3
