"""bus_bridge.rmw_zenoh.reading: messages of one key find the route of their publisher."""

import asyncio
from collections.abc import Callable
from typing import Any, cast

import msgspec
import pytest

from bus.msg.std_msgs import String
from bus.qos import QoSProfile
from bus.schema import MessageSchema
from bus_bridge.batch import Batch
from bus_bridge.engine import FarEndpoint
from bus_bridge.ros2.known_types import KnownTypes

pytest.importorskip("zenoh", reason="needs the extra rmw-zenoh: make setup installs it")

from bus_bridge.rmw_zenoh import attachment, reading
from bus_bridge.rmw_zenoh.reading import Intakes, RosReader

KEY = "0/chatter/std_msgs::msg::dds_::String_/RIHS01_00"
KNOWN = KnownTypes().learn(MessageSchema.of(String))
ONE, OTHER = b"1" * 16, b"2" * 16
LATCHED = QoSProfile(3, durability="transient_local")


class Subscription:
    def __init__(self, push: Callable[[bytes, bytes], None], with_history: bool) -> None:
        self.push, self.with_history = push, with_history
        self.is_there = True

    def undeclare(self) -> None:
        self.is_there = False


class Source:
    """Passes things on at once."""

    def __init__(
        self, take: Callable[[Any], None], lose: Callable[[Any], None], after: Callable[[], None]
    ) -> None:
        self._take, self.lose, self._after = take, lose, after
        self.is_closed = False
        self.sizes: list[int] = []

    def push(self, thing: Any, size: int) -> None:
        self.sizes.append(size)
        self._take(thing)
        self._after()

    def close(self) -> None:
        self.is_closed = True


class Session:
    """zenoh, as intakes see it."""

    def __init__(self) -> None:
        self.subscriptions: list[Subscription] = []
        self.sources: list[Source] = []

    def source(self, take: Any, bound: int, lose: Any, *, after: Any) -> Source:
        self.sources.append(Source(take, lose, after))
        return self.sources[-1]

    def hear(self, key: str, push: Any, *, with_history: bool) -> Subscription:
        assert key == KEY
        self.subscriptions.append(Subscription(push, with_history))
        return self.subscriptions[-1]

    def call(self, what: Any, *arguments: Any) -> None:
        what(*arguments)

    def come(self, gid: bytes, number: int, text: str | None, head: bytes | None = None) -> None:
        payload = msgspec.msgpack.encode((text,))
        cdr = b"\0\1\0\0\xff" if text is None else b"".join(KNOWN.codec.encode(payload))
        if head is None:
            head = attachment.write(number, 7, gid)
        self.subscriptions[-1].push(cdr, head)


class World:
    def __init__(self) -> None:
        self.session = cast(Any, Session())
        self.warnings: list[str] = []
        self.intakes = Intakes(self.session, self.warnings.append)
        self.batches: list[tuple[bytes, list[tuple[str, int, int]]]] = []

    def read(self, gid: bytes = ONE, qos: QoSProfile | None = None) -> RosReader:
        endpoint = FarEndpoint("publisher", gid, "n", "/chatter", "", "", qos or QoSProfile(10))

        def on_batch(batch: Batch) -> None:
            found = [
                (msgspec.msgpack.decode(one.payload)[0], one.number, one.source_time_ns) for one in batch
            ]
            self.batches.append((gid, found))

        return RosReader(self.intakes.hold(KEY, KNOWN), endpoint, KNOWN, on_batch)


@pytest.fixture
async def world() -> World:
    return World()


async def test_messages_go_to_the_route_of_their_publisher(world: World) -> None:
    world.read(ONE)
    world.read(OTHER)
    world.session.come(OTHER, 1, "a")
    world.session.come(ONE, 4, "b")
    assert world.batches == [(OTHER, [("a", 1, 7)]), (ONE, [("b", 4, 7)])]
    assert len(world.session.subscriptions) == 1


async def test_messages_without_a_number_are_new(world: World) -> None:
    world.read()
    for number in (0, -5, 1):
        world.session.come(ONE, number, "a")
    assert [found[0][1] for _, found in world.batches] == [0, 0, 1]


async def test_early_messages_wait_for_their_route(world: World) -> None:
    intake = world.intakes.hold(KEY, KNOWN)
    world.session.come(ONE, 1, "a")
    world.session.come(ONE, 2, "b")
    reader = world.read()
    assert not world.batches  # its route counts losses once it has the reader
    await asyncio.sleep(0)
    world.session.come(ONE, 3, "c")
    assert world.batches == [(ONE, [("a", 1, 7), ("b", 2, 7)]), (ONE, [("c", 3, 7)])]
    assert reader.lost == {}
    intake.release()
    reader.close()
    assert world.session.sources[0].is_closed
    assert not world.session.subscriptions[0].is_there


