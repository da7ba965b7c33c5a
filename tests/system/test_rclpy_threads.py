"""Executors with threads under load: no message is lost, groups exclude each other, and Ctrl-C ends them."""

import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bus_ros.rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from bus_ros.rclpy.executors import MultiThreadedExecutor
from rclpy_world import Int64, World, arguments, in_thread, wait_until, world

__all__ = ["arguments", "world"]

pytestmark = pytest.mark.usefixtures("route")

COUNT = 3000
TOPICS = ("a", "b", "c", "d")


class Inside:
    """The number of calls of a group in progress, and its maximum."""

    def __init__(self) -> None:
        self.now = self.most = 0
        self._lock = threading.Lock()

    def __call__(self, function: Callable[[], object]) -> None:
        with self._lock:
            self.now += 1
            self.most = max(self.most, self.now)
        function()
        with self._lock:
            self.now -= 1


def test_a_flood_in_groups(world: World) -> None:
    """Two topics exclude each other, one only itself, and one nothing; pauses let threads sleep."""
    node, other = world.node(), world.node("other")
    alone, together = MutuallyExclusiveCallbackGroup(), MutuallyExclusiveCallbackGroup()
    groups = dict(zip(TOPICS, (together, together, alone, ReentrantCallbackGroup()), strict=True))
    inside = {group: Inside() for group in groups.values()}
    heard: dict[str, list[int]] = {topic: [] for topic in TOPICS}
    publishers = []
    for topic, group in groups.items():

        def callback(message: Any, topic: str = topic, group: Any = group) -> None:
            inside[group](lambda: heard[topic].append(message.data))

        node.create_subscription(Int64, topic, callback, COUNT, callback_group=group)
        publishers.append(other.create_publisher(Int64, topic, COUNT))

    def heard_all(number: int) -> bool:
        return all(len(numbers) > number for numbers in heard.values())

    with world.spinning(node, kind=lambda: MultiThreadedExecutor(3)):
        for number in range(COUNT):
            for publisher in publishers:
                publisher.publish(Int64(data=number))
            if number % 100 < 10:
                wait_until(lambda number=number: heard_all(number))
        wait_until(lambda: heard_all(COUNT - 1))
    *exclusive, free = TOPICS
    for topic in exclusive:
        assert heard[topic] == list(range(COUNT))
    assert sorted(heard[free]) == list(range(COUNT))
    assert inside[alone].most == inside[together].most == 1


def test_threads_are_handed_calls_and_leave_at_the_end(world: World) -> None:
    """Each call arrives when all threads sleep, and two at once get two threads."""
    node, other = world.node(), world.node("other")
    heard: list[int] = []
    both = threading.Barrier(2)

    def meet(message: Any) -> None:
        if message.data % 10 == 0:
            both.wait(timeout=10)
        heard.append(message.data)

    for topic in TOPICS[:2]:
        node.create_subscription(Int64, topic, meet, 10, callback_group=ReentrantCallbackGroup())
    publishers = [other.create_publisher(Int64, topic, 10) for topic in TOPICS[:2]]
    with world.spinning(node, kind=lambda: MultiThreadedExecutor(2)):
        for number in range(50):
            for publisher in publishers:
                publisher.publish(Int64(data=number))
            wait_until(lambda number=number: len(heard) == 2 * number + 2)
        assert sum("rclpy executor" in thread.name for thread in threading.enumerate()) <= 2
    wait_until(lambda: not any("rclpy executor" in thread.name for thread in threading.enumerate()))


def test_a_shutdown_amid_a_flood_waits_for_the_calls(world: World) -> None:
    node, other = world.node(), world.node("other")
    inside, heard = Inside(), list[int]()
    node.create_subscription(Int64, "t", lambda message: inside(lambda: heard.append(message.data)), 10)
    publisher = other.create_publisher(Int64, "t", 10)
    is_over = threading.Event()

    def publish() -> None:
        while not is_over.is_set():
            publisher.publish(Int64())

    with in_thread(publish):
        try:
            for _ in range(10):
                with world.spinning(node, kind=lambda: MultiThreadedExecutor(2)) as executor:
                    goal = len(heard) + 50
                    wait_until(lambda goal=goal: len(heard) > goal)
                    assert executor.shutdown()
                    assert inside.now == 0
                    ended_at = len(heard)
                assert len(heard) == ended_at
        finally:
            is_over.set()
    assert inside.most == 1


PROGRAM = """
import sys
import bus.rclpy_compat
import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from std_msgs.msg import Int64

rclpy.init()
node = rclpy.create_node("busy")
publisher = node.create_publisher(Int64, "t", 10)
count = 0


def pass_on(message):
    global count
    count += 1
    if count == 500:
        print("busy", flush=True)
    publisher.publish(message)


node.create_subscription(Int64, "t", pass_on, 10, callback_group=ReentrantCallbackGroup())
publisher.publish(Int64())
try:
    rclpy.spin(node, MultiThreadedExecutor(3))
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


def test_an_interrupt_amid_a_flood(daemon: object, route: str, tmp_path: Path) -> None:
    import subprocess

    script = tmp_path / "busy.py"
    script.write_text(PROGRAM)
    with subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None and process.stdout.readline() == "busy\n"
            process.send_signal(signal.SIGINT)
            said, complained = process.communicate(timeout=30)
        finally:
            process.kill()
    warned = "were published without a pause"  # on a busy machine enough of them may collect
    assert (said, [line for line in complained.splitlines() if warned not in line]) == ("interrupted\n", [])
    assert process.returncode == 0
