"""Processes of bags.py: the recorder, inside a program of this module, and the programs for comparison.

The folder for bags is in the environment.
"""

import asyncio
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic_ns, thread_time_ns
from typing import Any

import msgspec

import bus
from benchmarks.adapters.bus_string import qos_of
from benchmarks.work import Work, pace
from benchmarks.worker import Parent, options, run
from bus.msg.geometry_msgs import Transform, TransformStamped, Vector3
from bus.msg.sensor_msgs import Image, Imu, JointState
from bus.msg.std_msgs import Header, String
from bus.transport.memory import keep_freed_memory
from bus.types.classes import message_class
from bus_bag.record.choice import Wanted
from bus_bag.record.options import RecordOptions
from bus_bag.record.program import settle_process
from bus_bag.record.recorder import Recorder
from bus_bag.record.topic import profile_for

FOLDER = "BENCH_BAGS"
"""In the environment: the folder for bags, in memory."""
RECORD, COUNT, WRITE = "record", "count", "write"
"""Ways to take messages (`Work.take_by`)."""
_LOOK_S = 0.002
_END_S, _LIMIT_S = 5.0, 60.0
_LOSSLESS = bus.QoSProfile(history="keep_all")


class Robot(msgspec.Struct, frozen=True, kw_only=True):
    """The work of a robot with a camera, an IMU and transforms for `seconds`.

    It has the messages a second by topic, and the size of an image in bytes.
    """

    seconds: float
    rates: dict[str, float]
    image: int
    take_by: str = RECORD

    @property
    def total(self) -> int:
        """Number of all messages, including the first message of each topic, which is sent before the
        others."""
        return sum(self.counts.values()) + len(self.rates)

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages by topic, without the first ones."""
        return {topic: int(rate * self.seconds) for topic, rate in self.rates.items()}

    def messages(self) -> dict[str, Any]:
        """The message for each topic."""
        header = Header(frame_id="base")
        transforms = [
            TransformStamped(
                header=header,
                child_frame_id=f"link_{number}",
                transform=Transform(translation=Vector3(x=0.1 * number)),
            )
            for number in range(4)
        ]
        rows = 1024
        step = self.image // rows
        image = Image(header=header, height=rows, width=step // 3, step=step, encoding="rgb8")
        image.data = bytes(range(256)) * (self.image // 256)
        tf: Any = message_class("tf2_msgs/msg/TFMessage")
        return {"image": image, "imu": Imu(header=header), "tf": tf(transforms=transforms)}


class Topics(msgspec.Struct, frozen=True):
    """The number of topics, which have several types."""

    number: int


@contextmanager
def _recording(node: bus.Node, overrides: dict[str, bus.QoSProfile]) -> Iterator[Recorder]:
    """Record all topics until the end of the block."""
    settle_process()
    folder = Path(os.environ[FOLDER]) / f"bag_{os.getpid()}"
    wanted = Wanted(all_topics=True)
    record = RecordOptions(folder=folder, wanted=wanted, overrides=overrides)
    recorder = Recorder(node, record)
    running = asyncio.create_task(recorder.run())
    try:
        yield recorder
    finally:
        running.cancel()


async def _until(is_done: Callable[[], bool], limit_s: float) -> None:
    """Poll until `is_done`, for at most `limit_s`."""
    for _ in range(int(limit_s / _LOOK_S)):
        if is_done():
            break
        await asyncio.sleep(_LOOK_S)


async def _until_written(recorder: Recorder, count: int, limit_s: float) -> int:
    """Wait until `count` messages are in the file, for at most `limit_s`; returns the time of the end."""
    pipeline = recorder.pipeline
    await _until(lambda: pipeline.messages >= count, limit_s)
    pipeline.flush()
    await _until(lambda: pipeline.is_idle, limit_s)
    return monotonic_ns()


def _lost(recorder: Recorder) -> dict[str, int]:
    """Lost messages by reason."""
    return dict(sum((Counter(one.lost) for one in recorder.pipeline.losses().values()), Counter()))


# --- at full speed


async def subscriber(parent: Parent) -> None:
    """Take a flood, as `work.take_by` says, or run beside a paced stream until the end."""
    work: Work = options(Work)
    async with bus.Node("bench_subscriber", rosout=False) as node:
        take = _record_flood if work.take_by == RECORD else _take_flood
        await take(parent, node, work)
        await asyncio.Event().wait()


async def _record_flood(parent: Parent, node: bus.Node, work: Work) -> None:
    overrides = {} if work.rate else {f"/{work.topic}": _LOSSLESS}
    with _recording(node, overrides) as recorder:
        parent.tell("ready")
        if work.rate:
            await parent.wait_for("report")
            await _until_written(recorder, work.total, _END_S)
            parent.tell("received", count=recorder.pipeline.messages, dropped=_lost(recorder))
            await asyncio.Event().wait()
        for event, count in (("warm", work.warm_up), ("received", work.total)):
            end_ns = await _until_written(recorder, count, _LIMIT_S)
            parent.tell(event, end_ns=end_ns, count=recorder.pipeline.messages, dropped=_lost(recorder))
        await asyncio.Event().wait()


async def _take_flood(parent: Parent, node: bus.Node, work: Work) -> None:
    """Count the messages, or also write each to a file."""
    left, reached = work.warm_up, asyncio.Event()
    file = None
    if work.take_by == WRITE:
        keep_freed_memory()
        file = _raw_file()

    def count(payload: bytes) -> None:
        nonlocal left
        if file is not None:
            os.write(file, payload)
        left -= 1
        if not left:
            reached.set()

    schema = bus.MessageSchema.of(String)
    sub = await node.create_subscription(schema, work.topic, qos_of(work), count, raw=True)
    parent.tell("ready")
    for event, number in (("warm", work.warm_up), ("received", work.count)):
        left = number
        await reached.wait()
        reached.clear()
        totals = sub.statistics()
        parent.tell(event, end_ns=monotonic_ns(), count=totals.delivered, dropped=totals.dropped)
    await asyncio.Event().wait()


async def publisher(parent: Parent) -> None:
    """Publish a paced stream, and measure the duration of each call."""
    work: Work = options(Work)
    took_ns: list[int] = []
    cpu_ns: list[int] = []
    async with bus.Node("bench_publisher", rosout=False) as node:
        pub = await node.create_publisher(String, work.topic, qos_of(work))
        await pub.wait_for_subscriptions(work.subscribers)

        def send(text: str) -> None:
            message = String(data=text)
            begin_ns, begin_cpu_ns = monotonic_ns(), thread_time_ns()
            pub.publish(message)
            cpu_ns.append(thread_time_ns() - begin_cpu_ns)
            took_ns.append(monotonic_ns() - begin_ns)

        parent.tell("ready", route=pub.matches[0].route)
        await parent.wait_for("go")
        await pace(send, work)
        parent.tell("sent", took_ns=took_ns[work.warm_up :], cpu_ns=cpu_ns[work.warm_up :])
        await asyncio.Event().wait()


# --- a robot


async def robot(parent: Parent) -> None:
    """Publish the robot's messages by a schedule."""
    work: Robot = options(Robot)
    messages = work.messages()
    due_s = sorted(
        (number / work.rates[topic], topic) for topic, count in work.counts.items() for number in range(count)
    )
    loop = asyncio.get_running_loop()
    async with bus.Node("robot", rosout=False) as node:
        pubs = {
            topic: await node.create_publisher(type(message), topic, 10)
            for topic, message in messages.items()
        }
        for pub in pubs.values():
            await pub.wait_for_subscriptions()
        for topic, message in messages.items():
            await pubs[topic].send(message)  # the first message of a type makes its encoder
        parent.tell("ready")
        await parent.wait_for("go")
        begin_s = loop.time()
        for at_s, topic in due_s:
            if (left_s := begin_s + at_s - loop.time()) > 0:
                await asyncio.sleep(left_s)
            await pubs[topic].send(messages[topic])
        parent.tell("sent")
        await asyncio.Event().wait()


