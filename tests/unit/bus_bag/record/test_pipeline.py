"""The way from taken messages to the file, without a bus. The disk is as slow as the test wants."""

import errno
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rosbags.highlevel import AnyReader

from bus.msg.std_msgs import String
from bus.qos import QoSProfile
from bus.schema import MessageSchema
from bus.subscription import MessageInfo, SubscriptionStatistics
from bus.types.support import type_support
from bus_bag.core import Program
from bus_bag.errors import BagError
from bus_bag.losses import TopicLosses
from bus_bag.record.batch import Packed, Samples
from bus_bag.record.choice import Found, Wanted
from bus_bag.record.options import RecordOptions
from bus_bag.record.pipeline import Pipeline
from bus_bag.record.topic import RecordedTopic
from bus_bag.storage.bag_files import BagFiles
from bus_plot.loss_timeline import Slot
from packing import pack_of
from recording import Bag

SCHEMA = MessageSchema.of(String)
encode = type_support(String).encode


class Counted:
    """A subscription with the number of delivered messages that the test sets."""

    def __init__(self) -> None:
        self.delivered = 0

    def statistics(self) -> SubscriptionStatistics:
        return SubscriptionStatistics(
            delivered=self.delivered, bytes=0, queued=0, dropped={}, publishers=1, expected=self.delivered
        )


class World:
    """A pipeline with topics. If `is_slow` is true, every job on the disk waits. If `is_packed` is true,
    messages that are put together are in one buffer. Without `uses_core`, Python encodes them."""

    def __init__(
        self,
        folder: Path,
        *,
        is_slow: bool = False,
        is_packed: bool = False,
        uses_core: bool = True,
        **options: Any,
    ) -> None:
        self._is_packed = is_packed
        self._uses_core = uses_core
        self.now_ns = 1000
        self.may_write = threading.Event()
        self.progress = threading.Semaphore(0)
        self.rejected: list[str] = []
        self.splits: list[tuple[str, str]] = []
        self.pipeline = Pipeline(
            RecordOptions(folder=folder, wanted=Wanted(), **options),
            now_ns=lambda: self.now_ns,
            on_progress=self.progress.release,
            on_split=lambda closed, opened: self.splits.append((closed.name, opened.name)),
            on_reject=lambda topic, error: self.rejected.append(topic.name),
        )
        self.bag = Bag(folder)
        self._counted: dict[str, Counted] = {}
        if is_slow:
            assert self.pipeline._thread is not None
            begun = threading.Event()

            def hold_up() -> None:
                begun.set()
                self.may_write.wait(30)

            self.pipeline._thread.run(hold_up)
            assert begun.wait(30)

    def topic(self, name: str, *, is_latched: bool = False) -> RecordedTopic:
        topic = RecordedTopic(Found(name, SCHEMA.type_name, SCHEMA.type_hash), SCHEMA)
        if not self._uses_core:
            topic.program = None
        counted: Any = Counted()
        self._counted[name] = topic.subscription = counted
        topic.update_offers([QoSProfile(1, durability="transient_local") if is_latched else QoSProfile()])
        self.pipeline.add(topic)
        self.pipeline.set_publishers(topic, {b"gid": 1} if is_latched else {})
        return topic

    def put_together(self, topic: RecordedTopic, *texts: str, at: list[int], is_paused: bool = False) -> None:
        """Put the messages as one batch, each with its time. One that begins with `?` is no message."""
        counted = self._counted[topic.name]
        batch = []
        for text, time in zip(texts, at, strict=True):
            counted.delivered += 1
            info = MessageInfo(time + 1, time, counted.delivered, counted.delivered, b"gid")
            payload = text.encode() if text.startswith("?") else encode(String(data=text))
            batch.append((payload, info))
        if self._is_packed:
            assert self.pipeline.takes_packs(topic)
            self.pipeline.put(topic, Packed(pack_of(batch)), is_paused=is_paused)
        else:
            self.pipeline.put(topic, Samples(batch), is_paused=is_paused)

    def put(self, topic: RecordedTopic, *texts: str, at: int = 0, is_paused: bool = False) -> None:
        counted = self._counted[topic.name]
        for text in texts:
            counted.delivered += 1
            info = MessageInfo(at, at, counted.delivered, counted.delivered, b"gid")
            payload = text.encode() if text.startswith("?") else encode(String(data=text))
            self.pipeline.put(topic, Samples([(payload, info)]), is_paused=is_paused)

    def finish(self) -> dict[str, TopicLosses]:
        self.may_write.set()
        while not self.pipeline.is_idle and self.pipeline.failure is None:
            if not self.pipeline.pump():
                self.pipeline.flush()
                self.progress.acquire(timeout=30)
        return self.pipeline.close()


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    yield tmp_path / "walk"


