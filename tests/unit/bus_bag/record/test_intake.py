"""Taking messages from subscriptions: when, in which turns, and at what cost."""

import asyncio
from pathlib import Path
from typing import Any

import pytest

from bus.msg.builtin_interfaces import Time
from bus.msg.std_msgs import String
from bus.qos import QoSProfile
from bus.schema import MessageSchema
from bus.subscription import MessageInfo, Pack, SubscriptionStatistics
from bus.types.support import type_support
from bus_bag.core import Program
from bus_bag.losses import TopicLosses
from bus_bag.record.choice import Found, Wanted
from bus_bag.record.clock import RecordingClock
from bus_bag.record.intake import Intake
from bus_bag.record.options import RecordOptions
from bus_bag.record.pipeline import Pipeline
from bus_bag.record.state import RecordingEvent, RecordingLife
from bus_bag.record.topic import RecordedTopic
from packing import pack_of
from recording import Bag
from stepcount import StepCounter, counts_bytecodes

SCHEMA = MessageSchema.of(String)
SAMPLE = (type_support(String).encode(String(data="x" * 64)), MessageInfo(1, 1, 1, 1, b"gid"))

needs_core = pytest.mark.skipif(Program is None, reason="BUS_NATIVE=no")


class Subscription:
    """Has as many messages as the test sets. `most_packed` are taken in one buffer; 0: one by one."""

    def __init__(self, most_packed: int = 0) -> None:
        self.waiting = self.delivered = 0
        self.publishers = 1
        self.merges: list[bool] = []
        self._most_packed = most_packed
        self._packs: dict[int, Pack] = {}

    def take_packed(self, most_bytes: int, longest: int, *, merges: bool) -> Pack | None:
        self.merges.append(merges)
        count = min(self.waiting, self._most_packed)
        if not count:
            return None
        self.waiting -= count
        self.delivered += count
        if count not in self._packs:  # what the test itself does is not counted below
            self._packs[count] = pack_of([SAMPLE] * count)
        return self._packs[count]._replace(has_more=self.waiting > 0)

    def get_publisher_count(self) -> int:
        return self.publishers

    def take_many(self, limit: int) -> list[tuple[bytes, MessageInfo]]:
        count = min(self.waiting, limit)
        self.waiting -= count
        self.delivered += count
        return [SAMPLE] * count

    def statistics(self) -> SubscriptionStatistics:
        return SubscriptionStatistics(
            delivered=self.delivered,
            bytes=0,
            queued=self.waiting,
            dropped={},
            publishers=self.publishers,
            expected=self.delivered + self.waiting,
        )


class World:
    """An intake with one topic."""

    def __init__(
        self, folder: Path, most_packed: int = 0, *, is_simulated: bool = False, **options: Any
    ) -> None:
        self.pipeline = Pipeline(
            RecordOptions(folder=folder, wanted=Wanted(), **options),
            now_ns=lambda: 1,
            on_progress=lambda: None,
            on_split=lambda closed, opened: None,
            on_reject=lambda topic, error: None,
        )
        self.life = RecordingLife()
        node: Any = self
        self.time = Time()
        """The time of a simulation."""
        clock = RecordingClock(node, is_simulated=is_simulated)
        self.intake = Intake(self.pipeline, clock, self.life, is_paused=False)
        self.topic = RecordedTopic(Found("/topic", SCHEMA.type_name, SCHEMA.type_hash), SCHEMA)
        subscription: Any = Subscription(most_packed)
        self.subscription = self.topic.subscription = subscription
        self.pipeline.add(self.topic)

    def now(self) -> Time:
        return self.time

    async def arrive(self, count: int) -> None:
        """`count` messages arrive at once. Returns when they are written."""
        self.subscription.waiting += count
        self.intake.take(self.topic)
        while self.subscription.waiting or self.pipeline.messages < self.subscription.delivered:  # noqa: ASYNC110
            await asyncio.sleep(0)
        self.pipeline.flush()
        while not self.pipeline.is_idle:  # noqa: ASYNC110
            await asyncio.sleep(0)


async def test_a_batch_at_a_time_and_all_in_the_end(tmp_path: Path) -> None:
    world = World(tmp_path / "walk")
    world.subscription.waiting = 1000
    world.intake.take(world.topic)
    assert world.subscription.waiting == 1000 - 256  # then it is the turn of other topics
    world.intake.take_all([world.topic])
    assert world.subscription.waiting == 0
    await world.arrive(300)
    world.topic.finish()
    world.subscription.waiting = 1
    world.intake.take(world.topic)
    assert world.subscription.waiting == 1
    assert world.pipeline.close()["/topic"].written == 1300


