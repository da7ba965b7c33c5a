"""Wrong requests, answers and clocks: their receivers continue, and oversized ones are never sent on."""

import asyncio
import signal
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

import bus
from bus.endpoint.endpoint import core_of
from bus.events import PublisherEvents
from bus.publisher import Publisher
from bus.srv.example_interfaces import AddTwoInts
from bus.types.service import GID_BYTES, service_support
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.parameter import Parameter
from bus_ros.rosidl import message_class, service_class
from conftest import Daemon
from programs import on_one_loop, running
from rclpy_world import AddTwoInts as FacadeAddTwoInts
from rclpy_world import World, arguments, in_thread, world
from semantics import node, until

__all__ = ["arguments", "node", "world"]

_SUPPORT = service_support(AddTwoInts)
_encode = msgspec.msgpack.encode
_GID = b"x" * GID_BYTES
_HEADS: list[Any] = [
    # a wrong client's gid or a wrong number of the call
    [b"", 1],
    [_GID[1:], 1],
    [b"x" * 1_000_000, 1],
    [_GID, -1],
    [_GID, 2**63 * 1.5],
    [_GID, "1"],
    ["x" * GID_BYTES, 1],
]
_SHAPES: list[bytes] = [
    b"",
    b"\xc1",
    b"\x93" * 100_000,
    _encode(None),
    _encode([_GID]),
    _encode([_GID, 1]),
    _encode({"client": _GID, "number": 1, "body": [1, 2]}),
]
_BODIES: list[Any] = [7, "x", ["a", "b"], [2**63, 0], {"a": 1}]

BAD_REQUESTS = [
    *_SHAPES,
    *(_encode([*head, [1, 2]]) for head in _HEADS),
    *(_encode([_GID, 1, body]) for body in _BODIES),
]
CLOCKS = [(-1, 0), (-(2**31), 2**32 - 1)]

SERVER = """
import asyncio, bus
from bus.srv.example_interfaces import AddTwoInts

async def main():
    async with bus.Node("server", arguments=[]) as node:
        await node.create_service(AddTwoInts, "add", lambda it: AddTwoInts.Response(sum=it.a + it.b))
        print("ready", flush=True)
        await asyncio.Event().wait()

bus.run(main())
"""


def bad_replies(client: bytes) -> list[bytes]:
    return [
        *_SHAPES,
        *(_encode([*head, "", [3]]) for head in _HEADS),
        *(_encode([client, 1, "", body]) for body in _BODIES),
        _encode([client, 1, 5, None]),
        _encode([client, 1, b"\xff", None]),
    ]


def asked(a: int, b: int = 0) -> AddTwoInts.Request:
    return AddTwoInts.Request(a=a, b=b)


def add(request: AddTwoInts.Request) -> AddTwoInts.Response:
    return AddTwoInts.Response(sum=request.a + request.b)


@pytest.fixture
async def other(daemon: Daemon) -> AsyncIterator[bus.Node]:
    async with bus.Node("other", arguments=[], rosout=False) as other:
        yield other


async def liar(node: bus.Node, topic: str, support: Any) -> Publisher[Any]:
    """A publisher that claims the type of `support`, so that a test can send any bytes."""
    publisher: Publisher[Any] = Publisher(
        node._opened(), topic, support, bus.QoSProfile(1000), PublisherEvents()
    )
    await node._endpoints.declare(publisher._core)
    return publisher


def send(publisher: Publisher[Any], payloads: list[bytes]) -> None:
    for payload in payloads:
        assert publisher.publish_encoded(payload)


