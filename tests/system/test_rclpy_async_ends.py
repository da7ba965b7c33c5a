"""The end of an AsyncNode at bad moments: signals, cancellations, endpoints that destroy themselves."""

import asyncio
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import bus_ros.rclpy as rclpy
from bus.node import Node as NativeNode
from bus_ros.rclpy.executors import ExternalShutdownException
from bus_ros.rclpy.experimental import AsyncNode
from bus_ros.rclpy.qos import QoSProfile
from bus_ros.rosidl import message_class, service_class
from programs import on_one_loop, running
from rclpy_async_world import String, context, node
from semantics import until

__all__ = ["context", "node"]

Int32: Any = message_class("std_msgs/msg/Int32")
SetBool: Any = service_class("std_srvs/srv/SetBool")

INSIDE = """\
import asyncio, rclpy, sys
from rclpy.experimental import AsyncNode

async def main():
    with rclpy.init():
        node = AsyncNode('tester')
        print('up', flush=True)
        {wait}
        await node.run()
        print('went on')

asyncio.run(main())
"""
BEFORE = """\
import asyncio, rclpy, sys
from rclpy.experimental import AsyncNode

rclpy.init()
node = AsyncNode('tester')

async def main():
    print('up', flush=True)
    {wait}
    await node.run()
    print('went on')

asyncio.run(main())
"""


