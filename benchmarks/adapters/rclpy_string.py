"""A program of rclpy with std_msgs/String: `rclpy.spin`, and messages that are made empty and then filled.

It does not use busd directly: `bus run` runs it on busd's facade, and a Python with ROS 2 on the real rclpy.

A paced publisher keeps the same schedule as all others and sleeps between messages. With `publish_by` "timer"
it publishes in a timer's callback, as rclpy's programs do. A camera publishes images with the profile for
sensor data, so some may be lost. A flood is published in a loop, without spinning. $BENCH_THREADS is the
number of threads for callbacks.

With $BENCH_DEEP, a flood of small messages is no longer than the depth of the history, so it loses nothing.
"Keep all" of Fast DDS ends at 5,000 messages: then the publisher raises RCLError, and the subscriber waits
seconds for the repeated messages.
"""

import asyncio
import os
import signal
import sys
from array import array
from collections.abc import Callable
from queue import SimpleQueue
from threading import Thread
from time import monotonic_ns, sleep
from typing import Any

import msgspec
import rclpy
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import Image
from std_msgs.msg import String

from benchmarks.adapters.roles import LAST, Stamps, stamped
from benchmarks.work import HEAD, IMAGE, TOPIC, Work, pace, text_of
from benchmarks.worker import LIFE_S, options, tell

_MATCH_S = 0.01
_LATER_S = 0.2
"""A publisher of DDS may have its match before the subscriber has. Such a subscriber misses what is published
in between, and the publisher can't know when that is over."""
_LARGE = 1 << 16
TIMER = "timer"
"""The way (`Work.publish_by`) to publish in a timer's callback."""
_LOOK_S = 0.1


class _Done(Exception):
    """Raised in a callback to leave `spin`."""


class _Parent:
    """The process that started this one. When it closes our stdin, the context ends, and with it `spin`."""

    def __init__(self) -> None:
        self._words: SimpleQueue[str] = SimpleQueue()
        Thread(target=self._listen, daemon=True).start()

    def wait_for(self, word: str) -> None:
        """Wait for `word`; another word is an error. Raises ExternalShutdownException at the end."""
        came = self._words.get()
        if not came:
            raise ExternalShutdownException
        if came != word:
            raise ValueError(f"expected the word {word!r}, got {came!r}")

    def has_words(self) -> bool:
        """Whether there is a word from the parent that was not taken yet."""
        return not self._words.empty()

    def _listen(self) -> None:
        with os.fdopen(0, "rb", buffering=0) as words:
            for line in words:
                self._words.put(line.decode().strip())
        self._words.put("")
        rclpy.try_shutdown()


def _kind_of(work: Work) -> Any:
    return Image if work.publish_by == IMAGE else String


def _qos(work: Work) -> QoSProfile:
    if work.publish_by == IMAGE:
        return qos_profile_sensor_data
    if work.publish_by == LAST:
        return QoSProfile(depth=10)
    if not work.rate and work.size < _LARGE and os.environ.get("BENCH_DEEP"):
        return QoSProfile(depth=work.total)
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
    pub = node.create_publisher(_kind_of(work), TOPIC, _qos(work))
    while pub.get_subscription_count() < work.subscribers:
        rclpy.spin_once(node, timeout_sec=_MATCH_S)
    if not hasattr(pub, "native"):
        sleep(_LATER_S)
    tell("ready", **_route_of(pub))
    if work.rate:
        parent.wait_for("go")
        if work.publish_by == IMAGE:
            asyncio.run(pace(_camera(pub, work), msgspec.structs.replace(work, size=HEAD), bytes))
        elif work.publish_by == TIMER:
            _publish_by_timer(node, pub, work)
        else:
            asyncio.run(pace(lambda text: _publish(pub, text), work))
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


def _publish(pub: Any, text: str) -> None:
    message = String()
    message.data = text
    pub.publish(message)


def _camera(pub: Any, work: Work) -> Callable[[bytes], None]:
    """A function that publishes an image. The image begins with a stamp, and is filled by one copy."""
    body = array("B", text_of(work.size).encode())

    def publish(head: bytes) -> None:
        data = body[:]
        data[: len(head)] = array("B", head)
        message = Image()
        message.encoding = "rgb8"
        message.data = data
        pub.publish(message)

    return publish


def _flood(pub: Any, text: str, count: int) -> None:
    publish = pub.publish
    for _ in range(count):
        message = String()
        message.data = text
        while True:
            try:
                publish(message)
                break
            except RuntimeError:  # of ROS 2, if there was no room for 100 ms
                pass


def _publish_by_timer(node: Node, pub: Any, work: Work) -> None:
    left = work.total

    def publish() -> None:
        nonlocal left
        _publish(pub, stamped(work))
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
            tell("complete")
            raise _Done

    def note_image(message: Any) -> None:
        if stamps.note(bytes(message.data[:HEAD])):
            tell("complete")
            raise _Done

    def look() -> None:
        if parent.has_words():
            raise _Done

    is_image = work.publish_by == IMAGE
    node.create_subscription(_kind_of(work), TOPIC, note_image if is_image else note, _qos(work))
    if is_image:
        node.create_timer(_LOOK_S, look)  # the parent may ask before all messages have arrived
    tell("ready")
    _spin(node)
    parent.wait_for("report")
    tell("received", at_ns=stamps.last_ns, **msgspec.to_builtins(stamps.arrivals()))


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
    tell("received", end_ns=end_ns, count=count, dropped=_dropped_by(sub))


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


# Functions of busd's facade beyond rclpy.


def _route_of(pub: Any) -> dict[str, str]:
    return {"route": pub.native.matches[0].route} if hasattr(pub, "native") else {}


def _dropped_by(sub: Any) -> dict[str, int]:
    dropped: dict[str, int] = sub.native.statistics().dropped if hasattr(sub, "native") else {}
    return dropped


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
