"""Services and clients on the test's daemon, by both routes and on both event loops."""

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import pytest

import bus
from bus.service.client_core import MAX_PENDING
from bus.srv.example_interfaces import AddTwoInts
from bus.srv.std_srvs import Empty
from conftest import Daemon
from semantics import node, until

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("route")


def add(request: AddTwoInts.Request) -> AddTwoInts.Response:
    return AddTwoInts.Response(sum=request.a + request.b)


def asked(a: int, b: int = 0) -> AddTwoInts.Request:
    return AddTwoInts.Request(a=a, b=b)


@pytest.fixture
async def other(daemon: Daemon) -> AsyncIterator[bus.Node]:
    """A second node, for the clients."""
    async with bus.Node("caller", arguments=[]) as other:
        yield other


class TestCalls:
    async def test_one(self, node: bus.Node, other: bus.Node) -> None:
        service = await node.create_service(AddTwoInts, "add", add)
        client = await other.create_client(AddTwoInts, "add")
        assert await client.call(asked(1, 2)) == AddTwoInts.Response(sum=3)
        assert (service.service_name, client.service_name) == ("/add", "/add")
        await client.wait_for_service()
        assert client.service_is_ready()
        assert service.statistics() == bus.ServiceServerStatistics(
            requests=1, responses=1, errors=0, refused=0, dropped={}, clients=1, skipped=0
        )
        assert client.statistics() == bus.ServiceClientStatistics(
            requests=1, responses=1, errors=0, late=0, pending=0, servers=1
        )

    async def test_within_one_node(self, node: bus.Node) -> None:
        client = await node.create_client(AddTwoInts, "add")
        await node.create_service(AddTwoInts, "add", add)
        await client.wait_for_service()
        assert (await client.call(asked(20, 22))).sum == 42

    async def test_messages_without_fields(self, node: bus.Node, other: bus.Node) -> None:
        await node.create_service(Empty, "nothing", lambda request: Empty.Response())
        client = await other.create_client(Empty, "nothing")
        assert await client.call(Empty.Request()) == Empty.Response()

    async def test_the_form_of_ros(self, node: bus.Node, other: bus.Node) -> None:
        def fill(request: Any, response: Any) -> Any:
            response.sum = request.a
            return response

        await node.create_service(AddTwoInts, "add", fill)
        client = await other.create_client(AddTwoInts, "add")
        assert (await client.call(asked(5))).sum == 5

    @pytest.mark.parametrize("is_awaited", [False, True])
    async def test_a_burst_of_two_clients(self, node: bus.Node, other: bus.Node, is_awaited: bool) -> None:
        async def add_later(request: AddTwoInts.Request) -> AddTwoInts.Response:
            await asyncio.sleep(0)
            return add(request)

        await node.create_service(AddTwoInts, "add", add_later if is_awaited else add)
        clients = [await other.create_client(AddTwoInts, "add") for _ in range(2)]
        calls = [client.call(asked(a, b)) for b, client in enumerate(clients) for a in range(500)]
        sums = [answer.sum for answer in await asyncio.gather(*calls)]
        assert sums == [*range(500), *range(1, 501)]
        assert [client.statistics().late for client in clients] == [0, 0]

    async def test_requests_of_many_clients_wait(self, node: bus.Node, other: bus.Node) -> None:
        """More requests than the depth of each client, while the server takes none."""
        held: list[bus.RequestId] = []
        busy = asyncio.Event()

        async def on_request(request: Any, request_id: bus.RequestId) -> None:
            await busy.wait()
            held.append(request_id)

        service = await node.create_service(AddTwoInts, "add", on_request=on_request)
        clients = [
            await other.create_client(AddTwoInts, "add", on_response=lambda number, answer: None)
            for _ in range(3)
        ]
        for client in clients:
            for a in range(600):
                client.send_request(asked(a))
        busy.set()
        await until(lambda: len(held) == 1800)
        assert service.statistics().dropped == {}

    async def test_as_many_as_may_wait(self, node: bus.Node, other: bus.Node) -> None:
        held: list[tuple[Any, bus.RequestId]] = []
        service = await node.create_service(
            AddTwoInts, "add", on_request=lambda request, request_id: held.append((request, request_id))
        )
        client = await other.create_client(AddTwoInts, "add")
        calls = [asyncio.ensure_future(client.call(asked(a))) for a in range(MAX_PENDING)]
        await until(lambda: len(held) == MAX_PENDING)
        with pytest.raises(
            bus.LocalProtocolError, match="1000 calls of service '/add' wait for their answers"
        ):
            await client.call(asked(0))
        for request, request_id in reversed(held):
            service.respond(request_id, add(request))
        assert [answer.sum for answer in await asyncio.gather(*calls)] == list(range(MAX_PENDING))

    async def test_async_callbacks_run_side_by_side(self, node: bus.Node, other: bus.Node) -> None:
        waiting: list[int] = []
        everybody = asyncio.Event()

        async def meet(request: AddTwoInts.Request) -> AddTwoInts.Response:
            waiting.append(request.a)
            if len(waiting) == 20:
                everybody.set()
            await everybody.wait()
            return add(request)

        await node.create_service(AddTwoInts, "add", meet)
        client = await other.create_client(AddTwoInts, "add")
        answers = await asyncio.gather(*(client.call(asked(a)) for a in range(20)))
        assert [answer.sum for answer in answers] == list(range(20))

    async def test_async_callbacks_are_bounded(self, node: bus.Node, other: bus.Node) -> None:
        at_work, most = 0, 0

        async def work(request: AddTwoInts.Request) -> AddTwoInts.Response:
            nonlocal at_work, most
            at_work += 1
            most = max(most, at_work)
            for _ in range(5):
                await asyncio.sleep(0)
            at_work -= 1
            return add(request)

        await node.create_service(AddTwoInts, "add", work)
        client = await other.create_client(AddTwoInts, "add")
        await asyncio.gather(*(client.call(asked(a)) for a in range(300)))
        assert 1 < most <= 100

    async def test_with_back_pressure(self, node: bus.Node, other: bus.Node) -> None:
        keep_all = bus.QoSProfile(history="keep_all")
        await node.create_service(AddTwoInts, "add", add, keep_all)
        client = await other.create_client(AddTwoInts, "add", keep_all)
        answers = await asyncio.gather(*(client.call(asked(a)) for a in range(300)))
        assert [answer.sum for answer in answers] == list(range(300))

    @pytest.mark.parametrize("rule", ["add:=sum", "/add:=/sum"])
    async def test_remapped(self, daemon: Daemon, rule: str) -> None:
        async with bus.Node("one", arguments=["--ros-args", "-r", rule]) as node:
            assert node.resolve_service_name("add") == "/sum"
            await node.create_service(AddTwoInts, "add", add)
            client = await node.create_client(AddTwoInts, "sum")
            assert client.service_name == "/sum"
            assert (await client.call(asked(1, 1))).sum == 2

    async def test_names_are_checked(self, node: bus.Node) -> None:
        for make in (node.create_client(AddTwoInts, "no name"), node.create_service(AddTwoInts, "a//b", add)):
            with pytest.raises(bus.ConfigurationError):
                await make
        with pytest.raises(TypeError):
            await node.create_service(AddTwoInts, "add")
        with pytest.raises(TypeError):
            await node.create_service(AddTwoInts, "add", add, on_request=lambda request, request_id: None)

    async def test_what_the_broker_refuses_leaves_nothing(self, node: bus.Node) -> None:
        name = "n" * 240  # the topics' names are longer than the service's
        with pytest.raises(bus.ConfigurationError):
            await node.create_service(AddTwoInts, name, add)
        with pytest.raises(bus.ConfigurationError):
            await node.create_client(AddTwoInts, name)
        assert (await node.graph()).services() == {}

    async def test_the_graph(self, node: bus.Node, other: bus.Node) -> None:
        await node.create_service(AddTwoInts, "~/add", add)
        client = await other.create_client(AddTwoInts, "/tester/add")
        graph = await node.graph()
        assert graph.services() == {"/tester/add": ["example_interfaces/srv/AddTwoInts"]}
        assert [one.node.name for one in graph.servers_of("/tester/add")] == ["tester"]
        assert [one.node.name for one in graph.clients_of("/tester/add")] == ["caller"]
        await client.close()
        assert (await node.graph()).clients_of("/tester/add") == []

    async def test_what_is_closed_says_of_which_service(self, node: bus.Node) -> None:
        server = await node.create_service(AddTwoInts, "add", add)
        client = await node.create_client(AddTwoInts, "add")
        await client.close()
        await server.close()
        with pytest.raises(bus.ConnectionClosed, match="this end of service '/add' is closed"):
            await client.call(asked(1))
        with pytest.raises(bus.ConnectionClosed, match="this end of service '/add' is closed"):
            server.respond(bus.RequestId(bytes(16), 1), AddTwoInts.Response())