def test_where_the_disk_is_slow_the_large_ones_lose(folder: Path) -> None:
    world = World(folder, is_slow=True, max_cache_size=20_000_000)
    camera, tf = world.topic("/camera"), world.topic("/tf")
    for number in range(40):
        world.put(camera, "x" * 1_000_000)
        world.put(tf, str(number))
        world.pipeline.pump()
    assert 20_000_000 < world.pipeline.cached < 31_000_000
    losses = world.finish()
    assert losses["/tf"] == TopicLosses(40, 40)
    assert losses["/camera"].is_balanced
    assert losses["/camera"].lost["recorder_cache"] >= 10
    assert world.bag.texts("/tf") == [str(number) for number in range(40)]
    assert len(world.bag.texts("/camera")) == losses["/camera"].written
    assert world.bag.losses() == losses


@pytest.mark.parametrize("is_hurried", [False, True])
def test_no_loss_is_dated_after_the_end(folder: Path, is_hurried: bool) -> None:
    """A slow disk needs long for the waiting messages. Those without room count where the log has them."""
    world = World(folder, is_slow=True, max_cache_size=3_000_000)
    camera = world.topic("/camera")
    second = 10**9
    for number in range(1, 21):
        world.put(camera, "x" * 1_000_000, at=number * second)
        world.pipeline.pump()
        if number == 12:
            world.now_ns = number * second
            world.pipeline.note_losses()
    world.put(camera, "?", at=20 * second)
    world.now_ns = 20 * second
    world.pipeline.finish()
    world.now_ns = 26 * second
    if is_hurried:
        world.pipeline.drop()
    losses = world.finish()["/camera"]
    assert losses.is_balanced and losses.timeline.lost == losses.lost
    lost_s = {slot.at_s for slot in losses.when if "recorder_cache" in slot.lost}
    assert lost_s == set(range(min(lost_s), max(lost_s) + 1)) and len(lost_s) > 5
    assert losses.lost["recorder_cache"] == len(lost_s), "one message a second"
    assert max(slot.at_s for slot in losses.when) == 20
    if not is_hurried:
        written_s = {one[2].log_time // second for one in world.bag.messages(world.bag.files[0], "/camera")}
        assert written_s | lost_s == set(range(1, 21)) and not written_s & lost_s


@pytest.mark.parametrize("is_slow", [False, True])
def test_ended_at_once(folder: Path, is_slow: bool) -> None:
    """The pipeline drops and counts queued messages. If the disk takes nothing, the file stays as it is."""
    world = World(folder, is_slow=True)
    topic = world.topic("/topic")
    world.put(topic, *map(str, range(100)))
    world.pipeline.pump()
    world.pipeline.flush()
    world.put(topic, *map(str, range(10)))
    world.pipeline.drop()
    if is_slow:
        with pytest.raises(BagError, match=r"the disk does not answer: '.*walk' is left as it is"):
            world.pipeline.close(0.01)
        world.may_write.set()
        return
    losses = world.finish()["/topic"]
    assert losses.is_balanced
    assert (losses.expected, losses.lost["not_written"]) == (110, 110)
    assert world.bag.metadata.message_count == 0


def test_without_a_cache_all_is_written_at_once(folder: Path) -> None:
    world = World(folder, max_cache_size=0)
    topic = world.topic("/topic")
    world.put(topic, "a", "b")
    world.pipeline.pump()
    world.pipeline.flush()
    assert world.bag.texts_now() == ["a", "b"]
    world.finish()
    assert world.bag.texts() == ["a", "b"]


def test_what_is_no_message_is_counted(folder: Path) -> None:
    world = World(folder)
    plain, latched = world.topic("/topic"), world.topic("/map", is_latched=True)
    for topic in (plain, latched):
        world.put(topic, "a", "?", "b")
    losses = world.finish()
    lost = {"undecodable": 1}
    assert losses["/topic"] == losses["/map"] == TopicLosses(3, 2, 0, lost, [Slot(0, 1, lost)])
    assert world.rejected == ["/topic", "/map"]


@pytest.mark.parametrize("is_paused", [False, True])
@pytest.mark.parametrize("is_snapshot", [False, True])
def test_what_is_no_message_is_counted_once(folder: Path, is_snapshot: bool, is_paused: bool) -> None:
    """Also in further files, whose state it is not."""
    world = World(folder, is_snapshot=is_snapshot)
    latched = world.topic("/map", is_latched=True)
    world.put(latched, "a")
    world.put(latched, "?", is_paused=is_paused)
    world.pipeline.resume()
    if is_snapshot:
        world.pipeline.snapshot()
    world.pipeline.split()
    world.pipeline.split()
    losses = world.finish()
    assert (losses["/map"].expected, losses["/map"].lost) == (2, {"undecodable": 1})
    assert len(world.bag.files) == 3


def test_each_further_file_begins_with_the_state(folder: Path) -> None:
    world = World(folder, max_bag_duration=10)
    latched, plain = world.topic("/map", is_latched=True), world.topic("/topic")
    second = 10**9
    world.put(latched, "old", "hall", at=second)
    world.put(plain, "1", at=2 * second)
    world.put(plain, "2", at=11 * second)
    world.put(plain, "3", at=12 * second)
    losses = world.finish()
    first, further = world.bag.files
    assert [one[2].log_time // second for one in world.bag.messages(first, "/map")] == [1, 1]
    assert [one[2].log_time // second for one in world.bag.messages(further, "/map")] == [11]
    assert [one[2].sequence for one in world.bag.messages(further, "/map")] == [2]
    assert losses["/map"] == TopicLosses(2, 2)
    assert world.splits == [("walk_0.mcap", "walk_1.mcap")]
    assert world.bag.losses(first)["/topic"].written == 1


def test_a_file_that_begins_within_a_batch_has_what_the_batch_brought_before(folder: Path) -> None:
    world = World(folder, max_bag_duration=1)
    latched = world.topic("/map", is_latched=True)
    world.put_together(latched, "x" * 300_000, "hall", "plan", at=[0, 1, 10**9])
    world.finish()
    assert [[one[2].sequence for one in world.bag.messages(file, "/map")] for file in world.bag.files] == [
        [1, 2],
        [2, 3],
    ]


def test_the_limit_of_bytes_does_not_cover_the_state(folder: Path) -> None:
    """Otherwise a state above the limit gives each message a file of its own."""
    world = World(folder, max_cache_size=0, max_bag_size=5000)
    latched, plain = world.topic("/map", is_latched=True), world.topic("/topic")
    world.put(latched, "x" * 10_000)
    world.put(plain, *["x" * 1000] * 20)
    world.pipeline.flush()
    world.finish()
    assert 2 < len(world.bag.files) <= 5


def test_the_limit_of_bytes_does_not_cover_what_describes_the_topics(folder: Path) -> None:
    """Each file has that at its beginning and its end, and gets it after the decision to split."""
    world = World(folder, max_bag_size=20_000)
    topics = [world.topic(f"/topic_{number}") for number in range(50)]
    thread = world.pipeline._thread
    assert thread is not None
    for topic in topics:
        world.put(topic, "x")
    for _ in range(100):
        world.put(topics[0], "x" * 1000)
        world.pipeline.pump()
        while not thread.is_idle:
            world.progress.acquire(timeout=30)
    world.finish()
    assert 5 <= len(world.bag.files) <= 6
    assert min(file.stat().st_size for file in world.bag.files) > 40_000


def _story(world: World, *, has_snapshots: bool) -> dict[str, TopicLosses]:
    """Messages of many kinds: latched ones, some in a pause, some that don't have the type, several files."""
    latched, plain = world.topic("/map", is_latched=True), world.topic("/topic")
    for number in range(12):
        at = [number * 10**9] * 40
        world.put_together(plain, *(f"{number} {'ü' * one}" for one in range(40)), at=at)
        if not has_snapshots:
            world.put_together(latched, "old", f"map {number}", at=at[:2], is_paused=number in (5, 6))
        elif number % 4 == 1:
            world.pipeline.snapshot()
        if number in (3, 9):
            world.put_together(plain, "a", "?", "b", *(f"{one}" for one in range(200)), at=at[:1] * 203)
            world.put_together(plain, "?", at=at[:1])
        if number == 7:
            world.pipeline.resume()
            world.pipeline.split()
        while world.pipeline.pump():
            pass  # one turn has a time limit, and a split must be at the same message
    if has_snapshots:
        world.pipeline.snapshot()
    world.pipeline.flush()
    return world.finish()


@pytest.mark.skipif(Program is None, reason="BUS_NATIVE=no")
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"max_bag_duration": 2.5},
        {"max_bag_size": 9000, "max_bag_files": 2, "max_cache_size": 0},  # sizes without a thread are exact
        {"preset": "fastwrite"},
        {"preset": "zstd_fast", "max_bag_duration": 5},
        {"preset": "zstd_small"},
        {"is_snapshot": True, "max_cache_size": 30_000},
        {"max_cache_size": 0},
    ],
    ids=repr,
)
def test_the_same_files_from_buffers_as_one_by_one(tmp_path: Path, options: dict[str, Any]) -> None:
    """Byte for byte, with the same counters and the same refused messages."""
    found = []
    for number, (uses_core, is_packed) in enumerate([(False, False), (True, False), (True, True)]):
        folder = tmp_path / str(number) / "walk"
        folder.parent.mkdir()
        world = World(folder, is_packed=is_packed, uses_core=uses_core, **options)
        losses = _story(world, has_snapshots="is_snapshot" in options)
        files = {path.name: path.read_bytes() for path in folder.iterdir()}
        found.append((files, losses, world.rejected, world.splits, world.pipeline.written_bytes))
        assert world.bag.metadata.message_count > 100
    assert found[0] == found[1] == found[2]
    assert found[0][1]["/topic"].lost.get("undecodable") == 4 or "is_snapshot" in options


