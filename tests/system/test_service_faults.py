"""Faults of services: no server, exceptions in callbacks, different definitions, dead processes."""

import asyncio
import contextlib
import signal
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, ClassVar

import pytest

import bus
from bus.endpoint.endpoint import core_of
from bus.msg import Message, string
from bus.service import client_core as client_module
from bus.srv.example_interfaces import AddTwoInts
from bus.srv.std_srvs import Trigger
from conftest import SOON_S, Daemon
from programs import Program, running
from semantics import forget_calls, node, until

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("route")

SERVER = """
import asyncio, sys, bus
from bus.srv.example_interfaces import AddTwoInts

async def add(request):
    print("asked", request.a, flush=True)
    await asyncio.sleep(0 if request.a < 100 else 1000)
    return AddTwoInts.Response(sum=request.a + request.b)

async def main():
    async with bus.Node("server", arguments=[]) as node:
        await node.create_service(AddTwoInts, "add", add)
        print("ready", flush=True)
        await asyncio.Event().wait()

bus.run(main())
"""
CLIENT = """
import asyncio, bus
from bus.srv.example_interfaces import AddTwoInts

async def main():
    async with bus.Node("doomed", arguments=[]) as node:
        client = await node.create_client(AddTwoInts, "add")
        calls = [asyncio.ensure_future(client.call(AddTwoInts.Request(a=a))) for a in range(50)]
        await asyncio.gather(*calls)

bus.run(main())
"""


class Other:
    """Another definition with the same name."""

    __type_name__: ClassVar[str] = AddTwoInts.__type_name__

    class Request(Message, kw_only=True):
        text: string = ""

    Response = AddTwoInts.Response


def add(request: AddTwoInts.Request) -> AddTwoInts.Response:
    return AddTwoInts.Response(sum=request.a + request.b)


def asked(a: int, b: int = 0) -> AddTwoInts.Request:
    return AddTwoInts.Request(a=a, b=b)


@pytest.fixture
async def other(daemon: Daemon) -> AsyncIterator[bus.Node]:
    """A second node, for the clients."""
    async with bus.Node("caller", arguments=[]) as other:
        yield other


@contextlib.asynccontextmanager
async def server(folder: Path) -> AsyncIterator[Program]:
    async with running(folder, "-c", SERVER) as program:
        await program.line("ready")
        yield program


