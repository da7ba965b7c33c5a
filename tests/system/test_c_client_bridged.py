"""Services between two buses: a client or a server in C or C++ on one, and the other end on the other."""

import asyncio
import signal
from contextlib import AbstractAsyncContextManager
from pathlib import Path

import pytest

import bus
import c_programs
from bridging import Made, Site, world
from bus.endpoint.endpoint import core_of
from bus.srv.example_interfaces import AddTwoInts
from bus_bridge.batch import Sample
from programs import Program, running_command
from semantics import forget_calls, until

__all__ = ["world"]


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


def answers(lines: list[str]) -> list[str]:
    return [line for line in lines if line.startswith("answer ")]


def calling(folder: Path, program: Path, site: Site) -> AbstractAsyncContextManager[Program]:
    """A client on that bus: it calls /add with `a` 1 and `b` 1."""
    return running_command(folder, program, "call", "/add", "1", BUSD_SOCKET=str(site.socket))


async def held_server(node: bus.Node) -> tuple[bus.ServiceServer, asyncio.Queue[bus.RequestId]]:
    """A server that keeps its calls."""
    held: asyncio.Queue[bus.RequestId] = asyncio.Queue()
    return await node.create_service(AddTwoInts, "/add", on_request=lambda _, one: held.put_nowait(one)), held


async def see_servers(node: bus.Node, count: int) -> None:
    """Wait until this bus shows so many servers."""
    await node.wait_for_graph(lambda graph: len(graph.subscriptions_of("/add/_request")) == count)


async def test_a_client_in_c_calls_a_server_on_the_other_bus(
    world: Made, service: Path, tmp_path: Path
) -> None:
    async with world() as made:
        left, right, *_ = await made.pair()
        node = await left.node("server")
        await node.create_service(
            AddTwoInts, "/add", lambda asked: AddTwoInts.Response(sum=asked.a + asked.b)
        )
        words = service, "call", "/add", "1", "2", "3"
        async with running_command(tmp_path, *words, BUSD_SOCKET=str(right.socket)) as client:
            assert await client.end() == 0
        assert answers(client.lines) == ["answer 2", "answer 3", "answer 4"]


async def test_a_server_in_c_is_called_from_the_other_bus(world: Made, service: Path, tmp_path: Path) -> None:
    async with world() as made:
        left, right, *_ = await made.pair()
        caller = await right.node("caller")
        client = await caller.create_client(AddTwoInts, "/add")
        async with running_command(
            tmp_path, service, "serve", "/add", BUSD_SOCKET=str(left.socket)
        ) as server:
            await client.wait_for_service()
            for number in range(3):
                assert (await client.call(AddTwoInts.Request(a=number, b=2))).sum == number + 2
            first = asyncio.create_task(client.call(AddTwoInts.Request(a=1000, b=2)))
            await server.line("request 1000")
            assert (await client.call(AddTwoInts.Request(a=5, b=5))).sum == 10
            assert (await first).sum == 1002
            server.process.send_signal(signal.SIGTERM)
            assert await server.end() == 0


@pytest.mark.parametrize("lost", [{0, 1}, {1, 3}], ids=["request and question", "answer and denial"])
async def test_a_lossy_bridge_ends_a_call_in_c(
    world: Made, programs: Path, tmp_path: Path, lost: set[int]
) -> None:
    """Request, answer, question, denial: the bridge loses some of the messages that it would carry."""
    crossed: list[int] = []

    def change(samples: list[Sample]) -> list[Sample]:
        kept: list[Sample] = []
        for one in samples:
            if len(crossed) not in lost:
                kept.append(one)
            crossed.append(len(crossed))
        return kept

    async with world() as made:
        left, right, *_ = await made.pair()
        node = await left.node("server")
        await node.create_service(AddTwoInts, "/add", lambda asked: AddTwoInts.Response())
        made.network.links[-1].change = change
        async with calling(tmp_path, programs / "service", right) as client:
            await client.line("^answer -32: the request or the answer was lost")
            assert await client.end() == 0
    assert len(crossed) > max(lost)


async def test_a_call_in_c_at_work_goes_on_after_questions(
    world: Made, programs: Path, tmp_path: Path
) -> None:
    async with world() as made:
        left, right, *_ = await made.pair()
        service, held = await held_server(await left.node("server"))
        async with calling(tmp_path, programs / "service", right) as client:
            call = await held.get()
            before = core_of(service).requests.statistics().delivered
            await until(lambda: core_of(service).requests.statistics().delivered >= before + 2)
            service.respond(call, AddTwoInts.Response(sum=5))
            await client.line("^answer 5")
            assert await client.end() == 0


async def test_two_servers_of_a_client_in_c_deny_a_call(
    world: Made, programs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with world() as made:
        left, right, *_ = await made.pair()
        one, held = await held_server(await left.node("one"))
        two, also_held = await held_server(await left.node("two"))
        await see_servers(await right.node("looker"), 2)
        async with calling(tmp_path, programs / "service", right) as client:
            await held.get()
            await also_held.get()
            denials = [forget_calls(server, monkeypatch, lost=0) for server in (one, two)]
            await client.line("^answer -32: the request or the answer was lost")
            assert await client.end() == 0
    assert all(denials)


async def test_one_of_two_servers_of_a_client_in_c_works_on_a_call(
    world: Made, programs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with world() as made:
        left, right, *_ = await made.pair()
        one, held = await held_server(await left.node("one"))
        node = await right.node("two")
        two, also_held = await held_server(node)
        await see_servers(node, 2)
        async with calling(tmp_path, programs / "service", right) as client:
            await held.get()
            call = await also_held.get()
            denials = forget_calls(one, monkeypatch, lost=0)
            await until(lambda: len(denials) > 1)
            two.respond(call, AddTwoInts.Response(sum=5))
            await client.line("^answer 5")
            assert await client.end() == 0
