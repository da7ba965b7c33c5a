"""Replays in a test: bags of any messages, and subscriptions to them."""

import asyncio
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import pytest

pytest.importorskip("mcap")  # for all modules that import this

import bus
from bus.qos import QoSProfile
from bus.schema import MessageSchema
from bus.srv import Service
from bus.types.classes import service_class
from bus_bag.metadata import TopicMetadata
from bus_bag.play.options import PlayOptions
from bus_bag.play.program import NAME, run
from bus_bag.play.selection import Selection
from bus_bag.schemas import SCHEMA, schema_to_text
from bus_bag.storage import BagWriter
from bus_ros.cdr import codec_of
from semantics import until

START = 1_795_342_862_882_115_714
MS = 1_000_000
LATCHED = QoSProfile(1, durability="transient_local")


class Sample(NamedTuple):
    """A message of a bag: `at_ms` after its beginning."""

    topic: str
    at_ms: float
    message: Any
    published_ms: float | None = None
    """The time of publication, if it differs from the time of reception."""


def write_bag(
    folder: Path,
    *files: Sequence[Sample],
    qos: Mapping[str, Sequence[QoSProfile]] = {},
    with_schema: bool = False,
) -> Path:
    """Write a bag; equal messages of a topic with one time of publication have one number."""
    writer = BagWriter(folder)
    channels: dict[str, int] = {}
    numbers: dict[str, list[tuple[float, Any]]] = {}
    for number, samples in enumerate(files):
        if number:
            writer.split()
        for sample in samples:
            schema = MessageSchema.of(type(sample.message))
            codec = codec_of(schema)
            if sample.topic not in channels:
                profiles = tuple(qos.get(sample.topic, (QoSProfile(),)))
                topic = TopicMetadata(sample.topic, codec.type_name, "cdr", profiles, codec.type_hash)
                extra = {SCHEMA: schema_to_text(schema)} if with_schema else {}
                channels[sample.topic] = writer.add_topic(topic, codec.definition, extra)
            sent_ms = sample.at_ms if sample.published_ms is None else sample.published_ms
            known = numbers.setdefault(sample.topic, [])
            if (sent_ms, sample.message) not in known:
                known.append((sent_ms, sample.message))
            sequence = known.index((sent_ms, sample.message)) + 1
            times = START + round(sample.at_ms * MS), START + round(sent_ms * MS)
            parts = codec.encode(_encoded(sample.message))
            writer.write(channels[sample.topic], *times, sequence, parts)
    writer.close()
    return folder


def _encoded(message: Any) -> bytes:
    from bus.types.support import type_support

    return type_support(type(message)).encode(message)


class Heard(NamedTuple):
    """A message that a subscription received."""

    topic: str
    message: Any
    source_ms: float
    """The time of publication in the bag, after its beginning."""


class Audience:
    """Subscriptions on a node; `heard` has the received messages, in order."""

    def __init__(self, node: bus.Node) -> None:
        self.node = node
        self.heard: list[Heard] = []

    async def listen(self, message_type: Any, *topics: str, qos: Any = 1000) -> None:
        for topic in topics:
            await self.node.create_subscription(message_type, topic, qos, self._hear(topic))

    def _hear(self, topic: str) -> Any:
        def hear(message: Any, info: bus.MessageInfo) -> None:
            source_ns = info.source_timestamp
            self.heard.append(Heard(topic, message, (source_ns - START) / MS))

        return hear

    def texts(self, *topics: str) -> list[Any]:
        """The contents of messages received on these topics, or on all."""
        return [one.message.data for one in self.heard if not topics or one.topic in topics]

    async def has_heard(self, count: int) -> None:
        await until(lambda: len(self.heard) >= count)


def options(**given: Any) -> PlayOptions:
    """Options of the player; `topics`, `regex` and the like make the selection."""
    choice = {name: given.pop(name) for name in list(given) if name in _CHOICE}
    return PlayOptions(selection=Selection(**choice), has_keys=False, **given)


_CHOICE = {"topics", "services", "regex", "exclude_topics", "exclude_services", "exclude_regex"}


class Replay:
    """A running player, and its services."""

    def __init__(self, node: bus.Node, task: asyncio.Task[None]) -> None:
        self.task = task
        self._node = node
        self._clients: dict[str, Any] = {}

    async def call(self, name: str, service: str, **fields: Any) -> Any:
        """Call the player's service `~/name`."""
        cls: type[Service] = service_class(f"rosbag2_interfaces/srv/{service}")
        if name not in self._clients:
            self._clients[name] = await self._node.create_client(cls, f"/{NAME}/{name}")
            await self._clients[name].wait_for_service()
        return await self._clients[name].call(cls.Request(**fields))


@asynccontextmanager
async def replay(
    node: bus.Node, *bags: Path, burst: int | None = None, **given: Any
) -> AsyncIterator[Replay]:
    """Play in a task; if it still runs at the end of the block, it is cancelled."""
    task = asyncio.create_task(run(bags, options(**given), burst=burst))
    try:
        yield Replay(node, task)
    finally:
        if not task.done():
            task.cancel()
        with suppress(asyncio.CancelledError):
            await task