class TestFaults:
    async def test_nobody_serves(self, node: bus.Node) -> None:
        client = await node.create_client(AddTwoInts, "add")
        assert not client.service_is_ready()
        with pytest.raises(
            bus.ServiceUnavailable, match="service '/add' is not available: no server exists now"
        ):
            await client.call(asked(1))
        assert client.statistics().requests == 0

    @pytest.mark.parametrize("is_awaited", [False, True])
    async def test_a_callback_that_raises(self, daemon: Daemon, other: bus.Node, is_awaited: bool) -> None:
        def fail(request: Any) -> Any:
            raise LookupError("no such number")

        async def fail_later(request: Any) -> Any:
            fail(request)

        client = await other.create_client(AddTwoInts, "add")
        with pytest.raises(LookupError):
            async with bus.Node("server", arguments=[]) as server:
                await server.create_service(AddTwoInts, "add", fail_later if is_awaited else fail)
                await client.wait_for_service()
                call = asyncio.ensure_future(client.call(asked(1)))
                await server.spin()
        with pytest.raises(bus.ServiceError) as caught:
            await call
        assert str(caught.value) == "service '/add' failed: LookupError: no such number"
        assert client.statistics().errors == 1

    async def test_a_callback_that_awaited_a_cancelled_task(self, daemon: Daemon, other: bus.Node) -> None:
        async def wait_for_cancelled(request: Any) -> Any:
            work = asyncio.ensure_future(asyncio.sleep(1000))
            work.cancel()
            await work

        client = await other.create_client(AddTwoInts, "add")
        with pytest.raises(RuntimeError, match="awaited a cancelled task"):
            async with bus.Node("server", arguments=[]) as server:
                await server.create_service(AddTwoInts, "add", wait_for_cancelled)
                await client.wait_for_service()
                call = asyncio.ensure_future(client.call(asked(1)))
                await server.spin()
        with pytest.raises(bus.ServiceError, match=r"RuntimeError: callback .*awaited a cancelled task"):
            await call

    @pytest.mark.parametrize("is_awaited", [False, True])
    async def test_a_wrong_response(self, daemon: Daemon, other: bus.Node, is_awaited: bool) -> None:
        async def answer_later(request: Any) -> Any:
            return Trigger.Response()

        client = await other.create_client(AddTwoInts, "add")
        with pytest.raises(
            bus.MessageTypeError, match=r"expected a bus\.srv\.example_interfaces\.AddTwoInts\.Resp"
        ):
            async with bus.Node("server", arguments=[]) as server:
                await server.create_service(
                    AddTwoInts, "add", answer_later if is_awaited else lambda request: Trigger.Response()
                )
                await client.wait_for_service()
                call = asyncio.ensure_future(client.call(asked(1)))
                await server.spin()
        with pytest.raises(
            bus.ServiceError, match="MessageTypeError: example_interfaces/srv/AddTwoInts_Resp"
        ):
            await call

    async def test_a_wrong_request(self, node: bus.Node) -> None:
        await node.create_service(AddTwoInts, "add", add)
        client = await node.create_client(AddTwoInts, "add")
        with pytest.raises(bus.MessageTypeError):
            await client.call(Trigger.Request())
        assert client.statistics().pending == 0

    async def test_a_call_that_is_cancelled(self, node: bus.Node, other: bus.Node) -> None:
        held: list[bus.RequestId] = []
        service = await node.create_service(
            AddTwoInts, "add", on_request=lambda request, request_id: held.append(request_id)
        )
        client = await other.create_client(AddTwoInts, "add")
        call = asyncio.ensure_future(client.call(asked(1)))
        await until(lambda: held)
        call.cancel()
        with pytest.raises(asyncio.CancelledError):
            await call
        assert client.statistics().pending == 0
        service.respond(held[0], AddTwoInts.Response())
        await until(lambda: client.statistics().late == 1)
        assert client.statistics().responses == 0

    async def test_definitions_that_differ(
        self, node: bus.Node, other: bus.Node, capsys: pytest.CaptureFixture[str]
    ) -> None:
        await node.create_service(AddTwoInts, "add", add)
        client = await other.create_client(Other, "add")
        with pytest.raises(bus.ServiceUnavailable):
            await client.call(Other.Request())
        said = ""
        while said.count("Incompatible type of service '/add'") < 2:
            await asyncio.sleep(0.002)
            said += capsys.readouterr().err
        assert "[tester]: Incompatible type of service '/add', no requests will be taken" in said
        assert "[caller]: Incompatible type of service '/add', no requests will be sent" in said
        assert "topic" not in said

    async def test_two_servers(
        self, node: bus.Node, other: bus.Node, capsys: pytest.CaptureFixture[str]
    ) -> None:
        held: list[bus.RequestId] = []
        slow = await other.create_service(
            AddTwoInts, "add", on_request=lambda request, request_id: held.append(request_id)
        )
        await node.create_service(AddTwoInts, "add", add)
        client = await other.create_client(AddTwoInts, "add")
        assert (await client.call(asked(1, 1))).sum == 2
        assert "service '/add' is served 2 times" in capsys.readouterr().err
        await until(lambda: held)
        slow.respond(held[0], AddTwoInts.Response(sum=99))
        await until(lambda: client.statistics().late == 1)

    async def test_a_server_that_closes(self, node: bus.Node, other: bus.Node) -> None:
        started = asyncio.Event()

        async def never(request: Any) -> Any:
            started.set()
            await asyncio.Event().wait()

        service = await node.create_service(AddTwoInts, "add", never)
        client = await other.create_client(AddTwoInts, "add")
        call = asyncio.ensure_future(client.call(asked(1)))
        await started.wait()
        await service.close()
        await service.close()
        with pytest.raises(bus.ServiceUnavailable, match="it has left before it answered"):
            await call
        with pytest.raises(bus.ConnectionClosed):
            service.respond(bus.RequestId(bytes(16), 1), AddTwoInts.Response())

    async def test_what_was_answered_before_the_end_arrives(self, node: bus.Node, other: bus.Node) -> None:
        closing: list[asyncio.Future[None]] = []

        def add_and_close(request: Any) -> Any:
            closing.append(asyncio.ensure_future(service.close()))
            return add(request)

        service = await node.create_service(AddTwoInts, "add", add_and_close)
        client = await other.create_client(AddTwoInts, "add")
        assert (await client.call(asked(1, 2))).sum == 3
        await asyncio.gather(*closing)

    async def test_a_client_that_closes(self, node: bus.Node, other: bus.Node) -> None:
        held: list[bus.RequestId] = []
        await node.create_service(AddTwoInts, "add", on_request=lambda request, one: held.append(one))
        client = await other.create_client(AddTwoInts, "add")
        call = asyncio.ensure_future(client.call(asked(1)))
        await until(lambda: held)
        await client.close()
        for waiting in (call, asyncio.ensure_future(client.call(asked(2)))):
            with pytest.raises(bus.ConnectionClosed):
                await waiting
        assert client.statistics().pending == 0


