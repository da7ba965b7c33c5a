"""Timed actions of the library: deadlines, signs of life, acknowledgements, reports.

The loop's time jumps (`tests/jumping_loop.py`), so a test can tell a time from twice that time on any
machine.
"""

import asyncio
import re
from typing import Any

import pytest

import bus
from accounts_world import TOPIC, Numbered, World
from bus.events import DeadlineMissed, LivelinessChanged, PublisherEvents, SubscriptionEvents
from bus.qos import QoSProfile
from jumping_loop import JumpingLoop
from semantics import KEEP_ALL
from two_processes import Play, nodes, two

__all__ = ["two"]


def test_a_deadline_is_noticed_at_its_end_on_both_sides(two: Play) -> None:
    async def story(world: World) -> None:
        talker, listener = nodes(world)
        missed: dict[str, list[DeadlineMissed]] = {"publisher": [], "subscription": []}
        qos = QoSProfile(deadline=1000)
        subscription = await listener.create_subscription(
            Numbered, TOPIC, qos, events=SubscriptionEvents(deadline_missed=missed["subscription"].append)
        )
        publisher = await talker.create_publisher(
            Numbered, TOPIC, qos, events=PublisherEvents(deadline_missed=missed["publisher"].append)
        )
        await asyncio.sleep(2500)  # the first message starts the watch
        for _ in range(3):
            publisher.publish(Numbered())
            await subscription.receive()
            await asyncio.sleep(900)
        assert missed == {"publisher": [], "subscription": []}
        await asyncio.sleep(200)
        assert missed == {"publisher": [DeadlineMissed(1, 1)], "subscription": [DeadlineMissed(1, 1)]}
        await asyncio.sleep(1000)
        assert missed == {who: [DeadlineMissed(1, 1), DeadlineMissed(2, 1)] for who in missed}

    two(story)


def test_a_publisher_that_is_held_back_hears_soon_of_the_last_one_that_was_taken(two: Play) -> None:
    """The subscription does not acknowledge each few messages at once, but a moment later."""

    async def story(world: World) -> None:
        talker, listener = nodes(world)
        subscription = await listener.create_subscription(Numbered, TOPIC, KEEP_ALL)
        publisher = await talker.create_publisher(Numbered, TOPIC, KEEP_ALL)
        while publisher.publish(Numbered()):
            pass
        assert await subscription.receive()
        await asyncio.sleep(1)
        assert publisher.publish(Numbered())

    two(story)


def test_one_that_says_nothing_keeps_its_place(two: Play) -> None:
    """The library sends signs of life by itself, often enough for a hundred leases of busd."""

    async def story(world: World) -> None:
        talker, listener = nodes(world)
        matched = list[Any]()
        events = SubscriptionEvents(matched=matched.append)
        await listener.create_subscription(Numbered, TOPIC, 10, events=events)
        await talker.create_publisher(Numbered, TOPIC, 10)
        await asyncio.sleep(1000)
        assert [one.current_count for one in matched] == [1]

    two(story)


def test_automatic_liveliness_is_kept_up_however_short_its_lease(two: Play) -> None:
    async def story(world: World) -> None:
        talker, listener = nodes(world)
        told = list[LivelinessChanged]()
        events = SubscriptionEvents(liveliness_changed=told.append)
        qos = QoSProfile(liveliness_lease_duration=0.5)
        await listener.create_subscription(Numbered, TOPIC, qos, events=events)
        lively = await talker.create_publisher(Numbered, TOPIC, qos)
        await asyncio.sleep(100)
        assert told == [LivelinessChanged(1, 0, 1, 0)]
        await lively.close()
        await asyncio.sleep(1)
        assert told[1:] == [LivelinessChanged(0, 0, -1, 0)]

    two(story)


@pytest.mark.parametrize("sign", ["publish", "assert_liveliness"])
def test_manual_liveliness_lasts_for_its_lease(two: Play, sign: str) -> None:
    async def story(world: World) -> None:
        talker, listener = nodes(world)
        told, lost = list[LivelinessChanged](), list[Any]()
        events = SubscriptionEvents(liveliness_changed=told.append)
        qos = QoSProfile(liveliness="manual_by_topic", liveliness_lease_duration=1000)
        await listener.create_subscription(Numbered, TOPIC, qos, lambda _: None, events=events)
        publisher = await talker.create_publisher(
            Numbered, TOPIC, qos, events=PublisherEvents(liveliness_lost=lost.append)
        )
        await asyncio.sleep(1900)
        assert (told, lost) == ([], []), "the first sign starts the lease"
        for _ in range(3):
            publisher.publish(Numbered()) if sign == "publish" else publisher.assert_liveliness()
            await asyncio.sleep(900)
        assert (told, lost) == ([LivelinessChanged(1, 0, 1, 0)], [])
        await asyncio.sleep(200)
        assert (told[1:], len(lost)) == ([LivelinessChanged(0, 1, -1, 1)], 1)

    two(story)


