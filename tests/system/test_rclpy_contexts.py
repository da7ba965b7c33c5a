"""Contexts of the facade, and functions of the module `rclpy`."""

import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.context import Context
from bus_ros.rclpy.executors import ExternalShutdownException, MultiThreadedExecutor, SingleThreadedExecutor
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.signals import SignalHandlerOptions
from conftest import WAIT_S, Daemon
from rclpy_world import String, World, arguments, in_thread, is_waiting, wait_until, world

__all__ = ["arguments", "world"]


def test_init_and_shutdown_twice(world: World) -> None:
    assert rclpy.ok()
    with pytest.raises(RuntimeError, match="must only be called once"):
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    rclpy.shutdown()
    assert not rclpy.ok()
    with pytest.raises(RuntimeError, match="must be initialized before it can be shutdown"):
        rclpy.shutdown()
    rclpy.try_shutdown()


def test_an_argument_whose_bytes_are_no_text() -> None:
    context = Context()
    with pytest.raises(UnicodeEncodeError, match="surrogates not allowed"):
        context.init(args=["Ragnar\udcc3\udcb6k"])
    assert not context.ok()


def test_again_after_shutdown(world: World) -> None:
    for _ in range(3):
        node = world.node()
        heard: list[Any] = []
        node.create_subscription(String, "t", heard.append, 10)
        node.create_publisher(String, "t", 10).publish(String(data="x"))
        while not heard:
            rclpy.spin_once(node, timeout_sec=0.1)
        node.destroy_node()
        rclpy.shutdown()
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)


def test_a_with_ends_it(world: World) -> None:
    rclpy.shutdown()
    with rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO) as made:
        assert rclpy.ok() and made.context.ok()
    assert not rclpy.ok()
    with rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO):
        rclpy.shutdown()


def test_several(world: World) -> None:
    other = Context()
    rclpy.init(args=["--ros-args", "-r", "__ns:=/other"], context=other)
    node = world.keep(Node("node", context=other))
    assert node.get_namespace() == "/other"
    assert (rclpy.ok(), rclpy.ok(context=other)) == (True, True)
    rclpy.shutdown()
    assert (rclpy.ok(), rclpy.ok(context=other)) == (False, True)
    heard: list[Any] = []
    node.create_subscription(String, "t", heard.append, 10)
    node.create_publisher(String, "t", 10).publish(String())
    executor = SingleThreadedExecutor(context=other)
    executor.add_node(node)
    world.spin_executor_until(lambda: heard, executor)
    rclpy.shutdown(context=other)
    assert not rclpy.ok(context=other)
    executor.spin()  # returns at once


def test_as_a_with(daemon: Daemon) -> None:
    with Context() as context:
        assert context.ok()
    assert not context.ok()


def test_domain_ids(world: World) -> None:
    first, second = Context(), Context()
    first.init([], domain_id=7)
    second.init([])
    assert (first.get_domain_id(), second.get_domain_id()) == (7, 0)
    with pytest.raises(RuntimeError, match="should not be lower than zero"):
        Context().init([], domain_id=-1)
    with pytest.raises(RuntimeError, match="must be initialized before it can have a domain id"):
        Context().get_domain_id()


def test_domains_are_apart(world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each domain has its own busd."""
    (tmp_path / "busd").mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.delenv("BUSD_SOCKET")
    daemons = [Daemon(tmp_path / "busd" / f"{domain}.sock") for domain in (3, 4)]
    try:
        nodes: list[Node] = []
        for domain in (3, 4, 4):
            context = Context()
            context.init([], domain_id=domain)
            nodes.append(world.node(f"n{len(nodes)}", context=context))
        assert [sorted(node.get_node_names()) for node in nodes] == [["n0"], ["n1", "n2"], ["n1", "n2"]]
        for node in nodes:
            node.destroy_node()
    finally:
        for daemon in daemons:
            daemon.stop()


def test_arguments_that_are_wrong(world: World) -> None:
    with pytest.raises(RuntimeError, match="failed to initialize rcl: Couldn't parse"):
        Context().init(["--ros-args", "-r", "no rule"])


def test_callbacks_at_the_end(world: World) -> None:
    context, told = Context(), []
    context.init([])
    context.on_shutdown(lambda: told.append("first"))
    context.on_shutdown(lambda: told.append(context.ok()))  # type: ignore[arg-type]
    with pytest.raises(TypeError):
        context.on_shutdown("no function")  # type: ignore[arg-type]
    context.shutdown()
    context.try_shutdown()
    assert told == ["first", False]


def test_shutdown_ends_a_spin_elsewhere(world: World) -> None:
    node = world.node()
    began = []
    node.create_timer(0, lambda: began.append(1))
    with suppress(ExternalShutdownException), in_thread(lambda: rclpy.spin(node)):
        wait_until(lambda: began)
        rclpy.shutdown()


def test_shutdown_while_nothing_happens(world: World) -> None:
    executor = world.executor(world.node())
    with pytest.raises(ExternalShutdownException), in_thread(executor.spin):
        wait_until(lambda: is_waiting(executor))
        rclpy.shutdown()


def test_shutdown_in_a_callback_ends_the_spin(world: World) -> None:
    node = world.node()
    node.create_timer(0, rclpy.shutdown)
    rclpy.spin(node)
    assert not rclpy.ok()


def test_shutdown_in_a_callback_of_many_threads_ends_the_spin(world: World) -> None:
    """The spinning thread waits at the time, and gets no error either."""
    executor = world.executor(node := world.node(), kind=MultiThreadedExecutor)

    def shut_down() -> None:
        timer.cancel()  # without this, another call would wait with no thread spinning, until it times out
        wait_until(lambda: is_waiting(executor))
        rclpy.shutdown()

    timer = node.create_timer(0, shut_down)
    executor.spin()
    assert not rclpy.ok()


def test_create_node(world: World) -> None:
    node = world.keep(rclpy.create_node("made", namespace="n", enable_rosout=False))
    assert node.get_fully_qualified_name() == "/n/made"
    assert node.get_topic_names_and_types() == [("/parameter_events", ["rcl_interfaces/msg/ParameterEvent"])]


@pytest.mark.parametrize(
    "beside",
    [
        "lambda: rclpy.spin(node)",
        "executor.spin",
        "node.create_rate(0.001).sleep",
        "node.create_client(service_class('std_srvs/srv/Empty'), 'nobody').wait_for_service",
    ],
    ids=["spin", "executor", "rate", "service"],
)
def test_a_program_that_ends_beside_its_daemon_threads(daemon: Daemon, beside: str) -> None:
    """They print nothing."""
    program = f"""
import threading, time
import bus_ros.rclpy as rclpy
from bus_ros.rclpy.executors import MultiThreadedExecutor
from bus_ros.rosidl import message_class, service_class
String = message_class("std_msgs/msg/String")
rclpy.init(args=[])
node, executor = rclpy.create_node("ends"), MultiThreadedExecutor(2)
executor.add_node(rclpy.create_node("other"))
heard = []
node.create_subscription(String, "t", heard.append, 10)
node.create_timer(0.001, lambda: publisher.publish(String(data="x")))
publisher = node.create_publisher(String, "t", 10)
threading.Thread(target={beside}, daemon=True).start()
time.sleep(0.05)
publisher.publish(String(data="last"))
"""
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=WAIT_S, check=False
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")
