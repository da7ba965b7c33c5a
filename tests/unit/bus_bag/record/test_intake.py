"""Taking messages from subscriptions: when, in which turns, and at what cost."""

import asyncio
from pathlib import Path
from typing import Any

import pytest

from bus.msg.std_msgs import String
from bus.schema import MessageSchema
from bus.subscription import MessageInfo, SubscriptionStatistics
from bus.types.support import type_support
from bus_bag.record.choice import Found, Wanted
from bus_bag.record.clock import RecordingClock
from bus_bag.record.intake import Intake
from bus_bag.record.options import RecordOptions
from bus_bag.record.pipeline import Pipeline
from bus_bag.record.state import RecordingEvent, RecordingLife
from bus_bag.record.topic import RecordedTopic
from stepcount import StepCounter, counts_bytecodes

SCHEMA = MessageSchema.of(String)
SAMPLE = (type_support(String).encode(String(data="x" * 64)), MessageInfo(1, 1, 1, 1, b"gid"))


class Subscription:
    """Has as many messages as the test sets."""

    def __init__(self) -> None:
        self.waiting = self.delivered = 0

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
            publishers=1,
            expected=self.delivered + self.waiting,
        )


class World:
    """An intake with one topic."""

    def __init__(self, folder: Path, **options: Any) -> None:
        self.pipeline = Pipeline(
            RecordOptions(folder=folder, wanted=Wanted(), **options),
            now_ns=lambda: 1,
            on_progress=lambda: None,
            on_split=lambda closed, opened: None,
            on_reject=lambda topic, error: None,
        )
        self.life = RecordingLife()
        node: Any = None
        self.intake = Intake(
            self.pipeline, RecordingClock(node, is_simulated=False), self.life, is_paused=False
        )
        self.topic = RecordedTopic(Found("/topic", SCHEMA.type_name, SCHEMA.type_hash), SCHEMA)
        subscription: Any = Subscription()
        self.subscription = self.topic.subscription = subscription
        self.pipeline.add(self.topic)

    async def arrive(self, count: int) -> None:
        """`count` messages arrive at once. Returns when they are written."""
        self.subscription.waiting += count
        self.intake.take(self.topic)
        while self.subscription.waiting or self.pipeline.messages < self.subscription.delivered:  # noqa: ASYNC110
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


@counts_bytecodes
@pytest.mark.parametrize(("count", "calls"), [(1, 11), (100, 112)])
async def test_what_a_message_costs(tmp_path: Path, count: int, calls: int) -> None:
    """The bound counts calls of Python, without those of the subscription and the event loop. Each of many
    messages is encoded.
    """
    world = World(tmp_path / "walk")
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
    assert min(found) - 2 <= calls  # `take_many` and `stop` belong to the test
    world.pipeline.close()