class TestProcesses:
    async def test_a_server_that_is_killed_and_another_that_comes(
        self, other: bus.Node, tmp_path: Path
    ) -> None:
        client = await other.create_client(AddTwoInts, "add")
        async with server(tmp_path) as first:
            await client.wait_for_service()
            assert (await client.call(asked(1, 1))).sum == 2
            call = asyncio.ensure_future(client.call(asked(100)))
            await first.line("asked 100")
            first.process.send_signal(signal.SIGKILL)
            with pytest.raises(bus.ServiceUnavailable):
                await call
        async with server(tmp_path):
            await client.wait_for_service()
            assert (await client.call(asked(2, 2))).sum == 4

    async def test_a_client_that_is_killed(self, node: bus.Node, other: bus.Node, tmp_path: Path) -> None:
        held: list[tuple[Any, bus.RequestId]] = []
        service = await node.create_service(
            AddTwoInts, "add", on_request=lambda request, request_id: held.append((request, request_id))
        )
        async with running(tmp_path, "-c", CLIENT) as doomed:
            await until(lambda: len(held) == 50)
            doomed.process.send_signal(signal.SIGKILL)
            await doomed.end()
        for request, request_id in held:
            assert service.respond(request_id, add(request))
        held.clear()
        client = await other.create_client(AddTwoInts, "add")
        call = asyncio.ensure_future(client.call(asked(7)))
        await until(lambda: held)
        service.respond(held[0][1], add(held[0][0]))
        assert (await call).sum == 7

    @pytest.mark.parametrize("kind", ["callback", "on_request"])
    async def test_a_dead_client_holds_up_no_other(
        self, node: bus.Node, other: bus.Node, tmp_path: Path, kind: str
    ) -> None:
        """The server skips its pending requests, and counts them."""
        begun, may_end = list[int](), asyncio.Event()

        async def add_later(request: AddTwoInts.Request) -> AddTwoInts.Response:
            begun.append(request.a)
            await may_end.wait()
            return add(request)

        async def take(request: AddTwoInts.Request, request_id: bus.RequestId) -> None:
            assert service.respond(request_id, await add_later(request))

        if kind == "callback":
            service, at_once = await node.create_service(AddTwoInts, "add", add_later), 100
        else:
            service, at_once = await node.create_service(AddTwoInts, "add", on_request=take), 1
        client = await other.create_client(AddTwoInts, "add")
        await client.wait_for_service()
        async with running(tmp_path, "-c", CLIENT.replace("range(50)", "range(150)")) as doomed:
            await until(
                lambda: len(begun) == at_once and core_of(service).requests.statistics().expected == 150
            )
            doomed.process.send_signal(signal.SIGKILL)
            await doomed.end()
        await until(lambda: service.statistics().clients == 1)
        call = asyncio.ensure_future(client.call(asked(1000, 7)))
        may_end.set()
        assert (await call).sum == 1007
        assert begun == [*range(at_once), 1000]
        totals = service.statistics()
        assert (totals.requests, totals.skipped, totals.responses) == (151, 150 - at_once, at_once + 1)

    async def test_a_client_that_comes_back_is_not_dead(self, node: bus.Node, other: bus.Node) -> None:
        """It had only lost its connection."""
        service = await node.create_service(AddTwoInts, "add", add)
        client = await other.create_client(AddTwoInts, "add")
        await client.wait_for_service()
        await until(lambda: service.statistics().clients == 1)
        core_of(core_of(service).requests).on_lost(core_of(client).gid)
        assert (await client.call(asked(3))).sum == 3
        assert service.statistics().skipped == 0
        assert not core_of(service)._lost

    async def test_a_broker_that_dies(self, node: bus.Node, other: bus.Node, daemon: Daemon) -> None:
        """Later calls are answered. Calls in progress are answered, too, or their caller gives up."""
        await node.create_service(AddTwoInts, "add", add)
        client = await other.create_client(AddTwoInts, "add")
        assert (await client.call(asked(1))).sum == 1
        daemon.kill()
        await until(lambda: client.statistics().servers == 0)
        daemon.restart()
        await client.wait_for_service()
        assert (await client.call(asked(2))).sum == 2

    async def test_a_call_while_the_broker_is_away(
        self, node: bus.Node, other: bus.Node, daemon: Daemon, route: str
    ) -> None:
        if route == "socket":
            pytest.skip("its requests go through the broker")
        await node.create_service(AddTwoInts, "add", add)
        client = await other.create_client(AddTwoInts, "add")
        await client.wait_for_service()
        assert (await client.call(asked(1))).sum == 1
        daemon.kill()
        await until(lambda: client.statistics().servers == 0)
        assert (await client.call(asked(2))).sum == 2
        daemon.restart()
        await client.wait_for_service()


