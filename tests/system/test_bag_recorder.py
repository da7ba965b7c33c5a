"""The recorder's node in the test's process: discovery of topics, reports, and the end."""

import asyncio
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

import bus
from bus.msg.std_msgs import Int32, String
from bus_bag.info import find_losses
from bus_bag.losses import TopicLosses
from bus_bag.record import recorder as module
from bus_bag.record.choice import Wanted
from bus_bag.record.options import RecordOptions
from bus_bag.record.recorder import Recorder
from bus_bag.record.state import RecordingState
from bus_bag.storage import open_bag
from recording import Bag
from semantics import KEEP_ALL, send_all, until
from semantics import node as node

ALL = Wanted(all_topics=True)


@asynccontextmanager
async def recording(bag: Bag, **options: Any) -> AsyncIterator[Recorder]:
    """A running recorder; it ends at the end of the block."""
    async with bus.Node("rosbag2_recorder", arguments=[], rosout=False) as node:
        recorder = Recorder(node, RecordOptions(folder=bag.folder, **{"wanted": ALL, **options}))
        running = asyncio.create_task(recorder.run())
        await until(lambda: recorder.state is RecordingState.RECORDING)
        try:
            yield recorder
        finally:
            recorder.stop()
            await running


@pytest.fixture
def bag(tmp_path: Path) -> Bag:
    return Bag(tmp_path / "walk")


async def test_many_topics_are_found_together(node: bus.Node, bag: Bag) -> None:
    publishers = [await node.create_publisher(Int32, f"topic_{number}", 10) for number in range(100)]
    async with recording(bag) as recorder:
        for publisher in publishers:
            publisher.publish(Int32(data=1))
        later = await node.create_publisher(Int32, "later", 10)
        await later.wait_for_subscriptions()
        later.publish(Int32(data=2))
        await until(lambda: recorder.pipeline.losses()["/later"].written)
    written = {topic: losses.written for topic, losses in bag.losses().items()}
    assert {topic: count for topic, count in written.items() if "topic_" in topic or topic == "/later"} == {
        **{f"/topic_{number}": 1 for number in range(100)},
        "/later": 1,
    }