def test_what_came_in_a_pause_is_taken_up_as_state(folder: Path) -> None:
    world = World(folder)
    latched, plain = world.topic("/map", is_latched=True), world.topic("/topic")
    world.put(plain, "unheard", at=1, is_paused=True)
    world.put(latched, "old", "hall", at=2, is_paused=True)
    world.now_ns = 3
    world.pipeline.resume()
    world.put(plain, "heard", at=4)
    world.now_ns = 5
    losses = world.finish()
    assert losses == {"/map": TopicLosses(1, 1), "/topic": TopicLosses(1, 1)}
    assert world.bag.texts("/map") == ["hall"]
    assert [one[2].log_time for one in world.bag.messages(world.bag.files[0], "/map")] == [3]


def test_a_split_does_not_overtake_waiting_messages(folder: Path) -> None:
    world = World(folder, is_slow=True)
    latched, plain = world.topic("/map", is_latched=True), world.topic("/topic")
    world.put(latched, "old", at=1)
    world.pipeline.pump()
    world.put(latched, "new", at=5)
    world.now_ns = 6
    world.pipeline.split()
    world.put(plain, "later", at=7)
    world.now_ns = 8
    losses = world.finish()
    files = [
        [
            (one.log_time, one.data[8:11])
            for name in ("/map", "/topic")
            for *_, one in world.bag.messages(file, name)
        ]
        for file in world.bag.files
    ]
    assert files == [[(1, b"old"), (5, b"new")], [(6, b"new"), (7, b"lat")]]
    assert losses["/map"] == TopicLosses(2, 2)


