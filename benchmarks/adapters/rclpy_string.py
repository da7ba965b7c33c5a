"""busd's facade of rclpy with std_msgs/String, as programs written for rclpy do it: with `rclpy.spin`, and
messages that are made empty and then filled.

A paced publisher publishes in a timer's callback; one that floods publishes in a loop, without spinning. With
$BENCH_THREADS, callbacks come in so many threads.
"""

import os
import signal
import sys
from queue import SimpleQueue
from threading import Thread
from time import monotonic_ns
from typing import Any

import msgspec

from benchmarks.adapters.roles import LAST, Stamps, stamped
from benchmarks.work import TOPIC, Work, text_of
from benchmarks.worker import LIFE_S, options, tell
from bus import rclpy
from bus.rclpy.executors import ExternalShutdownException, MultiThreadedExecutor, SingleThreadedExecutor
from bus.rclpy.node import Node
from bus.rclpy.qos import HistoryPolicy, QoSProfile
from bus.rosidl import message_class

String: Any = message_class("std_msgs/msg/String")
_MATCH_S = 0.01
_LARGE = 1 << 16


class _Done(Exception):
    """Raised in a callback: it comes out of `spin`."""


class _Parent:
    """The process that started us. Where it has no more words, the context ends, and with it `spin`."""

    def __init__(self) -> None:
        self._words: SimpleQueue[str] = SimpleQueue()
        Thread(target=self._listen, daemon=True).start()

    def wait_for(self, word: str) -> None:
        """Wait until it said `word`, and nothing else. Raises ExternalShutdownException at the end."""
        came = self._words.get()
        if not came:
            raise ExternalShutdownException
        if came != word:
            raise ValueError(f"expected the word {word!r}, got {came!r}")

    def _listen(self) -> None:
        with os.fdopen(0, "rb", buffering=0) as words:
            for line in words:
                self._words.put(line.decode().strip())
        self._words.put("")
        rclpy.try_shutdown()


def _qos(work: Work) -> QoSProfile:
    if work.publish_by == LAST:
        return QoSProfile(depth=10)
    if not work.rate or work.size >= _LARGE:
        return QoSProfile(history=HistoryPolicy.KEEP_ALL)
    return QoSProfile(depth=1000)


def _spin(node: Node) -> None:
    threads = os.environ.get("BENCH_THREADS")
    with MultiThreadedExecutor(int(threads)) if threads else SingleThreadedExecutor() as executor:
        try:
            rclpy.spin(node, executor)
        except _Done:
            pass


def publisher(parent: _Parent, node: Node, work: Work) -> None:
    pub = node.create_publisher(String, TOPIC, _qos(work))
    while not pub.get_subscription_count():
        rclpy.spin_once(node, timeout_sec=_MATCH_S)
    tell("ready", route=pub.native.matches[0].route)  # of which rclpy has no notion
    if work.rate:
        parent.wait_for("go")
        _publish_paced(node, pub, work)
    elif work.publish_by == LAST:
        parent.wait_for("go")
        begin_ns = monotonic_ns()
        _flood(pub, text_of(work.size), work.count - 1)
        pub.publish(String(data=LAST))
        tell("sent", begin_ns=begin_ns, end_ns=monotonic_ns())
    else:
        parent.wait_for("warm_up")
        _flood(pub, text_of(work.size), work.warm_up)
        parent.wait_for("go")
        begin_ns = monotonic_ns()
        _flood(pub, text_of(work.size), work.count)
        tell("sent", begin_ns=begin_ns)
    _spin(node)


def _flood(pub: Any, text: str, count: int) -> None:
    publish = pub.publish
    for _ in range(count):
        message = String()
        message.data = text
        publish(message)


def _publish_paced(node: Node, pub: Any, work: Work) -> None:
    left = work.total

    def publish() -> None:
        nonlocal left
        message = String()
        message.data = stamped(work)
        pub.publish(message)
        left -= 1
        if not left:
            timer.cancel()

    timer = node.create_timer(1 / work.rate, publish)


def subscriber(parent: _Parent, node: Node, work: Work) -> None:
    if work.rate:
        _take_paced(parent, node, work)
    elif work.publish_by == LAST:
        _take_to_the_last(node, work)
    else:
        _take_flood(node, work)
    _spin(node)


def _take_paced(parent: _Parent, node: Node, work: Work) -> None:
    stamps = Stamps(work)

    def note(message: Any) -> None:
        if stamps.note(message.data):
            raise _Done

    node.create_subscription(String, TOPIC, note, _qos(work))
    tell("ready")
    _spin(node)
    tell("complete")
    parent.wait_for("report")
    tell("received", **msgspec.to_builtins(stamps.arrivals()))


def _take_flood(node: Node, work: Work) -> None:
    count = 0

    def take(_: Any) -> None:
        nonlocal count
        count += 1
        if count == work.warm_up:
            tell("warm")
        elif count == work.total:
            raise _Done

    sub = node.create_subscription(String, TOPIC, take, _qos(work))
    tell("ready")
    _spin(node)
    end_ns = monotonic_ns()
    dropped = sub.native.statistics().dropped  # rclpy does not count them
    tell("received", end_ns=end_ns, count=count, dropped=dropped)


def _take_to_the_last(node: Node, work: Work) -> None:
    count = 0

    def take(message: Any) -> None:
        nonlocal count
        count += 1
        if message.data == LAST:
            raise _Done

    node.create_subscription(String, TOPIC, take, _qos(work))
    tell("ready")
    _spin(node)
    tell("received", end_ns=monotonic_ns(), count=count)


def _main() -> None:
    signal.alarm(LIFE_S)
    rclpy.init(args=[])
    role = sys.argv[1]
    node = rclpy.create_node(f"bench_{role}")
    try:
        {"publisher": publisher, "subscriber": subscriber}[role](_Parent(), node, options(Work))
    except ExternalShutdownException:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    _main()