async def test_a_lossless_topic_waits_for_room_while_it_records(tmp_path: Path) -> None:
    world = World(tmp_path / "walk", max_cache_size=50_000)
    world.topic.is_lossless = True
    world.subscription.waiting = 600
    for _ in range(3):
        world.intake.take(world.topic)
    assert world.pipeline.is_crowded and world.subscription.waiting == 600 - 2 * 256
    world.life.on(RecordingEvent.STOP)
    world.intake.take(world.topic)
    assert world.subscription.waiting == 0
    world.pipeline.close()


async def test_what_waited_for_room_is_taken_once_there_is_some(tmp_path: Path) -> None:
    world = World(tmp_path / "walk", max_cache_size=50_000)
    world.topic.is_lossless = True
    await asyncio.wait_for(world.arrive(3000), 30)
    world.topic.finish()
    assert world.pipeline.close()["/topic"].written == 3000


async def test_before_a_simulation_begins_only_the_state_is_kept(tmp_path: Path) -> None:
    world = World(tmp_path / "walk", is_simulated=True)
    world.topic.update_offers([QoSProfile(1, durability="transient_local")])
    world.pipeline.set_publishers(world.topic, {b"gid": 1})
    world.subscription.waiting = 3
    world.intake.take(world.topic)
    world.time = Time(nanosec=7)
    world.subscription.waiting = 1
    world.intake.take(world.topic)
    while world.pipeline.messages < 2:  # noqa: ASYNC110
        await asyncio.sleep(0)
    world.topic.finish()
    assert world.pipeline.close()["/topic"] == TopicLosses(2, 2)
    bag = Bag(tmp_path / "walk")
    assert [message.log_time for _, _, message in bag.messages(bag.files[0])] == [7, 7]


@needs_core
async def test_buffers_as_long_as_there_are_some(tmp_path: Path) -> None:
    world = World(tmp_path / "walk", most_packed=1000)
    world.subscription.waiting = 2500
    assert world.intake.take(world.topic) == 1000
    assert world.subscription.waiting == 1500  # then it is the turn of other topics
    await world.arrive(0)
    world.subscription.waiting = 2500
    world.intake.take_all([world.topic])
    assert world.subscription.waiting == 0
    assert world.subscription.merges == [True] * 6
    await world.arrive(0)
    world.topic.finish()
    assert world.pipeline.close()["/topic"].written == 5000


@needs_core
async def test_latched_messages_are_told_apart_by_publisher(tmp_path: Path) -> None:
    world = World(tmp_path / "walk", most_packed=1000)
    world.topic.update_offers([QoSProfile(1, durability="transient_local")] * 2)
    await world.arrive(10)
    world.subscription.publishers = 2
    await world.arrive(10)
    assert world.subscription.merges[:1] == [False]
    assert True not in world.subscription.merges
    before = len(world.subscription.merges)
    await world.arrive(10)
    assert len(world.subscription.merges) == before
    world.topic.finish()
    assert world.pipeline.close()["/topic"].written == 30


@needs_core
@pytest.mark.parametrize("is_latched", [False, True])
async def test_a_snapshot_takes_latched_messages_one_by_one(tmp_path: Path, is_latched: bool) -> None:
    world = World(tmp_path / "walk", most_packed=1000, is_snapshot=True)
    if is_latched:
        world.topic.update_offers([QoSProfile(1, durability="transient_local")])
    world.subscription.waiting = 10
    world.intake.take(world.topic)
    assert world.subscription.merges == [True] * (not is_latched)
    world.pipeline.snapshot()
    while not world.pipeline.is_idle:  # noqa: ASYNC110
        await asyncio.sleep(0)
    world.topic.finish()
    assert world.pipeline.close()["/topic"].written == 10


@counts_bytecodes
@pytest.mark.parametrize(
    ("count", "most_packed", "calls"),
    [
        (1, 0, 18),
        (100, 0, 119),
        pytest.param(1, 1000, 15, marks=needs_core),
        pytest.param(100, 1000, 15, marks=needs_core),
    ],
)
async def test_what_a_message_costs(tmp_path: Path, count: int, most_packed: int, calls: int) -> None:
    """The bound counts calls of Python, without those of the subscription and the event loop. Each of many
    messages is encoded; in a buffer, their number does not matter.
    """
    world = World(tmp_path / "walk", most_packed)
    await world.arrive(count)
    found = []
    for number in range(2, 5):  # on a busy machine, the writing thread may interfere with one round
        world.subscription.waiting = count
        counter = StepCounter()
        counter.start()
        world.intake.take(world.topic)
        world.intake._pump_now()
        counter.stop()
        assert world.pipeline.messages == number * count
        found.append(counter.calls)
    assert min(found) - 2 <= calls, min(found) - 2  # taking and `stop` belong to the test
    world.pipeline.close()