class TestLowLevel:
    async def test_numbers_and_errors(self, node: bus.Node, other: bus.Node) -> None:
        held: list[tuple[Any, bus.RequestId]] = []
        got: dict[int, Any] = {}
        service = await node.create_service(
            AddTwoInts, "add", on_request=lambda request, request_id: held.append((request, request_id))
        )
        client = await other.create_client(AddTwoInts, "add", on_response=got.__setitem__)
        numbers = [client.send_request(asked(a)) for a in range(3)]
        assert len(set(numbers) - {0}) == 3
        await until(lambda: len(held) == 3)
        assert client.forget(numbers[2])
        assert not client.forget(numbers[2])
        for (request, request_id), error in zip(held, ("", "no", ""), strict=True):
            assert service.respond(request_id, add(request), error)
        await until(lambda: client.statistics().late == 1)
        assert got[numbers[0]] == AddTwoInts.Response(sum=0)
        assert isinstance(got[numbers[1]], bus.ServiceError)
        assert set(got) == set(numbers[:2])
        assert (client.statistics().errors, service.statistics().errors) == (1, 1)

    async def test_from_threads(self, node: bus.Node, other: bus.Node) -> None:
        got: dict[int, Any] = {}
        working: list[asyncio.Future[Any]] = []

        def on_request(request: Any, request_id: bus.RequestId) -> None:
            working.append(
                asyncio.ensure_future(asyncio.to_thread(service.respond, request_id, add(request)))
            )

        service = await node.create_service(AddTwoInts, "add", on_request=on_request)
        client = await other.create_client(AddTwoInts, "add", on_response=got.__setitem__)
        number = await asyncio.to_thread(client.send_request, asked(3, 4))
        await until(lambda: number in got)
        assert got[number].sum == 7
        await asyncio.gather(*working)

    async def test_only_with_somebody_to_tell(self, node: bus.Node) -> None:
        client = await node.create_client(AddTwoInts, "add")
        with pytest.raises(bus.LocalProtocolError):
            client.send_request(asked(1))