def test_a_longer_lease_of_a_subscription_counts_from_the_last_sign(two: Play) -> None:
    async def story(world: World) -> None:
        talker, listener = nodes(world)
        told, lost = list[LivelinessChanged](), list[Any]()
        events = SubscriptionEvents(liveliness_changed=told.append)
        await listener.create_subscription(
            Numbered, TOPIC, QoSProfile(liveliness_lease_duration=3000), lambda _: None, events=events
        )
        qos = QoSProfile(liveliness="manual_by_topic", liveliness_lease_duration=1000)
        publisher = await talker.create_publisher(
            Numbered, TOPIC, qos, events=PublisherEvents(liveliness_lost=lost.append)
        )
        for _ in range(2):
            publisher.assert_liveliness()
            await asyncio.sleep(2900)
        assert (told, len(lost)) == ([LivelinessChanged(1, 0, 1, 0)], 2)
        await asyncio.sleep(200)
        assert (told[1:], len(lost)) == ([LivelinessChanged(0, 1, -1, 1)], 2)
        publisher.assert_liveliness()
        await asyncio.sleep(1500)
        await publisher.close()
        await asyncio.sleep(3000)
        assert told[2:] == [LivelinessChanged(1, 0, 1, -1), LivelinessChanged(0, 0, -1, 0)]

    two(story)


async def counted(listener: bus.Node) -> tuple[int, int, int]:
    """Figures in the graph a second later: published, delivered, queued."""
    await asyncio.sleep(1)
    graph = await listener.graph(statistics=True)
    (sent,), (got,) = graph.publishers_of(TOPIC), graph.subscriptions_of(TOPIC)
    assert sent.statistics is not None and got.statistics is not None
    return sent.statistics.samples, got.statistics.samples, got.statistics.queued


def test_the_graph_hears_of_what_was_counted_within_a_second(two: Play) -> None:
    """This includes messages taken long after their arrival, and messages counted after a report."""

    async def story(world: World) -> None:
        talker, listener = nodes(world)
        subscription = await listener.create_subscription(Numbered, TOPIC, 10)
        publisher = await talker.create_publisher(Numbered, TOPIC, 10)
        for number in range(1, 4):
            publisher.publish(Numbered())
            assert await counted(listener) == (number, number - 1, 1)
            assert subscription.take()
            assert await counted(listener) == (number, number, 0)

    two(story)


def test_the_graph_hears_of_what_is_taken_as_soon_as_it_is_there(two: Play) -> None:
    """This is true even if the event loop has not noticed the message yet."""

    async def story(world: World) -> None:
        talker, listener = nodes(world)
        subscription = await listener.create_subscription(Numbered, TOPIC, 10)
        publisher = await talker.create_publisher(Numbered, TOPIC, 10)
        for number in range(1, 4):
            publisher.publish(Numbered())
            await subscription.receive()
            assert await counted(listener) == (number, number, 0)

    two(story)


def stand_still(seconds: float) -> None:
    """Block the loop, like time.sleep."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, JumpingLoop)
    loop.jumped_s += seconds


class TestStandstill:
    """If a program's own event loop stood still, the program says so and does not blame busd."""

    SAID = "this program's event loop stood still for "

    def test_for_how_long(self, two: Play, caplog: pytest.LogCaptureFixture) -> None:
        """The text has the exact time if the loop ran just before. Otherwise it has a range between two signs
        of life.
        """

        async def story(world: World) -> None:
            node = nodes(world)[1]
            await asyncio.sleep(1000)
            assert self.SAID not in caplog.text
            exactly = self.SAID + "13 s: what waited for it has gone on"
            for _ in range(5):  # on a busy machine, a sign of life may be due between the two
                caplog.clear()
                await node.graph()
                stand_still(13)
                await node.graph()
                await asyncio.sleep(1000)
                if exactly in caplog.text:
                    break
            assert exactly in caplog.text
            assert caplog.text.count(self.SAID) == 2, "each of the two that are in this loop, once"
            caplog.clear()
            await asyncio.sleep(1)
            stand_still(13)
            await asyncio.sleep(1000)
            assert re.search(self.SAID + r"(9|1\d) to 1[3-6] s: ", caplog.text)
            caplog.clear()
            stand_still(6)
            await asyncio.sleep(1000)
            assert self.SAID not in caplog.text, "less than the lease"

        two(story, lease_s=10)

    def test_two_times_that_look_alike_are_one(self, two: Play, caplog: pytest.LogCaptureFixture) -> None:
        async def story(world: World) -> None:
            nodes(world)
            for _ in range(20):
                await asyncio.sleep(7.03)
                stand_still(2.3)
            await asyncio.sleep(10)
            assert self.SAID + "2 s: " in caplog.text
            assert not re.search(r"for (\d+) to \1 s", caplog.text)

        two(story, lease_s=0.6)

    def test_a_question_that_has_not_left_yet(self, two: Play) -> None:
        """During the standstill, neither busd nor this program could send anything."""

        async def story(world: World) -> None:
            node = nodes(world)[1]
            asking = asyncio.ensure_future(node.graph())
            await asyncio.sleep(0)
            stand_still(60)
            assert len((await asking).nodes) == 2

        two(story)