@pytest.mark.usefixtures("daemon")
@pytest.mark.parametrize("wait", ["pass", "import time; time.sleep(1)"], ids=["running", "not yet running"])
@pytest.mark.parametrize("text", [INSIDE, BEFORE], ids=["init inside", "init before"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["INT", "TERM"])
@on_one_loop
async def test_a_signal(tmp_path: Path, number: signal.Signals, text: str, wait: str) -> None:
    """It ends the program by that signal and without a traceback, also if the node does not run yet."""
    script = tmp_path / "program.py"
    script.write_text(text.format(wait=wait))
    async with NativeNode("watcher", arguments=[]) as watcher:
        async with running(tmp_path, "-m", "bus_cli", "run", script) as one:
            await one.line("^up$")
            if wait == "pass":
                await watcher.wait_for_graph(lambda graph: any(one.name == "tester" for one in graph.nodes))
            one.process.send_signal(number)
            assert await one.end() == -number, one.lines
        assert one.lines == ["up"]


@pytest.mark.usefixtures("daemon")
@pytest.mark.parametrize("text", [INSIDE, BEFORE], ids=["init inside", "init before"])
@on_one_loop
async def test_ctrl_c_while_a_task_runs(tmp_path: Path, text: str) -> None:
    """The signal interrupts no task, so asyncio has no exception of one to report."""
    script = tmp_path / "program.py"
    text = text.replace("import asyncio", "import asyncio, signal")
    once = "(timer.cancel(), signal.raise_signal(signal.SIGINT))"  # a second one would not wait for the tasks
    script.write_text(text.format(wait=f"timer = node.create_timer(0.01, lambda: {once})"))
    async with running(tmp_path, "-m", "bus_cli", "run", script) as one:
        assert await one.end() == -signal.SIGINT, one.lines
    assert one.lines == ["up"]


@on_one_loop
async def test_the_second_ctrl_c_does_not_wait(tmp_path: Path) -> None:
    """Nothing is seen of the first one, because the task does not give way to the event loop."""
    script = tmp_path / "program.py"
    script.write_text(
        "import asyncio, rclpy, signal\n"
        "async def main():\n"
        "    signal.raise_signal(signal.SIGINT)\n"
        "    print('once', flush=True)\n"
        "    signal.raise_signal(signal.SIGINT)\n"
        "    print('twice')\n"
        "rclpy.init()\n"
        "asyncio.run(main())\n"
    )
    async with running(tmp_path, "-m", "bus_cli", "run", script) as one:
        assert await one.end() == -signal.SIGINT, one.lines
    assert one.lines == ["once"]


@pytest.fixture
def quick_switches() -> Iterator[None]:
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


@pytest.mark.usefixtures("route", "context")
class TestEnds:
    async def test_a_context_that_has_ended_before(self) -> None:
        node = AsyncNode("tester")
        rclpy.shutdown()
        with pytest.raises(ExternalShutdownException):
            await node.run()
        with pytest.raises(RuntimeError, match="is destroyed"):
            await node.run()

    async def test_a_context_that_ends_while_the_node_opens(self) -> None:
        task = asyncio.create_task(AsyncNode("tester").run())
        await asyncio.sleep(0)
        rclpy.shutdown()
        with pytest.raises(ExternalShutdownException):
            await task
        assert not task.cancelling()

    async def test_cancellation_while_it_closes(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """No task is left behind."""
        closing = asyncio.Event()
        close = NativeNode.close

        async def slow_close(native: NativeNode) -> None:
            closing.set()
            try:
                await asyncio.sleep(60)
            finally:
                await close(native)

        monkeypatch.setattr(NativeNode, "close", slow_close)
        node = AsyncNode("tester")
        publisher = node.create_publisher(String, "chatter", 10)
        before = asyncio.all_tasks()
        task = asyncio.create_task(node.run())
        work = vars(node)["_AsyncNode__work"]
        await until(lambda: publisher.state.name == "OPEN" and not work._opening)
        task.cancel()
        await closing.wait()
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert {one for one in asyncio.all_tasks() if "AsyncNode" in repr(one)} <= before

    async def test_a_service_that_its_callback_destroys(self, node: AsyncNode) -> None:
        def callback(request: Any, response: Any) -> Any:
            service.destroy()
            return response

        async def callback_async(request: Any, response: Any) -> Any:
            return callback(request, response)

        for one in (callback, callback_async):
            service = node.create_service(SetBool, "leaving", one)
            client = node.create_client(SetBool, "leaving")
            await client.wait_for_service()
            call = asyncio.create_task(client.call(SetBool.Request()))
            await until(lambda: not client.service_is_ready())  # noqa: B023
            assert not call.done()
            call.cancel()

    @pytest.mark.usefixtures("quick_switches")
    async def test_another_thread_publishes(self, node: AsyncNode) -> None:
        """No message is lost while subscriptions to the topic are made, for which messages are held."""
        most, got = 5_000, []
        publisher = node.create_publisher(Int32, "numbers", QoSProfile(depth=most))
        node.create_subscription(Int32, "numbers", lambda m: got.append(m.data), QoSProfile(depth=most))
        await until(lambda: publisher.get_subscription_count() == 1)

        def publish() -> None:
            for number in range(most):
                publisher.publish(Int32(data=number))

        thread = threading.Thread(target=publish)
        thread.start()
        while thread.is_alive():
            other = node.create_subscription(Int32, "numbers", None, 1)
            await until(lambda: other.state.name == "OPEN")  # noqa: B023
            other.destroy()
        await until(lambda: len(got) == most)
        assert sorted(got) == list(range(most))


@pytest.mark.usefixtures("context")
def test_destroyed_while_the_loop_stands_still() -> None:
    """A fixture of a program's tests does so."""
    with asyncio.Runner() as runner:
        node = AsyncNode("tester")
        runner.run(node.__aenter__())
        publisher = node.create_publisher(String, "chatter", 10)
        subscription = node.create_subscription(String, "chatter", print, 10)
        runner.run(until(lambda: publisher.get_subscription_count() == 1))
        subscription.destroy()
        publisher.destroy()
        runner.run(until(lambda: node.count_publishers("chatter") == 0))
        runner.run(node.__aexit__(None, None, None))


@pytest.mark.usefixtures("context")
def test_a_context_that_ends_in_another_thread() -> None:
    """Ctrl-C in the main thread ends the node of another thread."""
    runs, raised = threading.Event(), []

    async def main() -> None:
        async with AsyncNode("tester"):
            runs.set()
            await asyncio.sleep(60)

    def run() -> None:
        try:
            asyncio.run(main())
        except ExternalShutdownException as error:
            raised.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    assert runs.wait(60)
    rclpy.signals.install_signal_handlers()
    try:
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    finally:
        rclpy.signals.uninstall_signal_handlers()
    thread.join(60)
    assert raised