async def robots_taker(parent: Parent) -> None:
    """Record the robot's messages, or write them to a file as they arrive."""
    work: Robot = options(Robot)
    async with bus.Node("taker", rosout=False) as node:
        if work.take_by == RECORD:
            with _recording(node, {}) as recorder:
                parent.tell("ready")
                await parent.wait_for("look")
                await _until_written(recorder, len(work.rates), _END_S)
                parent.tell("warm")
                await parent.wait_for("report")
                await _until_written(recorder, work.total, _END_S)
                parent.tell("received", count=recorder.pipeline.messages, lost=_lost(recorder))
                await asyncio.Event().wait()
        await _write_all(parent, node, work)


def _raw_file() -> int:
    """A new file for messages without records."""
    return os.open(Path(os.environ[FOLDER]) / "raw", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)


async def _write_all(parent: Parent, node: bus.Node, work: Robot) -> None:
    keep_freed_memory()
    written = 0
    file = _raw_file()

    def write(payload: bytes) -> None:
        nonlocal written
        os.write(file, payload)
        written += 1

    subs = []
    for topic, message in work.messages().items():
        schema = bus.MessageSchema.of(type(message))
        subs.append(await node.create_subscription(schema, topic, profile_for(schema), write, raw=True))
    parent.tell("ready")
    await parent.wait_for("look")
    await _until(lambda: written >= len(work.rates), _END_S)
    parent.tell("warm")
    await parent.wait_for("report")
    await _until(lambda: written >= work.total, _END_S)
    dropped = (Counter(sub.statistics().dropped) for sub in subs)
    parent.tell("received", count=written, lost=dict(sum(dropped, Counter())))
    await asyncio.Event().wait()