@pytest.mark.usefixtures("route")
class TestLies:
    async def test_requests(self, node: bus.Node, other: bus.Node) -> None:
        service = await node.create_service(AddTwoInts, "add", add)
        client = await other.create_client(AddTwoInts, "add")
        questions = [_SUPPORT.encode_question(_GID, number) for number in range(50)]  # for a stranger's calls
        send(await liar(other, "/add/_request", _SUPPORT.requests), [*questions, *BAD_REQUESTS])
        await until(lambda: service.statistics().dropped == {"undecodable": len(BAD_REQUESTS)})
        assert (await client.call(asked(1, 2))).sum == 3
        assert service.statistics().requests == service.statistics().responses == 1

    async def test_replies(self, node: bus.Node, other: bus.Node) -> None:
        called = asyncio.Event()
        may_answer = asyncio.Event()

        async def slow(request: AddTwoInts.Request) -> AddTwoInts.Response:
            called.set()
            await may_answer.wait()
            return add(request)

        await node.create_service(AddTwoInts, "add", slow)
        client = await other.create_client(AddTwoInts, "add")
        call = asyncio.ensure_future(client.call(asked(1, 2)))
        await called.wait()
        lies = bad_replies(core_of(client).gid)
        foreign = [_encode([_GID, 1, "", [4]]), _encode([_GID, 1, "it failed", None])]
        unasked = [_encode([core_of(client).gid, number, "", [5]]) for number in (0, 2, 2**64 - 1)]
        unasked.append(_SUPPORT.encode_denial(core_of(client).gid, 3))
        send(await liar(other, "/add/_reply", _SUPPORT.replies(b"")), [*lies, *foreign, *unasked])
        await until(lambda: client.statistics().late == len(unasked))
        assert core_of(client).replies.statistics().dropped == {"undecodable": len(lies)}
        may_answer.set()
        assert (await call).sum == 3
        assert client.statistics().pending == 0

    async def test_an_answer_that_comes_twice(self, node: bus.Node, other: bus.Node) -> None:
        client = await other.create_client(AddTwoInts, "add")

        def twice(request: AddTwoInts.Request) -> AddTwoInts.Response:
            response = AddTwoInts.Response(sum=7)
            server.respond(bus.RequestId(core_of(client).gid, request.a), response)
            return response

        server = await node.create_service(AddTwoInts, "add", twice)
        await client.wait_for_service()
        assert (await client.call(asked(1))).sum == 7
        await until(lambda: client.statistics().late == 1)
        assert client.statistics().responses == 1


@on_one_loop
async def test_a_server_that_is_stopped(node: bus.Node, tmp_path: Path) -> None:
    """Its clients wait or cancel their calls; they continue when it does."""
    async with running(tmp_path, "-c", SERVER) as server:
        await server.line("ready")
        client = await node.create_client(AddTwoInts, "add")
        server.process.send_signal(signal.SIGSTOP)
        given_up = asyncio.ensure_future(client.call(asked(1)))
        waiting = asyncio.ensure_future(client.call(asked(1, 2)))
        await until(lambda: client.statistics().pending == 2)
        given_up.cancel()
        await asyncio.wait([given_up])
        server.process.send_signal(signal.SIGCONT)
        assert (await waiting).sum == 3
        await until(lambda: client.statistics().late == 1)


class TestFacade:
    @pytest.fixture
    def node(self, world: World) -> Node:
        return world.node("victim", start_parameter_services=True, allow_undeclared_parameters=True)

    def test_clocks(self, world: World, node: Node) -> None:
        """These clocks used to raise exceptions out of the program's `spin`."""
        node.set_parameters([Parameter("use_sim_time", value=True)])
        message = message_class("rosgraph_msgs/msg/Clock")
        publisher = world.node("liar").create_publisher(message, "/clock", 10)
        for sec, nanosec in (*CLOCKS, (7, 0)):
            clock = message()
            clock.clock.sec, clock.clock.nanosec = sec, nanosec  # type: ignore[attr-defined]
            publisher.publish(clock)
            world.spin_until(lambda: publisher.wait_for_all_acked(), node)
        world.spin_until(lambda: node.get_clock().now().nanoseconds == 7 * 10**9, node)

    def test_parameters(self, world: World, node: Node) -> None:
        node.declare_parameter("x", 1)
        caller = world.node("caller")
        service = service_class("rcl_interfaces/srv/SetParameters")
        client = caller.create_client(service, "/victim/set_parameters")
        values: list[dict[str, Any]] = [
            {"type": 255},
            {"type": 4, "string_value": "\0"},
            {"type": 0},
            {"type": 5},
        ]
        parameters = []
        for fields in values:
            parameter = message_class("rcl_interfaces/msg/Parameter")(name="x")  # type: ignore[call-arg]
            parameter.value = message_class("rcl_interfaces/msg/ParameterValue")(**fields)  # type: ignore[attr-defined]
            parameters.append(parameter)
        with world.spinning(node):
            results = client.call(service.Request(parameters=parameters)).results  # type: ignore[attr-defined]
        assert [one.successful for one in results] == [False] * len(values)
        assert node.get_parameter("x").value == 1

    @pytest.mark.parametrize("answer", [lambda: None, lambda: 5, FacadeAddTwoInts.Request])
    def test_a_wrong_answer_is_told_to_both(
        self, world: World, node: Node, answer: Callable[[], Any]
    ) -> None:
        node.create_service(FacadeAddTwoInts, "add", lambda request, response: answer())
        client = world.node("caller").create_client(FacadeAddTwoInts, "add")
        told: list[str] = []

        def call() -> None:
            with pytest.raises(bus.ServiceError) as caught:
                client.call(FacadeAddTwoInts.Request())
            told.append(str(caught.value))

        text = "the callback of service '/add' must return a AddTwoInts_Response, not "
        with in_thread(call), pytest.raises(TypeError, match=text):
            world.executor(node).spin()
        assert text in told[0]
