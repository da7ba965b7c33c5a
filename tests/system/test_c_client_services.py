"""Services of the C client: a server or a client in C or C++, and the other end in Python, by both routes."""

import asyncio
import signal
from pathlib import Path
from typing import Any

import pytest

import bus
import c_programs
from bus.endpoint.endpoint import core_of
from bus.srv.example_interfaces import AddTwoInts
from bus.types.classes import message_class, service_class
from conftest import Daemon
from programs import running_command
from semantics import forget_calls, node, until

__all__ = ["node"]

ListParameters: Any = service_class("rcl_interfaces/srv/ListParameters")
ListParametersResult: Any = message_class("rcl_interfaces/msg/ListParametersResult")


@pytest.fixture(scope="session")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return c_programs.build_once(tmp_path_factory)


@pytest.fixture(params=["service", "service_cpp"])
def service(programs: Path, request: pytest.FixtureRequest) -> Path:
    """The test program, in C and in C++."""
    program: Path = programs / request.param
    if not program.exists():
        pytest.skip(c_programs.why_no_cpp())
    return program


async def test_a_server_in_c(node: bus.Node, service: Path, tmp_path: Path, route: str) -> None:
    client = await node.create_client(AddTwoInts, "/add")
    async with running_command(tmp_path, service, "serve", "/add") as server:
        await client.wait_for_service()
        for number in range(200):
            assert (await client.call(AddTwoInts.Request(a=number, b=2))).sum == number + 2
        with pytest.raises(bus.ServiceError, match="a is negative"):
            await client.call(AddTwoInts.Request(a=-1, b=2))
        first = asyncio.create_task(client.call(AddTwoInts.Request(a=1000, b=2)))
        await server.line("request 1000")
        assert (await client.call(AddTwoInts.Request(a=5, b=5))).sum == 10
        assert (await first).sum == 1002
        server.process.send_signal(signal.SIGTERM)
        assert await server.end() == 0
    assert not [line for line in server.lines if "request" not in line and line != "ready"]
    assert server.lines[-1] == "requests 203 responses 203 errors 1 late 0 open 0 matches 1"