# --- many topics


async def topics(parent: Parent) -> None:
    """Make publishers of many topics; report when the last one has a subscription."""
    work: Topics = options(Topics)
    kinds: list[type[Any]] = [String, Image, Imu, JointState, message_class("tf2_msgs/msg/TFMessage")]
    async with bus.Node("many", rosout=False) as node:
        pubs = await asyncio.gather(
            *(
                node.create_publisher(kinds[number % len(kinds)], f"topic_{number}")
                for number in range(work.number)
            )
        )
        parent.tell("ready")
        await asyncio.gather(*(pub.wait_for_subscriptions() for pub in pubs))
        parent.tell("matched", at_ns=monotonic_ns())
        await asyncio.Event().wait()


async def topics_taker(parent: Parent) -> None:
    """Record all topics after the word `go`."""
    parent.tell("ready")
    await parent.wait_for("go")
    async with bus.Node("taker", rosout=False) as node:
        with _recording(node, {}):
            await asyncio.Event().wait()


# --- replays


class Instants(msgspec.Struct, frozen=True):
    """The number of instants, and their rate a second."""

    count: int
    rate: float


async def timer(parent: Parent) -> None:
    """Measure the lateness of the event loop's timers without other work."""
    work: Instants = options(Instants)
    loop = asyncio.get_running_loop()
    late_ns: list[int] = []
    done = asyncio.Event()
    parent.tell("ready")
    await parent.wait_for("go")
    begin_ns = monotonic_ns() + 50_000_000

    def due_ns() -> int:
        return begin_ns + int(len(late_ns) * 1e9 / work.rate)

    def ring() -> None:
        now_ns = monotonic_ns()
        while len(late_ns) < work.count and due_ns() <= now_ns:
            late_ns.append(now_ns - due_ns())
        if len(late_ns) < work.count:
            loop.call_later(max(0, due_ns() - monotonic_ns()) / 1e9, ring)
        else:
            done.set()

    ring()
    await done.wait()
    parent.tell("late", late_ns=late_ns)
    await asyncio.Event().wait()


async def listener(parent: Parent) -> None:
    """Take the messages that a player publishes."""
    async with bus.Node("listener", rosout=False) as node:
        await node.create_subscription(String, options(Work).topic, 1000, lambda message: None)
        parent.tell("ready")
        await asyncio.Event().wait()


_ROLES = {
    one.__name__: one
    for one in (subscriber, publisher, robot, robots_taker, topics, topics_taker, timer, listener)
}

if __name__ == "__main__":
    run(_ROLES[sys.argv[1]])