def test_the_state_comes_before_the_memory_of_a_snapshot(folder: Path) -> None:
    world = World(folder, is_snapshot=True)
    latched, plain = world.topic("/map", is_latched=True), world.topic("/topic")
    world.put(latched, "hall", at=1)
    world.pipeline.snapshot()
    world.put(plain, "a", "b", at=5)
    world.now_ns = 7
    world.pipeline.split()
    world.pipeline.snapshot()
    world.finish()
    (state,) = world.bag.messages(world.bag.files[1], "/map")
    assert state[2].log_time == 5


def test_a_request_that_is_dropped_is_no_loss(folder: Path) -> None:
    world = World(folder, is_slow=True)
    world.put(world.topic("/topic"), "a")
    world.pipeline.split()
    world.pipeline.resume()
    world.pipeline.drop()
    assert world.finish()["/topic"].lost == {"not_written": 1}
    assert len(world.bag.files) == 1


@pytest.mark.parametrize("is_repeated", [False, True])
def test_a_further_file_has_what_came_in_the_pause(folder: Path, is_repeated: bool) -> None:
    """Also if it is the first message of its topic."""
    world = World(folder)
    latched = world.topic("/map", is_latched=True)
    if is_repeated:
        world.put(latched, "old")
    world.put(latched, "hall", is_paused=True)
    world.pipeline.pump()
    world.pipeline.split()
    world.pipeline.resume()
    losses = world.finish()
    assert [len(world.bag.messages(file, "/map")) for file in world.bag.files] == [is_repeated, 1]
    assert world.bag.texts("/map")[-1] == "hall"
    written = 1 + is_repeated
    assert losses["/map"] == TopicLosses(written, written)


