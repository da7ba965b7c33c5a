"""AsyncNode of rclpy.experimental on the test's daemon, by both routes and on both event loops."""

import asyncio
from typing import Any

import pytest

import bus_ros.rclpy as rclpy
from bus.node import Node as NativeNode
from bus_ros import engine as engines
from bus_ros.rclpy.exceptions import InvalidHandle, TimeSourceChangedError
from bus_ros.rclpy.executors import ExternalShutdownException
from bus_ros.rclpy.experimental import AsyncNode, AsyncTimer
from bus_ros.rclpy.parameter import Parameter
from bus_ros.rclpy.time import Time
from bus_ros.rclpy.timer import TimerInfo
from bus_ros.rosidl import message_class, service_class
from conftest import Daemon
from rclpy_async_world import String, context, node
from semantics import until

__all__ = ["context", "node"]

pytestmark = pytest.mark.usefixtures("route", "context")

Clock: Any = message_class("rosgraph_msgs/msg/Clock")
SetBool: Any = service_class("std_srvs/srv/SetBool")
S = 10**9


def invert(request: Any, response: Any) -> Any:
    response.success = not request.data
    return response


class TestServices:
    async def test_a_call(self) -> None:
        async with AsyncNode("server") as server, AsyncNode("client") as client_node:
            server.create_service(SetBool, "invert", invert)
            client = client_node.create_client(SetBool, "invert")
            await client.wait_for_service()
            assert client.service_is_ready()
            assert (await client.call(SetBool.Request(data=False))).success is True

    async def test_sequential_and_concurrent_callbacks(self, node: AsyncNode) -> None:
        running, most = 0, 0

        async def callback(request: Any, response: Any) -> Any:
            nonlocal running, most
            running += 1
            most = max(most, running)
            await asyncio.sleep(0.01)
            running -= 1
            return response

        for name, expected in (("sequential", 1), ("concurrent", 3)):
            most = 0
            node.create_service(SetBool, name, callback, concurrent=name == "concurrent")
            client = node.create_client(SetBool, name)
            await client.wait_for_service()
            await asyncio.gather(*(client.call(SetBool.Request()) for _ in range(3)))
            assert most == expected

    async def test_a_call_from_a_callback(self, node: AsyncNode) -> None:
        node.create_service(SetBool, "inner", invert)
        inner = node.create_client(SetBool, "inner")

        async def outer(request: Any, response: Any) -> Any:
            return await inner.call(request)

        node.create_service(SetBool, "outer", outer)
        client = node.create_client(SetBool, "outer")
        await client.wait_for_service()
        await inner.wait_for_service()
        assert (await client.call(SetBool.Request(data=True))).success is False

    async def test_a_cancelled_call_is_forgotten(self, node: AsyncNode) -> None:
        client = node.create_client(SetBool, "nobody")
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.01):
                await client.call(SetBool.Request())
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.01):
                await client.wait_for_service()
        assert client._pending_requests == {}

    async def test_requests_by_the_handle(self, node: AsyncNode) -> None:
        node.create_service(SetBool, "invert", invert)
        client = node.create_client(SetBool, "invert")
        futures = []
        for data in (True, False):  # the first before the client is open
            number = client.handle.send_request(SetBool.Request(data=data))
            client._pending_requests[number] = asyncio.get_running_loop().create_future()
            futures.append(client._pending_requests[number])
            await client.wait_for_service()
        assert [(await future).success for future in futures] == [False, True]

    async def test_a_call_waits_for_a_server_that_is_being_made(
        self, node: AsyncNode, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """As in ROS 2, a program may make a server and call it at once, also by a client made before."""
        may_open = asyncio.Event()
        create_service = NativeNode.create_service

        async def create_late(*args: Any, **named: Any) -> Any:
            await may_open.wait()
            return await create_service(*args, **named)

        monkeypatch.setattr(NativeNode, "create_service", create_late)
        early = node.create_client(SetBool, "invert")
        await until(lambda: early.state.name == "OPEN")
        node.create_service(SetBool, "invert", invert)
        late = node.create_client(SetBool, "invert")
        destroyed = node.create_client(SetBool, "invert")
        calls = [asyncio.create_task(one.call(SetBool.Request())) for one in (early, late, destroyed)]
        await until(lambda: late.state.name == destroyed.state.name == "OPEN")
        destroyed.destroy()
        assert not late.service_is_ready()
        may_open.set()
        assert [(await call).success for call in calls[:2]] == [True, True]
        with pytest.raises(asyncio.CancelledError):
            await calls[2]

    async def test_a_destroyed_client(self, node: AsyncNode) -> None:
        client = node.create_client(SetBool, "nobody")
        call = asyncio.create_task(client.call(SetBool.Request()))
        await until(lambda: client._pending_requests)
        client.destroy()
        with pytest.raises(asyncio.CancelledError):
            await call
        client = node.create_client(SetBool, "nobody")
        waiting = asyncio.create_task(client.wait_for_service())
        await until(lambda: client._native is not None and client._is_open.is_set())
        await asyncio.sleep(0)
        client.destroy()
        with pytest.raises(asyncio.CancelledError):
            await waiting
        with pytest.raises(RuntimeError, match="is destroyed"):
            await client.call(SetBool.Request())
        with pytest.raises(TypeError, match="expected a SetBool_Request"):
            await node.create_client(SetBool, "x").call("text")

    async def test_parameters_of_another_node(self) -> None:
        get: Any = service_class("rcl_interfaces/srv/GetParameters")
        async with AsyncNode("server") as server, AsyncNode("client") as client_node:
            server.declare_parameter("answer", 42)
            client = client_node.create_client(get, "/server/get_parameters")
            await client.wait_for_service()
            response = await client.call(get.Request(names=["answer"]))
        assert response.values[0].integer_value == 42

    async def test_logger_levels_and_types(self) -> None:
        levels: Any = service_class("rcl_interfaces/srv/GetLoggerLevels")
        types: Any = service_class("type_description_interfaces/srv/GetTypeDescription")
        async with AsyncNode("server", enable_logger_service=True) as server:
            server.create_publisher(String, "chatter", 10)
            client = server.create_client(levels, "/server/get_logger_levels")
            await client.wait_for_service()
            name = server.get_logger().name
            assert (await client.call(levels.Request(names=[name]))).levels[0].name == name
            describe = server.create_client(types, "/server/get_type_description")
            await describe.wait_for_service()
            info = server.get_publishers_info_by_topic("/chatter")[0]
            request = types.Request(type_name="std_msgs/msg/String", type_hash=str(info.topic_type_hash))
            assert (await describe.call(request)).successful


class TestTimers:
    async def test_calls_and_info(self, node: AsyncNode) -> None:
        infos: list[TimerInfo] = []
        timer = node.create_timer(0.001, lambda info: infos.append(info))
        assert isinstance(timer, AsyncTimer) and timer.timer_period_ns == 10**6
        await until(lambda: len(infos) >= 3)
        assert infos[0].expected_call_time <= infos[0].actual_call_time <= node.get_clock().now()
        timer.cancel()
        calls = len(infos)
        assert timer.is_canceled() and timer.time_until_next_call() is None
        await asyncio.sleep(0.01)
        assert len(infos) == calls
        timer.reset()
        await until(lambda: len(infos) > calls)
        timer.destroy()
        assert list(node.timers) == []

    async def test_async_callbacks_never_overlap(self, node: AsyncNode) -> None:
        running, most, calls = 0, 0, 0

        async def callback() -> None:
            nonlocal running, most, calls
            running += 1
            most = max(most, running)
            timer.reset()
            await asyncio.sleep(0.003)
            running -= 1
            calls += 1

        timer = node.create_timer(0.001, callback)
        await until(lambda: calls == 3)
        assert most == 1

    async def test_made_before_the_node_runs_and_not_started(self) -> None:
        node = AsyncNode("tester")
        calls: list[int] = []
        first = node.create_timer(0.001, lambda: calls.append(1))
        second = node.create_timer(0.001, lambda: calls.append(2), autostart=False)
        async with node:
            await until(lambda: calls)
            assert second.is_canceled() and 2 not in calls
            first.cancel()
            second.reset()
            await until(lambda: 2 in calls)

    async def test_a_callback_with_too_many_arguments(self, node: AsyncNode) -> None:
        with pytest.raises(RuntimeError, match="takes no argument, or one"):
            node.create_timer(1, lambda a, b: None)

    async def test_simulated_time(self) -> None:
        async with AsyncNode("simulator") as simulator, AsyncNode("tester") as node:
            publisher = simulator.create_publisher(Clock, "/clock", 1)
            calls: list[int] = []
            node.set_parameters([Parameter("use_sim_time", value=True)])
            await until(lambda: publisher.get_subscription_count() == 1)
            clock = node.get_clock()
            assert clock.ros_time_is_active

            async def at(seconds: int) -> None:
                publisher.publish(Clock(clock=Time(seconds=seconds).to_msg()))
                await until(lambda: clock.now().nanoseconds == seconds * S)

            await at(1000)
            node.create_timer(10, lambda: calls.append(1))
            sleep = asyncio.create_task(clock.sleep(30))
            await asyncio.sleep(0)
            await at(1009)
            assert calls == []
            await at(1010)
            await until(lambda: calls == [1])
            assert not sleep.done()
            await at(1031)
            await sleep
            await until(lambda: calls == [1, 1])


class TestClock:
    async def test_sleep(self, node: AsyncNode) -> None:
        await node.get_clock().sleep(0.001)
        await node.get_clock().sleep(0)

    async def test_a_change_of_the_source_of_time(self, node: AsyncNode) -> None:
        asyncio.get_running_loop().call_soon(node.set_parameters, [Parameter("use_sim_time", value=True)])
        with pytest.raises(TimeSourceChangedError):
            await node.get_clock().sleep(999)

    async def test_the_end_of_the_node(self) -> None:
        async with AsyncNode("tester") as node:
            asyncio.get_running_loop().call_soon(node.destroy_node)
            with pytest.raises(asyncio.CancelledError):
                await node.get_clock().sleep(999)
        with pytest.raises(RuntimeError, match="destroyed node"):
            await node.get_clock().sleep(1)


class TestLife:
    async def test_run_until_destroyed(self) -> None:
        node = AsyncNode("tester")
        node.create_timer(0.001, node.destroy_node)
        await node.run()
        with pytest.raises(RuntimeError, match="is destroyed and can't run again"):
            await node.run()
        with pytest.raises(InvalidHandle, match="cannot create a publisher: node '/tester' is destroyed"):
            node.create_publisher(String, "chatter", 10)

    async def test_destroyed_before_it_runs(self) -> None:
        node = AsyncNode("tester")
        node.create_publisher(String, "chatter", 10).publish(String())
        node.destroy_node()
        with pytest.raises(RuntimeError, match="is destroyed"):
            await node.run()

    async def test_it_runs_only_once(self, node: AsyncNode) -> None:
        with pytest.raises(RuntimeError, match="node '/tester' runs already"):
            await node.run()

    @pytest.mark.parametrize("kind", ["sequential", "concurrent", "plain", "timer", "service"])
    async def test_an_exception_in_a_callback_ends_it(self, kind: str) -> None:
        def fail(*arguments: Any) -> None:
            raise ValueError("boom")

        async def fail_async(*arguments: Any) -> None:
            await asyncio.sleep(0)
            raise ValueError("boom")

        node = AsyncNode("tester")
        ended = False
        with pytest.raises(ExceptionGroup) as raised:
            async with node:
                if kind == "timer":
                    node.create_timer(0.001, fail_async)
                elif kind == "service":
                    node.create_service(SetBool, "fail", fail_async)
                    client = node.create_client(SetBool, "fail")
                    await client.wait_for_service()
                    client.handle.send_request(SetBool.Request())
                else:
                    callback = fail if kind == "plain" else fail_async
                    node.create_subscription(
                        String, "chatter", lambda m: callback(m), 10, concurrent=False
                    ) if kind == "plain" else node.create_subscription(
                        String, "chatter", fail_async, 10, concurrent=kind == "concurrent"
                    )
                    node.create_publisher(String, "chatter", 10).publish(String())
                try:
                    await asyncio.sleep(60)
                finally:
                    ended = True
        assert ended and raised.group_contains(ValueError, match="boom")

    async def test_the_end_of_the_context_ends_it(self) -> None:
        node = AsyncNode("tester")
        node.create_timer(0.001, rclpy.try_shutdown)
        with pytest.raises(ExternalShutdownException):
            await node.run()

    async def test_the_end_of_the_context_before_it_or_after_it(self) -> None:
        async with AsyncNode("first"):
            pass
        node = AsyncNode("late")
        rclpy.try_shutdown()
        await asyncio.sleep(0)
        await asyncio.sleep(0)  # the first node has ended: this task is not cancelled
        with pytest.raises(ExternalShutdownException):
            await node.run()

    async def test_endpoints_are_destroyed_after_the_loop(self) -> None:
        """As at the end of a program: no task, and no event loop runs."""

        def run() -> None:
            async def main() -> AsyncNode:
                async with AsyncNode("tester") as node:
                    node.create_timer(1, print)
                    node.create_subscription(String, "chatter", print, 10)
                    node.create_service(SetBool, "invert", invert)
                return node

            node = asyncio.run(main())
            node.destroy_node()
            made = AsyncNode("never_run")
            made.create_subscription(String, "chatter", print, 10)
            made.create_timer(1, print)
            made.destroy_node()

        await asyncio.to_thread(run)

    async def test_cancellation_ends_it(self, daemon: Daemon) -> None:
        task = asyncio.create_task(AsyncNode("tester").run())
        async with NativeNode("watcher", arguments=[]) as watcher:
            await watcher.wait_for_graph(lambda graph: any(one.name == "tester" for one in graph.nodes))
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            await watcher.wait_for_graph(lambda graph: all(one.name != "tester" for one in graph.nodes))

    async def test_beside_a_node_with_an_executor(self, node: AsyncNode) -> None:
        """Programs move one node at a time."""
        got: list[str] = []
        node.create_subscription(String, "chatter", lambda message: got.append(message.data), 10)
        await until(lambda: node.count_subscribers("chatter") == 1)

        def talk() -> None:
            talker = rclpy.create_node("talker")
            publisher = talker.create_publisher(String, "chatter", 10)
            publisher.publish(String(data="from a thread"))
            talker.destroy_node()

        await asyncio.to_thread(talk)
        await until(lambda: got)
        await asyncio.to_thread(engines.end)


class TestGraph:
    async def test_new_endpoints_are_in_it_at_once(self, node: AsyncNode) -> None:
        node.create_publisher(String, "chatter", 10)
        node.create_subscription(String, "chatter", print, 10)
        node.create_service(SetBool, "invert", invert)
        node.create_client(SetBool, "invert")
        for _ in range(2):  # before busd knows them, and after
            assert node.count_publishers("chatter") == node.count_subscribers("chatter") == 1
            assert node.count_services("invert") == node.count_clients("invert") == 1
            assert ("/chatter", ["std_msgs/msg/String"]) in node.get_topic_names_and_types()
            assert ("/invert", ["std_srvs/srv/SetBool"]) in node.get_service_names_and_types()
            await until(lambda: all(one.state.name == "OPEN" for one in node.publishers))
            await until(lambda: all(one.state.name == "OPEN" for one in node.clients))

    async def test_names(self) -> None:
        async with AsyncNode("tester", namespace="/test") as node:
            assert node.get_fully_qualified_name() == "/test/tester"
            assert node.get_node_names_and_namespaces() == [("tester", "/test")]
            assert repr(node) == "<AsyncNode /test/tester>"

    async def test_waiting_for_a_node(self, node: AsyncNode) -> None:
        waiting = asyncio.create_task(node.wait_for_node("/test/late"))
        async with AsyncNode("late", namespace="/test"):
            await waiting
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.01):
                await node.wait_for_node("nobody")