class TestLostWithBusd:
    """busd is stopped, then killed. Messages that it has not read are lost by socket, and only there."""

    @pytest.fixture
    async def ends(
        self, node: bus.Node, other: bus.Node
    ) -> tuple[bus.ServiceServer, bus.ServiceClient, list[bus.RequestId]]:
        held: list[bus.RequestId] = []
        service = await node.create_service(AddTwoInts, "add", on_request=lambda _, one: held.append(one))
        client = await other.create_client(AddTwoInts, "add")
        await client.wait_for_service()
        return service, client, held

    async def test_a_request(self, ends: Any, daemon: Daemon, route: str) -> None:
        service, client, held = ends
        daemon.process.send_signal(signal.SIGSTOP)
        call = asyncio.ensure_future(client.call(asked(1)))
        await until(lambda: client.statistics().pending == 1)
        daemon.kill()
        daemon.restart()
        if route == "socket":
            with pytest.raises(
                bus.ServiceUnavailable,
                match="busd, or a connection to it, has ended meanwhile, and the request or",
            ):
                await call
            assert not held
        else:
            await until(lambda: held)
            service.respond(held[0], AddTwoInts.Response(sum=1))
            assert (await call).sum == 1

    async def test_an_answer(self, ends: Any, daemon: Daemon, route: str) -> None:
        service, client, held = ends
        call = asyncio.ensure_future(client.call(asked(1)))
        await until(lambda: held)
        daemon.process.send_signal(signal.SIGSTOP)
        service.respond(held[0], AddTwoInts.Response(sum=1))
        daemon.kill()
        daemon.restart()
        if route == "socket":
            with pytest.raises(
                bus.ServiceUnavailable, match="busd, or a connection to it, has ended meanwhile"
            ):
                await call
        else:
            assert (await call).sum == 1

    async def test_what_is_still_at_work_is_not_lost(self, ends: Any, daemon: Daemon) -> None:
        service, client, held = ends
        call = asyncio.ensure_future(client.call(asked(1)))
        await until(lambda: held)
        daemon.kill()
        second = asyncio.ensure_future(client.call(asked(2)))  # while busd is away
        daemon.restart()
        await until(lambda: len(held) == 2)
        await client.wait_for_service()
        await until(lambda: all(one.looks for one in core_of(client)._calls.values()))  # it has asked
        for at, one in enumerate(held):
            service.respond(one, AddTwoInts.Response(sum=at))
        assert ((await call).sum, (await second).sum) == (0, 1)

    async def test_a_denial_that_a_bridge_loses(
        self, ends: Any, daemon: Daemon, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The client asks again, after longer and longer pauses."""
        monkeypatch.setattr(client_module, "_LOOK_S", 0.01)
        service, client, held = ends
        call = asyncio.ensure_future(client.call(asked(1)))
        await until(lambda: held)
        denials = forget_calls(service, monkeypatch, lost=2)
        daemon.kill()
        daemon.restart()
        with pytest.raises(
            bus.ServiceUnavailable,
            match="busd, or a connection to it, has ended meanwhile, and the request or",
        ):
            async with asyncio.timeout(SOON_S):
                await call
        assert denials[:3] == 3 * held

    async def test_a_server_that_leaves_after_a_call_from_the_time_without_busd(
        self, ends: Any, daemon: Daemon
    ) -> None:
        service, client, held = ends
        daemon.kill()
        await until(lambda: client.statistics().servers == 0)
        call = asyncio.ensure_future(client.call(asked(1)))
        daemon.restart()
        await until(lambda: held)
        await until(lambda: all(one.looks for one in core_of(client)._calls.values()))  # it has asked
        await service.close()
        with pytest.raises(bus.ServiceUnavailable, match="it has left before it answered"):
            async with asyncio.timeout(SOON_S):
                await call

    async def test_a_server_that_ends_with_it(
        self, other: bus.Node, daemon: Daemon, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(client_module, "RETURN_S", 0.5)
        client = await other.create_client(AddTwoInts, "add")
        async with server(tmp_path) as first:
            await client.wait_for_service()
            call = asyncio.ensure_future(client.call(asked(100)))
            await first.line("asked 100")
            daemon.kill()
            first.process.send_signal(signal.SIGKILL)
            await first.end()
        daemon.restart()
        with pytest.raises(bus.ServiceUnavailable, match="it has left while busd was away"):
            await call