async def test_messages_of_a_publisher_without_a_route_don_t_wait_for_ever(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    world.intakes.hold(KEY, KNOWN)
    world.session.come(ONE, 1, "old")
    now_s = asyncio.get_running_loop().time()
    monkeypatch.setattr(reading, "_EARLY_S", -1.0)
    world.intakes.sweep()
    world.session.come(ONE, 2, "later")
    monkeypatch.setattr(reading, "_EARLY_S", 5.0)
    world.intakes.publisher_came(OTHER)
    world.session.come(OTHER, 1, "x")
    world.intakes.publisher_gone(OTHER)
    assert asyncio.get_running_loop().time() - now_s < 5
    world.read(ONE)
    world.read(OTHER)
    assert world.batches == []


async def test_a_publisher_with_a_history_is_asked_for_it(world: World) -> None:
    first = world.intakes.hold(KEY, KNOWN)
    world.read(ONE, LATCHED)
    plain, asking = world.session.subscriptions
    assert (plain.is_there, plain.with_history, asking.is_there, asking.with_history) == (
        False,
        False,
        True,
        True,
    )
    world.session.come(ONE, 2, "a")
    world.read(OTHER, LATCHED)
    for gid, number in ((ONE, 1), (ONE, 2), (OTHER, 1), (ONE, 3)):
        world.session.come(gid, number, "b")
    assert [(gid, found[0][1]) for gid, found in world.batches] == [(ONE, 2), (OTHER, 1), (ONE, 3)]
    first.release()


async def test_false_messages_are_counted_or_named(world: World) -> None:
    reader = world.read()
    world.session.come(ONE, 5, None)
    world.session.come(ONE, 1, "a", head=b"")
    assert reader.lost == {"undecodable": 1}
    assert world.batches == []
    assert world.warnings == [
        f"messages on '{KEY}' are dropped: they have no attachment of ROS 2's rmw_zenoh"
    ]


async def test_a_long_attachment_counts_for_the_room_of_messages_that_wait(world: World) -> None:
    world.read()
    world.session.come(ONE, 1, "a", head=bytes(1 << 20))
    assert world.session.sources[0].sizes[0] > 1 << 20


async def test_a_false_number_silences_no_publisher(world: World) -> None:
    intake = world.intakes.hold(KEY, KNOWN)
    world.session.come(ONE, 2**48, "early")
    reader = world.read()
    intake.release()
    await asyncio.sleep(0)
    for number in (2**63 - 1, 2**48):
        world.session.come(ONE, number, "false")
    world.session.come(ONE, 3, None)
    for number, text in ((1, "a"), (2, "b"), (2, "again"), (2**48 - 1, "c")):
        world.session.come(ONE, number, text)
    assert [found[0][:2] for _, found in world.batches] == [("a", 1), ("b", 2), ("c", 2**48 - 1)]
    assert reader.lost == {"undecodable": 4, "repeated": 1}
    assert {*world.warnings} == {f"messages on '{KEY}' are dropped: no publisher has numbers like theirs"}


async def test_what_the_queue_of_zenoh_s_thread_drops_is_counted(world: World) -> None:
    reader = world.read()
    (source,) = world.session.sources
    source.lose((b"", attachment.write(1, 7, ONE)))
    source.lose((b"", attachment.write(1, 7, OTHER)))
    source.lose((b"", b"nothing"))
    assert reader.lost == {"memory_limit": 1}


async def test_losses_of_early_messages_and_of_the_queue_add_up(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading, "_EARLY_BYTES", 15)
    intake = world.intakes.hold(KEY, KNOWN)
    world.session.come(ONE, 1, "a")
    world.session.come(ONE, 2, "b")
    reader = world.read()
    (source,) = world.session.sources
    source.lose((b"", attachment.write(3, 7, ONE)))
    assert reader.lost == {"memory_limit": 2}
    await asyncio.sleep(0)
    assert [found for _, found in world.batches] == [[("b", 2, 7)]]
    intake.release()


async def test_a_route_is_given_what_arrived_once_and_not_after_its_end(world: World) -> None:
    other = world.intakes.hold(KEY, KNOWN)
    reader = world.read()
    cdr = b"".join(KNOWN.codec.encode(msgspec.msgpack.encode(("a",))))
    assert [reader.receive(cdr, number, 7) for number in (1, 2)] == [True, False]
    reader.give()
    reader.give()
    assert world.batches == [(ONE, [("a", 1, 7), ("a", 2, 7)])]
    assert reader.receive(cdr, 3, 7)
    reader.close()
    reader.give()
    assert len(world.batches) == 1
    other.release()


async def test_a_closed_route_gets_nothing_more(world: World) -> None:
    other = world.intakes.hold(KEY, KNOWN)
    reader = world.read()
    reader.close()
    reader.close()
    world.session.come(ONE, 1, "a")
    assert world.batches == []
    other.release()
    assert world.session.sources[0].is_closed