async def test_a_reason_in_c_that_is_not_utf8(
    node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    client = await node.create_client(AddTwoInts, "/add")
    async with running_command(tmp_path, programs / "service", "serve", "/add") as server:
        await client.wait_for_service()
        with pytest.raises(bus.ServiceError, match=r"caf\?, très \?\?"):
            await client.call(AddTwoInts.Request(a=-2, b=2))
        server.process.send_signal(signal.SIGTERM)
        assert await server.end() == 0


async def test_a_client_in_c(node: bus.Node, service: Path, tmp_path: Path, route: str) -> None:
    async with running_command(tmp_path, service, "call", "/add", "1", "-1", "3") as client:
        await client.line("/add/_request has no server")
        requests: asyncio.Queue[tuple[AddTwoInts.Request, Any]] = asyncio.Queue()
        server = await node.create_service(
            AddTwoInts, "/add", on_request=lambda request, call: requests.put_nowait((request, call))
        )
        for _ in range(3):
            request, call = await requests.get()
            response = AddTwoInts.Response(sum=request.a + request.b)
            server.respond(call, response, "a is negative" if request.a < 0 else "")
        assert await client.end() == 0
    answers = [line for line in client.lines if line.startswith("answer ")]
    assert answers == ["answer 2", "answer -121: a is negative", "answer 4"]
    assert client.lines[-1] == "requests 3 responses 3 errors 1 late 0 open 0 matches 1"


async def test_a_long_reason_is_cut_between_characters(
    node: bus.Node, service: Path, tmp_path: Path, route: str
) -> None:
    server: bus.ServiceServer = await node.create_service(
        AddTwoInts, "/add", on_request=lambda request, call: server.respond(call, None, "é" * 300)
    )
    async with running_command(tmp_path, service, "call", "/add", "1") as client:
        assert await client.end() == 0
    (answer,) = [line for line in client.lines if line.startswith("answer ")]
    assert answer.removesuffix(": Remote I/O error") == "answer -121: " + "é" * 199


async def test_a_server_in_python_that_ends_fails_the_calls(
    node: bus.Node, service: Path, tmp_path: Path, route: str
) -> None:
    asked = asyncio.Event()

    async def wait(request: AddTwoInts.Request) -> AddTwoInts.Response:
        asked.set()
        await asyncio.Event().wait()
        return AddTwoInts.Response()

    server = await node.create_service(AddTwoInts, "/add", wait)
    async with running_command(tmp_path, service, "call", "/add", "1") as client:
        await asked.wait()
        await server.close()
        assert await client.end() == 0
    (answer,) = [line for line in client.lines if line.startswith("answer ")]
    assert answer.startswith(("answer -32: ", "answer -121: "))


@pytest.mark.skipif(bool(c_programs.why_no_cpp()), reason=c_programs.why_no_cpp())
async def test_a_server_in_cpp_that_its_callback_destroys(
    node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    """The call fails at the client, and the object of the call throws at the server."""
    client = await node.create_client(AddTwoInts, "/add")
    async with running_command(tmp_path, programs / "service_cpp", "serve", "/add") as server:
        await client.wait_for_service()
        with pytest.raises(bus.ServiceUnavailable):
            await client.call(AddTwoInts.Request(a=2000))
        assert await server.end() == 1
    reason = "the server was destroyed: Operation canceled"
    assert server.lines[-2:] == [f"in the callback: {reason}", f"failed: {reason}"]


@pytest.mark.skipif(bool(c_programs.why_no_cpp()), reason=c_programs.why_no_cpp())
async def test_answers_in_cpp_keep_their_texts(
    node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    """The sanitizers see a text that is gone. The third call ends with the client, unanswered."""
    prefixes: list[list[str]] = []

    async def reply(request: Any) -> Any:
        prefixes.append(request.prefixes)
        if len(prefixes) == 3:
            await asyncio.Event().wait()
        return ListParameters.Response(result=ListParametersResult(names=["a" * 100, "b"]))

    await node.create_service(ListParameters, "/list", reply)
    async with running_command(tmp_path, programs / "service_cpp", "list", "/list") as client:
        assert await client.end() == 1
    assert prefixes[:2] == [["one", "two"]] * 2
    assert client.lines == [
        "the call has no answer yet: Resource temporarily unavailable",
        *["name " + "a" * 100, "name b"] * 2,
        "failed: the client was destroyed: Operation canceled",
    ]


async def test_a_killed_server_in_c_fails_the_calls(
    node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    client = await node.create_client(AddTwoInts, "/add")
    async with running_command(tmp_path, programs / "service", "serve", "/add") as server:
        await client.wait_for_service()
        call = asyncio.create_task(client.call(AddTwoInts.Request(a=1000)))
        await server.line("request 1000")
        server.process.send_signal(signal.SIGKILL)
        with pytest.raises(bus.ServiceUnavailable):
            await call


async def test_a_client_in_c_asks_again_about_a_call(
    daemon: Daemon, node: bus.Node, service: Path, tmp_path: Path, route: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A bridge may lose the question, or the answer that the server does not know the call."""
    held: asyncio.Queue[bus.RequestId] = asyncio.Queue()
    server = await node.create_service(AddTwoInts, "/add", on_request=lambda _, one: held.put_nowait(one))
    async with running_command(tmp_path, service, "call", "/add", "1") as client:
        await held.get()
        forget_calls(server, monkeypatch, lost=2)
        daemon.kill()
        daemon.restart()
        await client.line("^answer -32: the request or the answer was lost")
        assert await client.end() == 0


async def test_a_newer_server_does_not_know_a_call_of_a_client_in_c(
    node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    """The server that has the call leaves: the newer one says that it does not work on it."""
    asked = asyncio.Event()
    one = await node.create_service(AddTwoInts, "/add", on_request=lambda *_: asked.set())
    async with (
        running_command(tmp_path, programs / "service", "call", "/add", "1") as client,
        bus.Node("two", arguments=[]) as other,
    ):
        await asked.wait()
        requests: list[AddTwoInts.Request] = []
        two = await other.create_service(
            AddTwoInts, "/add", on_request=lambda request, _: requests.append(request)
        )
        await until(lambda: two.statistics().clients)
        await one.close()
        await client.line("^answer -32: the request or the answer was lost")
        assert await client.end() == 0
        assert not requests


async def test_calls_survive_a_kill_of_busd(
    daemon: Daemon, node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    """The server in C still works on the call, so the question of the client in Python gets no answer."""
    client = await node.create_client(AddTwoInts, "/add")
    async with running_command(tmp_path, programs / "service", "serve", "/add") as server:
        await client.wait_for_service()
        first = asyncio.create_task(client.call(AddTwoInts.Request(a=1000, b=2)))
        await server.line("request 1000")
        daemon.kill()
        daemon.restart()
        await until(lambda: [call.looks for call in core_of(client)._calls.values()] == [2])  # asked twice
        async with asyncio.timeout(20):
            while True:
                try:
                    assert (await client.call(AddTwoInts.Request(a=5, b=5))).sum == 10
                    break
                except bus.ServiceUnavailable:
                    await client.wait_for_service()
            assert (await first).sum == 1002


async def test_a_newer_server_can_not_end_a_call_that_another_one_works_on(
    daemon: Daemon,
    node: bus.Node,
    programs: Path,
    tmp_path: Path,
    route: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """After a restart of busd the client asks both servers."""
    held: asyncio.Queue[bus.RequestId] = asyncio.Queue()
    one = await node.create_service(AddTwoInts, "/add", on_request=lambda _, call: held.put_nowait(call))
    async with (
        running_command(tmp_path, programs / "service", "call", "/add", "1") as client,
        bus.Node("two", arguments=[]) as other,
    ):
        call = await held.get()
        two = await other.create_service(AddTwoInts, "/add", on_request=lambda *_: None)
        await until(lambda: two.statistics().clients)
        denials = forget_calls(two, monkeypatch, lost=0)
        daemon.kill()
        daemon.restart()
        await until(lambda: len(denials) == 2)
        assert not [line for line in client.lines if line.startswith("answer")]
        one.respond(call, AddTwoInts.Response(sum=7))
        await client.line("^answer 7")
        assert await client.end() == 0


@pytest.mark.parametrize("is_served", [True, pytest.param(False, marks=pytest.mark.nightly)])
async def test_a_call_of_a_client_in_c_while_busd_is_away(
    daemon: Daemon, node: bus.Node, programs: Path, tmp_path: Path, route: str, is_served: bool
) -> None:
    """It waits for the next busd; ten seconds later it fails if no server has come."""
    server = await node.create_service(
        AddTwoInts, "/add", lambda request: AddTwoInts.Response(sum=request.a + 1)
    )
    async with running_command(tmp_path, programs / "service", "away", "/add") as client:
        await client.line("ready")
        await until(lambda: server.statistics().clients)
        if not is_served:
            await server.close()
        daemon.kill()
        await client.line("called")
        daemon.restart()
        await client.line("^answer 2" if is_served else "^answer -32: no server is left")
        assert await client.end() == 0