async def test_the_accounts_are_written_while_it_records(
    node: bus.Node, bag: Bag, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_PERIOD_S", 0.01)
    monkeypatch.setattr(module, "_LOSSES_S", 0.01)
    publisher = await node.create_publisher(Int32, "topic", 10)
    publisher.publish(Int32())

    def losses() -> dict[str, TopicLosses]:
        with open_bag(bag.folder) as reader:
            return find_losses(reader)

    async with recording(bag):
        publisher.publish(Int32(data=1))
        await until(lambda: losses().get("/topic") == TopicLosses(1, 1))


async def test_a_topic_that_becomes_another(
    node: bus.Node, bag: Bag, capfd: pytest.CaptureFixture[str]
) -> None:
    first = await node.create_publisher(Int32, "topic", 10)
    async with recording(bag):
        first.publish(Int32(data=1))
        await first.close()
        second = await node.create_publisher(String, "topic", 10)
        said: list[str] = []
        await until(lambda: said.append(capfd.readouterr().err) or "of another type" in "".join(said))
        second.publish(String(data="unheard"))
    assert (
        "Topic '/topic' is recorded as std_msgs/msg/Int32; messages of another type on it are not recorded"
    ) in "".join(said)
    assert bag.losses()["/topic"] == TopicLosses(1, 1)


async def test_profiles_may_be_chosen(node: bus.Node, bag: Bag, capfd: pytest.CaptureFixture[str]) -> None:
    await node.create_publisher(Int32, "topic", 10)
    async with recording(bag, overrides={"/topic": bus.QoSProfile(7)}):
        graph = await node.graph()
        assert [one.qos for one in graph.subscriptions_of("/topic")] == [bus.QoSProfile(7)]
    assert "Overriding subscription profile for /topic\n" in capfd.readouterr().err


async def test_all_that_was_named_is_there(
    node: bus.Node, bag: Bag, capfd: pytest.CaptureFixture[str]
) -> None:
    await node.create_publisher(Int32, "topic", 10)
    async with recording(bag, wanted=Wanted(topics=frozenset(["/topic"]))):
        pass
    assert "All requested topics are subscribed. Stopping discovery...\n" in capfd.readouterr().err


async def test_without_discovery_only_what_is_there(node: bus.Node, bag: Bag) -> None:
    await node.create_publisher(Int32, "topic", 10)
    async with recording(bag, has_discovery=False) as recorder:
        await node.create_publisher(Int32, "later", 10)
        await node.wait_for_graph(lambda graph: "/later" in graph.topics())
        assert "/topic" in recorder.pipeline.losses()
        assert "/later" not in recorder.pipeline.losses()


async def test_a_busd_that_is_silent_for_long_ends_nothing(
    node: bus.Node, bag: Bag, monkeypatch: pytest.MonkeyPatch
) -> None:
    publisher = await node.create_publisher(Int32, "topic", 10)
    async with recording(bag, wanted=Wanted(topics=frozenset(["/topic", "/later"]))) as recorder:
        answers = {name: getattr(recorder._node, name) for name in ("get_schema", "create_subscription")}
        silences = {name: iter(range(2)) for name in answers}

        async def ask(name: str, *words: Any, **more: Any) -> Any:
            for _ in silences[name]:
                raise TimeoutError("busd does not answer")
            return await answers[name](*words, **more)

        for name in answers:
            monkeypatch.setattr(recorder._node, name, partial(ask, name))
        later = await node.create_publisher(String, "later", 10)
        await later.wait_for_subscriptions()
        publisher.publish(Int32(data=1))
        later.publish(String(data="2"))
        await until(lambda: all(one.written for one in recorder.pipeline.losses().values()))
        assert not any(map(list, silences.values()))
    assert bag.losses() == {"/topic": TopicLosses(1, 1), "/later": TopicLosses(1, 1)}


async def test_what_fails_in_the_middle_ends_it_with_a_whole_bag(
    node: bus.Node, bag: Bag, monkeypatch: pytest.MonkeyPatch
) -> None:
    publisher = await node.create_publisher(Int32, "topic", 10)
    with pytest.raises(ZeroDivisionError):
        async with recording(bag) as recorder:
            publisher.publish(Int32(data=1))
            await until(lambda: recorder.pipeline.losses()["/topic"].written)

            def fail(graph: bus.Graph) -> None:
                raise ZeroDivisionError

            monkeypatch.setattr(recorder._discovery._choice, "choose", fail)
            await node.create_publisher(Int32, "later", 10)
            await until(lambda: recorder._error)
    assert bag.losses()["/topic"] == TopicLosses(1, 1)
    assert bag.metadata.message_count >= 1


async def test_ended_before_the_simulation_begins(node: bus.Node, bag: Bag) -> None:
    arguments = ["--ros-args", "-p", "use_sim_time:=true"]
    async with bus.Node("rosbag2_recorder", arguments=arguments, rosout=False) as recording_node:
        recorder = Recorder(recording_node, RecordOptions(folder=bag.folder, wanted=ALL, is_simulated=True))
        running = asyncio.create_task(recorder.run())
        await node.wait_for_graph(lambda graph: bool(graph.subscriptions_of("/clock")))
        recorder.stop()
        assert await running == {}
    assert bag.metadata.message_count == 0


async def test_cancelled(node: bus.Node, bag: Bag) -> None:
    publisher = await node.create_publisher(Int32, "topic", 10)
    async with bus.Node("rosbag2_recorder", arguments=[], rosout=False) as recording_node:
        recorder = Recorder(recording_node, RecordOptions(folder=bag.folder, wanted=ALL))
        running = asyncio.create_task(recorder.run())
        await publisher.wait_for_subscriptions()
        running.cancel()
        with pytest.raises(asyncio.CancelledError):
            await running
    assert bag.metadata.message_count == 0


@pytest.mark.parametrize("max_cache_size", [1_000_000, 100_000], ids=["roomy", "less_than_a_batch"])
async def test_a_lossless_topic_waits_for_the_disk(node: bus.Node, bag: Bag, max_cache_size: int) -> None:
    publisher = await node.create_publisher(String, "topic", KEEP_ALL)
    may_write, count = threading.Event(), 3000
    options = {"overrides": {"/topic": KEEP_ALL}, "max_cache_size": max_cache_size}
    async with recording(bag, wanted=Wanted(topics=frozenset(["/topic"])), **options) as recorder:
        assert recorder.pipeline._thread is not None

        def hold_up() -> None:
            may_write.wait(30)

        recorder.pipeline._thread.run(hold_up, 9 << 20)
        sending = asyncio.create_task(send_all(publisher, [String(data="x" * 1000)] * count))
        await until(lambda: recorder.pipeline.is_crowded)
        assert recorder.pipeline.cached < 12_000_000
        may_write.set()
        await sending
        await until(lambda: recorder.pipeline.losses()["/topic"].written == count)
    assert bag.losses()["/topic"] == TopicLosses(count, count)


@pytest.mark.usefixtures("route")
async def test_messages_published_right_before_the_end(node: bus.Node, bag: Bag) -> None:
    """By socket, busd may still have them when the recorder is asked to end."""
    publisher = await node.create_publisher(Int32, "topic", 1000)
    async with recording(bag):
        await publisher.wait_for_subscriptions()
        for number in range(200):
            publisher.publish(Int32(data=number))
    assert bag.losses()["/topic"] == TopicLosses(200, 200)


async def test_the_end_does_not_wait_for_a_silent_busd(node: bus.Node, bag: Bag) -> None:
    publisher = await node.create_publisher(Int32, "topic", 10)
    async with recording(bag) as recorder:
        await publisher.wait_for_subscriptions()
        publisher.publish(Int32(data=1))
        await until(lambda: recorder.pipeline.losses()["/topic"].written)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(recorder._node, "graph", asyncio.Event().wait)
            recorder.stop()
            await until(lambda: recorder.state is RecordingState.CLOSED)
    assert bag.losses()["/topic"] == TopicLosses(1, 1)


@pytest.mark.usefixtures("daemon", "route")
async def test_a_flood_of_several_publishers(bag: Bag) -> None:
    """All messages are in the file, in the order in which they were published; each one by its own number.

    Messages that are not of the type are counted, and their neighbours are recorded.
    """
    count, wrong = 2000, 5
    sizes = (0, 1, 70, 300, 5000, 17_000)
    options = {"overrides": {"/topic": KEEP_ALL}, "wanted": Wanted(topics=frozenset(["/topic"]))}
    async with bus.Node("one") as one, bus.Node("other") as other:
        publishers = [await node.create_publisher(String, "topic", KEEP_ALL) for node in (one, other)]
        async with recording(bag, max_bag_size=3_000_000, **options) as recorder:
            for publisher in publishers:
                await publisher.wait_for_subscriptions()

            async def flood(publisher: bus.Publisher[Any]) -> None:
                for number in range(count):
                    await publisher.send(String(data=f"{number}:" + "ü" * sizes[number % 50 % len(sizes)]))
                    if number % (count // wrong) == 100:
                        while not publisher.publish_encoded(b"\x91\xa2\xff\xff"):  # noqa: ASYNC110
                            await asyncio.sleep(0.001)

            await asyncio.gather(*map(flood, publishers))
            await until(lambda: recorder.pipeline.losses()["/topic"].written == 2 * count)
    lost = {"undecodable": 2 * wrong}
    losses = bag.losses()["/topic"]
    assert (losses.expected, losses.written, losses.lost) == (2 * (count + wrong), 2 * count, lost)
    assert len(bag.files) > 1
    messages = [message for file in bag.files for *_, message in bag.messages(file)]
    times = [message.publish_time for message in messages]
    assert sorted(message.sequence for message in messages) == sorted(
        [number + 1 + (number + 299) // 400 for number in range(count)] * 2
    )
    assert all(message.log_time >= message.publish_time - 1_000_000 for message in messages)
    by_text: dict[str, list[int]] = {}
    for index, text in enumerate(bag.texts()):
        by_text.setdefault(text.partition(":")[0], []).append(index)
    assert len(by_text) == count
    assert all(len(places) == 2 for places in by_text.values())
    # Batches come one after the other; within a batch, publishers are merged.
    assert sum(before > after for before, after in pairwise(times)) < len(times) // 4
    assert bag.read_by_others() == 2 * count