def test_a_snapshot_after_a_split_has_the_state(folder: Path) -> None:
    world = World(folder, is_snapshot=True, max_cache_size=10)
    latched, plain = world.topic("/map", is_latched=True), world.topic("/topic")
    world.put(latched, "hall")
    world.put(plain, "forgotten", "kept")  # the map has left the memory
    world.pipeline.split()
    world.pipeline.snapshot()
    losses = world.finish()
    assert (world.bag.texts("/map"), world.bag.texts("/topic")) == (["hall"], ["kept"])
    assert losses["/map"] == TopicLosses(1, 1)


def test_a_snapshot_begins_with_the_state(folder: Path) -> None:
    world = World(folder, is_snapshot=True, max_cache_size=12)
    latched, plain = world.topic("/map", is_latched=True), world.topic("/topic")
    world.put(latched, "hall", at=1)
    for number in range(2, 10):
        world.put(plain, str(number), at=number)
    world.pipeline.snapshot()
    world.finish()
    (state,) = world.bag.messages(world.bag.files[0], "/map")
    first = world.bag.messages(world.bag.files[0], "/topic")[0]
    assert 2 < first[2].log_time < 9
    assert state[2].log_time == first[2].log_time


def test_a_snapshot_has_the_state_of_a_pause(folder: Path) -> None:
    """And the messages from before the pause: those of the pause take no room."""
    world = World(folder, is_snapshot=True, max_cache_size=30)
    latched, plain = world.topic("/map", is_latched=True), world.topic("/topic")
    world.put(plain, "before", at=0)
    world.put(latched, "hall", at=1, is_paused=True)
    world.put(plain, *["unheard"] * 20, at=2, is_paused=True)
    world.pipeline.resume()
    world.put(plain, "heard", at=3)
    world.pipeline.snapshot()
    world.pipeline.snapshot()  # has nothing more
    losses = world.finish()
    assert (world.bag.texts("/map"), world.bag.texts("/topic")) == (["hall"], ["before", "heard"])
    assert [one[2].log_time for one in world.bag.messages(world.bag.files[0], "/map")] == [0]
    assert losses == {"/map": TopicLosses(1, 1), "/topic": TopicLosses(2, 2)}


def test_others_read_topics_whose_publishers_came_later(folder: Path) -> None:
    """rosbags wants the same profiles in metadata.yaml and in each file, as ROS 2 writes them."""
    world = World(folder)
    topic = world.topic("/topic")
    world.put(topic, "a")
    world.pipeline.pump()
    topic.update_offers([QoSProfile(), QoSProfile(7)])
    world.put(topic, "b")
    world.pipeline.pump()
    world.pipeline.split()
    world.put(topic, "c")
    world.finish()
    with AnyReader([folder]) as reader:
        assert [data[8:9] for _, _, data in reader.messages()] == [b"a", b"b", b"c"]


@pytest.mark.parametrize("max_cache_size", [0, 1 << 20])
def test_a_further_file_that_can_not_be_made(
    folder: Path, max_cache_size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The written part is a complete bag, and the reason stays."""
    world = World(folder, max_cache_size=max_cache_size)
    topic = world.topic("/topic")
    world.put(topic, "a")

    def fail(files: BagFiles) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(BagFiles, "_open", fail)
    world.pipeline.split()
    world.put(topic, "b")
    losses = world.finish()
    assert str(world.pipeline.failure) == f"[Errno {errno.EMFILE}] Too many open files"
    assert (world.bag.metadata.message_count, world.bag.texts()) == (1, ["a"])
    assert losses["/topic"].lost == {"not_written": 1}


@pytest.mark.parametrize("is_snapshot", [False, True])
def test_beyond_half_of_the_cache_it_is_crowded_but_not_where_it_is_a_memory(
    folder: Path, is_snapshot: bool
) -> None:
    world = World(folder, is_slow=True, max_cache_size=1000, is_snapshot=is_snapshot)
    topic = world.topic("/topic")
    world.put(topic, "x" * 400)
    assert not world.pipeline.is_crowded
    world.put(topic, "x" * 400)
    assert world.pipeline.is_crowded is not is_snapshot
    world.finish()
