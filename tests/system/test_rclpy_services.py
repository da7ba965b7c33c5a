"""Services and clients of the facade, by both routes."""

import subprocess
import sys
import threading
from typing import Any

import pytest

import bus_ros.rclpy as rclpy
from bus.endpoint.endpoint import core_of
from bus.errors import ServiceError
from bus.service.client_core import MAX_PENDING
from bus_ros.rclpy.callback_groups import ReentrantCallbackGroup
from bus_ros.rclpy.client import Client
from bus_ros.rclpy.exceptions import InvalidHandle
from bus_ros.rclpy.executors import MultiThreadedExecutor
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.qos import qos_profile_services_default
from bus_ros.rclpy.service import Service
from bus_ros.rclpy.service_introspection import ServiceIntrospectionState
from bus_ros.rclpy.task import Future
from bus_ros.rosidl import service_class
from conftest import WAIT_S
from neighbours import with_limits
from rclpy_world import AddTwoInts, String, World, add, arguments, in_thread, wait_until, world

__all__ = ["arguments", "world"]

pytestmark = pytest.mark.usefixtures("route")


DOOMED = """
import asyncio, bus
from bus.srv.example_interfaces import AddTwoInts

async def main():
    async with bus.Node("doomed", arguments=[]) as node:
        client = await node.create_client(AddTwoInts, "add")
        await client.wait_for_service()
        await asyncio.gather(*(client.call(AddTwoInts.Request(a=a)) for a in range(50)))

bus.run(main())
"""


def asked(a: int, b: int = 0) -> Any:
    return AddTwoInts.Request(a=a, b=b)


@pytest.fixture
def server(world: World) -> Node:
    return world.node("server")


@pytest.fixture
def node(world: World) -> Node:
    return world.node("caller")


@pytest.fixture
def client(node: Node) -> Client:
    return node.create_client(AddTwoInts, "add")


def test_a_call_and_its_future(world: World, server: Node, node: Node, client: Client) -> None:
    service = server.create_service(AddTwoInts, "add", add)
    assert isinstance(service, Service)
    assert client.wait_for_service(timeout_sec=WAIT_S) and client.service_is_ready()
    future = client.call_async(asked(2, 3))
    assert isinstance(future, Future) and not future.done()
    with world.spinning(server):
        rclpy.spin_until_future_complete(node, future, timeout_sec=WAIT_S)
    assert future.result() == AddTwoInts.Response(sum=5)
    assert service.service_name == client.service_name == "/add"


def test_a_call_that_waits(world: World, server: Node, client: Client) -> None:
    """No thread spins the client's node."""
    server.create_service(AddTwoInts, "add", add)
    with world.spinning(server):
        assert client.call(asked(1, 1)).sum == 2


def test_calls_that_wait_in_many_threads(world: World, server: Node, node: Node, client: Client) -> None:
    """Each call gets its own answer, even while an executor takes answers."""
    server.create_service(AddTwoInts, "add", add)
    sums: dict[int, list[int]] = {}

    def ask(thread: int) -> None:
        sums[thread] = [client.call(asked(thread * 100, number)).sum for number in range(40)]

    with world.spinning(server), world.spinning(node):
        threads = [threading.Thread(target=ask, args=(index,)) for index in range(5)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(WAIT_S)
    assert sums == {index: [index * 100 + number for number in range(40)] for index in range(5)}


def test_done_callbacks_and_many_futures_at_once(world: World, server: Node, client: Client) -> None:
    server.create_service(AddTwoInts, "add", add)
    sums: list[int] = []
    for number in range(500):
        client.call_async(asked(number)).add_done_callback(lambda done: sums.append(done.result().sum))
    world.spin_until(lambda: len(sums) == 500)
    assert sums == list(range(500))


def test_a_cancelled_call_is_forgotten(world: World, server: Node, node: Node, client: Client) -> None:
    """Its answer is ignored, also if it waits for the executor already."""
    futures = [client.call_async(asked(1)) for _ in range(MAX_PENDING)]
    for future in futures:
        future.cancel()
    assert client.native.statistics().pending == 0 and client._futures == {}
    server.create_service(AddTwoInts, "add", add)
    assert client.wait_for_service(timeout_sec=WAIT_S)
    cancelled = client.call_async(asked(2))
    with world.spinning(server):
        wait_until(lambda: client._answers)
        cancelled.cancel()
        kept = client.call_async(asked(3))
        rclpy.spin_until_future_complete(node, kept, timeout_sec=WAIT_S)
    assert kept.result().sum == 3
    assert cancelled.cancelled() and cancelled.result() is None


def test_a_service_that_is_not_there(world: World, server: Node, client: Client) -> None:
    assert client.wait_for_service(timeout_sec=0) is False
    assert client.wait_for_service(timeout_sec=0.02) is False
    assert client.service_is_ready() is False
    assert client.call(asked(1), timeout_sec=0.05) is None
    assert client._futures == {}
    service = server.create_service(AddTwoInts, "add", add)
    assert client.wait_for_service() is True
    assert server.destroy_service(service)
    wait_until(lambda: not client.service_is_ready())


def test_waiting_for_a_service_that_comes(server: Node, client: Client) -> None:
    found: list[bool] = []
    with in_thread(lambda: found.append(client.wait_for_service(timeout_sec=-1))):
        server.create_service(AddTwoInts, "add", add)
    assert found == [True]


def test_a_shutdown_ends_the_waiting(world: World, server: Node, client: Client) -> None:
    began = threading.Event()
    found: list[Any] = []

    def wait() -> None:
        began.set()
        found.append(client.wait_for_service())
        found.append(client.call(asked(1)))

    with in_thread(wait):
        began.wait()
        rclpy.shutdown()
    assert found == [False, None]


def test_calls_made_before_the_server_is_there_stay_open(
    world: World, server: Node, node: Node, client: Client
) -> None:
    future = client.call_async(asked(1))
    assert client.get_pending_request(next(iter(client._futures))) is future
    server.create_service(AddTwoInts, "add", add)
    assert client.wait_for_service(timeout_sec=WAIT_S)
    second = client.call_async(asked(2))
    world.spin_until(second.done)
    assert not future.done()


def test_requests_that_are_given_up(world: World, server: Node, client: Client) -> None:
    server.create_service(AddTwoInts, "add", add)
    assert client.wait_for_service(timeout_sec=WAIT_S)
    first, second = client.call_async(asked(1)), client.call_async(asked(2))
    client.remove_pending_request(first)
    client.remove_pending_request(first)
    with pytest.raises(KeyError):
        client.get_pending_request(1 << 60)
    world.spin_until(second.done)
    assert not first.done() and second.result().sum == 2


def test_a_call_that_is_too_slow_gives_none(world: World, server: Node, client: Client) -> None:
    gate = threading.Event()

    def slow(request: Any, response: Any) -> Any:
        gate.wait(WAIT_S)
        return add(request, response)

    server.create_service(AddTwoInts, "add", slow)
    with world.spinning(server):
        assert client.wait_for_service(timeout_sec=WAIT_S)
        assert client.call(asked(1), timeout_sec=0.05) is None
        gate.set()
        assert client.call(asked(2), timeout_sec=WAIT_S).sum == 2


def test_what_is_no_request_or_response(world: World, server: Node, client: Client) -> None:
    for wrong in (AddTwoInts.Response(), String(), None):
        with pytest.raises(TypeError, match="expected a AddTwoInts_Request"):
            client.call_async(wrong)
        with pytest.raises(TypeError):
            client.call(wrong)
    server.create_service(AddTwoInts, "add", lambda request, response: None)
    assert client.wait_for_service(timeout_sec=WAIT_S)
    client.call_async(asked(1))
    with pytest.raises(TypeError, match="must return a AddTwoInts_Response, not NoneType"):
        rclpy.spin(server)


@with_limits(message_bytes=100_000)
@pytest.mark.parametrize("is_observed", [False, True])
def test_an_answer_that_is_too_large_is_refused_and_the_server_goes_on(
    world: World, server: Node, node: Node, is_observed: bool
) -> None:
    """Events of the service have the answer, too, and a little more."""
    kind = service_class("std_srvs/srv/Trigger")
    sizes = iter((200_000, 99_960, 5))
    service = server.create_service(
        kind,
        "say",
        lambda request, response: kind.Response(message="x" * next(sizes)),  # type: ignore[attr-defined]
    )
    if is_observed:
        state = ServiceIntrospectionState.CONTENTS
        service.configure_introspection(server.get_clock(), qos_profile_services_default, state)
    client = node.create_client(kind, "say")
    with world.spinning(server):
        assert client.wait_for_service(timeout_sec=WAIT_S)
        with pytest.raises(ServiceError, match="PayloadTooLarge"):
            client.call(kind.Request(), timeout_sec=WAIT_S)  # type: ignore[attr-defined]
        for size in (99_960, 5):
            answer: Any = client.call(kind.Request(), timeout_sec=WAIT_S)  # type: ignore[attr-defined]
            assert len(answer.message) == size
    assert service.native.statistics().responses == 3


def test_an_answer_without_room_follows_later(
    world: World, server: Node, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Under keep all, a slow client must not end the server."""
    service = server.create_service(AddTwoInts, "add", lambda request, response: response)
    outcomes = [False]
    core = core_of(service.native)
    publish = core._publish
    monkeypatch.setattr(core, "_publish", lambda answer: outcomes.pop() if outcomes else publish(answer))

    async def wait() -> None: ...

    monkeypatch.setattr(core.replies, "wait_for_room", wait)
    with world.spinning(server):
        assert client.wait_for_service(timeout_sec=WAIT_S)
        assert client.call(asked(1), timeout_sec=WAIT_S).sum == 0
    assert not outcomes


@pytest.mark.parametrize("is_early", [False, True])
def test_of_too_many_requests_the_oldest_is_refused(
    world: World, server: Node, client: Client, monkeypatch: pytest.MonkeyPatch, is_early: bool
) -> None:
    """They may come before `create_service` has returned."""
    monkeypatch.setattr(rclpy.service, "MOST_WAITING", 1)
    service = server.create_service(AddTwoInts, "add", lambda request, response: response)
    assert client.wait_for_service(timeout_sec=WAIT_S)
    native = service.native
    if is_early:
        del service.native
        service.is_queued = True
    oldest, newest = client.call_async(asked(1)), client.call_async(asked(2))
    wait_until(lambda: native.statistics().requests == 2)
    if is_early:
        with service._guard:
            service.begin(native)
            service.notify()
    with world.spinning(server):
        world.spin_until(newest.done)
    assert newest.result().sum == 0
    assert oldest.done() is not is_early
    if not is_early:
        with pytest.raises(ServiceError, match="too many requests wait"):
            oldest.result()


def test_a_server_that_raises(world: World, server: Node, client: Client) -> None:
    """The exception leaves the server's spin, and the client gets the error."""

    def fail(request: Any, response: Any) -> Any:
        raise ZeroDivisionError("by design")

    server.create_service(AddTwoInts, "add", fail)
    assert client.wait_for_service(timeout_sec=WAIT_S)
    future = client.call_async(asked(1))
    with pytest.raises(ZeroDivisionError, match="by design"):
        rclpy.spin(server)
    world.spin_until(future.done)
    with pytest.raises(ServiceError, match="service '/add' failed: ZeroDivisionError: by design"):
        future.result()


@pytest.mark.parametrize("is_multi", [False, True])
def test_an_async_service_that_asks_another(world: World, server: Node, node: Node, is_multi: bool) -> None:
    group = ReentrantCallbackGroup()
    inner = server.create_client(AddTwoInts, "inner", callback_group=group)
    world.node("last").create_service(AddTwoInts, "inner", add)

    async def twice(request: Any, response: Any) -> Any:
        for _ in range(2):
            response.sum += (await inner.call_async(request)).sum
        return response

    server.create_service(AddTwoInts, "twice", twice, callback_group=group)
    client = node.create_client(AddTwoInts, "twice")
    assert client.wait_for_service(timeout_sec=WAIT_S) and inner.wait_for_service(timeout_sec=WAIT_S)
    futures = [client.call_async(asked(number, 1)) for number in range(20)]
    nodes = [one for one in world.nodes() if one is not node]
    kind: Any = (lambda: MultiThreadedExecutor(3)) if is_multi else None
    with world.spinning(*nodes, **({"kind": kind} if kind else {})):
        world.spin_until(lambda: all(future.done() for future in futures), node)
    assert [future.result().sum for future in futures] == [2 * (number + 1) for number in range(20)]


def test_an_async_callback_that_awaits_an_answer(world: World, server: Node, node: Node) -> None:
    """It is in the group of its client, as in most programs."""
    server.create_service(AddTwoInts, "add", add)
    client = node.create_client(AddTwoInts, "add")
    sums: list[int] = []

    async def ask(message: Any) -> None:
        sums.append((await client.call_async(asked(int(message.data), 1))).sum)

    node.create_subscription(String, "t", ask, 10)
    publisher = node.create_publisher(String, "t", 10)
    assert client.wait_for_service(timeout_sec=WAIT_S)
    for number in range(5):
        publisher.publish(String(data=str(number)))
    world.spin_until(lambda: len(sums) == 5)
    assert sums == [1, 2, 3, 4, 5]


def test_two_servers(world: World, server: Node, node: Node, client: Client) -> None:
    """Each call gets one answer; the second one is ignored."""
    calls: list[str] = []

    def serve(name: str) -> Any:
        def answer(request: Any, response: Any) -> Any:
            calls.append(name)
            return add(request, response)

        return answer

    for name in ("first", "second"):
        world.node(name).create_service(AddTwoInts, "add", serve(name))
    wait_until(lambda: node.count_services("add") == 2)
    assert client.wait_for_service(timeout_sec=WAIT_S)
    futures = [client.call_async(asked(number)) for number in range(20)]
    world.spin_until(lambda: all(future.done() for future in futures))
    assert [future.result().sum for future in futures] == list(range(20))
    assert set(calls) <= {"first", "second"} and len(calls) >= 20


def test_answers_come_in_the_order_of_the_calls(world: World, server: Node, client: Client) -> None:
    seen: list[int] = []

    def note(request: Any, response: Any) -> Any:
        seen.append(request.a)
        return add(request, response)

    server.create_service(AddTwoInts, "add", note)
    assert client.wait_for_service(timeout_sec=WAIT_S)
    done: list[int] = []
    for number in range(100):
        client.call_async(asked(number)).add_done_callback(lambda future: done.append(future.result().sum))
    world.spin_until(lambda: len(done) == 100)
    assert seen == done == list(range(100))


def test_requests_of_a_dead_client_are_skipped(world: World, server: Node, client: Client) -> None:
    seen: list[int] = []

    def note(request: Any, response: Any) -> Any:
        seen.append(request.a)
        return add(request, response)

    service = server.create_service(AddTwoInts, "add", note)
    assert client.wait_for_service(timeout_sec=WAIT_S)
    with subprocess.Popen([sys.executable, "-c", DOOMED]) as doomed:
        wait_until(lambda: len(service._waiting) == 50)  # no thread spins
        doomed.kill()
    wait_until(lambda: server.count_clients("add") == 1)
    future = client.call_async(asked(1000))
    world.spin_until(future.done)
    assert future.result().sum == 1000
    assert seen == [1000]
    assert service.native.statistics().skipped == 50


def test_a_response_must_be_one(world: World, server: Node, client: Client) -> None:
    service = server.create_service(AddTwoInts, "add", add)
    with pytest.raises(TypeError, match="must return a AddTwoInts_Response, not AddTwoInts_Request"):
        service.send_response(asked(1), None)  # type: ignore[arg-type]


def test_destroyed_clients_and_services(world: World, server: Node, node: Node, client: Client) -> None:
    service = server.create_service(AddTwoInts, "add", add)
    assert client.wait_for_service(timeout_sec=WAIT_S)
    service.destroy()
    wait_until(lambda: not client.service_is_ready())
    client.destroy()
    wait_until(lambda: server.count_clients("add") == 0)
    assert list(node.clients) == list(server.services) == []
    with pytest.raises(InvalidHandle, match="the client of service '/add' is destroyed"):
        client.call_async(asked(1))


@pytest.mark.parametrize("whole", [False, True], ids=["service", "node"])
def test_a_callback_that_destroys_its_service(
    world: World, server: Node, client: Client, whole: bool
) -> None:
    """The thread that spins gets an error: no answer can be sent."""

    def end(request: Any, response: Any) -> Any:
        if whole:
            server.destroy_node()
        else:
            service.destroy()
        return response

    service = server.create_service(AddTwoInts, "add", end)
    assert client.wait_for_service(timeout_sec=WAIT_S)
    client.call_async(asked(1))
    with pytest.raises(InvalidHandle, match="the service '/add' is destroyed"):
        world.spin_until(lambda: False, server)
