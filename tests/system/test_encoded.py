"""Messages as bytes: busd sends encoded messages as they are, and delivers raw ones undecoded."""

import array
import asyncio
from collections.abc import Callable
from time import time_ns
from typing import Any

import msgspec
import pytest

import bus
from bus.msg.std_msgs import Int32, String
from bus.wire.source_time import SOURCE_MARK
from semantics import KEEP_ALL, LATCHED, Wheel, node, until

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("route")

LONG = 300_000
_CLOCKS_NS = 10_000_000
"""Most difference between the wall clock and the clock of timestamps."""


def encoded(size: int = 5) -> bytes:
    """An encoded Wheel; its size is a multiple of 8 bytes."""
    data = msgspec.msgpack.encode(Wheel("w" * size))
    missing = -len(data) % 8
    return msgspec.msgpack.encode(Wheel("w" * (size + missing)))


class TestBuffers:
    @pytest.mark.parametrize("size", [5, LONG])
    @pytest.mark.parametrize(
        "kind",
        [
            bytearray,
            lambda raw: array.array("d", raw),
            lambda raw: memoryview(raw).cast("d"),
            lambda raw: memoryview(raw).cast("d").cast("B").cast("B", shape=[2, len(raw) // 2]),
        ],
        ids=["bytearray", "array", "memoryview", "two dimensions"],
    )
    async def test_the_bytes_of_wider_items_are_counted(
        self, node: bus.Node, kind: Callable[[bytes], Any], size: int
    ) -> None:
        subscription = await node.create_subscription(Wheel, "t", 10)
        publisher = await node.create_publisher(Wheel, "t", 10)
        for _ in range(2):
            assert publisher.publish_encoded(kind(encoded(size)))
            message, _ = await subscription.receive()
            assert msgspec.msgpack.encode(message) == encoded(size)
        assert publisher.statistics().bytes == subscription.statistics().bytes == 2 * len(encoded(size))

    async def test_the_limit_is_one_of_bytes(self, start_daemon: Any, tmp_path: Any) -> None:
        config = tmp_path / "busd.toml"
        config.write_text("[limits]\nmessage_bytes = 1024\n")
        start_daemon("--config", str(config))
        async with bus.Node("tester", arguments=[]) as node:
            publisher = await node.create_publisher(Wheel, "t", 10)
            with pytest.raises(bus.PayloadTooLarge, match="1600") as told:
                publisher.publish_encoded(memoryview(bytes(1600)).cast("d"))  # type: ignore[arg-type]
            assert told.value.size_bytes == 1600
            assert publisher.statistics().published == 0


class TestSubscriptions:
    async def test_whatever_the_topic_has(self, node: bus.Node) -> None:
        publisher = await node.create_publisher(Wheel, "t", 10)
        raw = await node.create_subscription(None, "t", 10, raw=True)
        made = await node.create_subscription(None, "t", 10)
        named = await node.create_subscription("robot/msg/Wheel", "t", 10, raw=True)
        publisher.publish(Wheel("left", [1.0]))
        payload, info = await raw.receive()
        assert payload == msgspec.msgpack.encode(Wheel("left", [1.0])) == (await named.receive())[0]
        assert (info.publication_sequence_number, info.publisher_gid) == (1, publisher.gid)
        message, _ = await made.receive()
        assert (message.name, message.speeds) == ("left", [1.0])
        assert raw.schema == made.schema == publisher.schema == bus.MessageSchema.of(Wheel)
        assert raw.type is bytes
        assert made.type.__name__ == "Wheel"

    async def test_a_ready_made_class_where_there_is_one(self, node: bus.Node) -> None:
        await node.create_publisher(String, "t", 10)
        assert (await node.create_subscription(None, "t", 10)).type is String
        assert (await node.create_subscription("std_msgs/msg/Int32", "free", 10)).type is Int32

    async def test_to_a_callback_with_its_info(self, node: bus.Node) -> None:
        heard: list[tuple[bytes, bus.MessageInfo]] = []
        publisher = await node.create_publisher(Wheel, "t", 10)
        await node.create_subscription(
            None, "t", 10, lambda payload, info: heard.append((payload, info)), raw=True
        )
        for number in range(5):
            publisher.publish(Wheel(str(number)))
        await until(lambda: len(heard) == 5)
        assert [msgspec.msgpack.decode(payload)["name"] for payload, _ in heard] == [*"01234"]
        assert [info.publication_sequence_number for _, info in heard] == [1, 2, 3, 4, 5]

    @pytest.mark.parametrize("name", [None, "robot/msg/Wheel"])
    async def test_it_waits_for_a_type(self, node: bus.Node, name: str | None) -> None:
        making = asyncio.create_task(node.create_subscription(name, "t", 10, raw=True))
        await node.create_publisher(String, "other", 10)
        await asyncio.sleep(0.05)
        assert not making.done()
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.05):
                await node.create_subscription(name, "t", 10)
        async with bus.Node("talker", arguments=[]) as talker:
            publisher = await talker.create_publisher(Wheel, "t", 10)
            subscription = await making
            publisher.publish(Wheel("left"))
            assert (await subscription.receive())[0] == msgspec.msgpack.encode(Wheel("left"))
        link: Any = node._link
        assert not link.observers

    async def test_a_wait_ends_with_the_node(self, node: bus.Node) -> None:
        async with bus.Node("short", arguments=[]) as short:
            making = asyncio.create_task(short.create_subscription(None, "t", 10))
            await asyncio.sleep(0.02)
        with pytest.raises(bus.ConnectionClosed, match="/short"):
            await making

    async def test_two_types_on_a_topic(self, node: bus.Node) -> None:
        await node.create_publisher(Wheel, "t", 10)
        publisher = await node.create_publisher(String, "t", 10)
        with pytest.raises(
            bus.ConfigurationError, match=r"'/t' has more than one type.*robot/msg/Wheel \(.*std_m"
        ):
            await node.create_subscription(None, "t", 10, raw=True)
        subscription = await node.create_subscription("std_msgs/msg/String", "t", 10, raw=True)
        publisher.publish(String(data="hi"))
        assert (await subscription.receive())[0] == b"\x91\xa2hi"
        assert subscription.get_publisher_count() == 1

    async def test_another_type_than_the_topics_is_told(self, node: bus.Node) -> None:
        told: list[bus.IncompatibleType] = []
        await node.create_publisher(Wheel, "t", 10)
        subscription = await node.create_subscription(
            "std_msgs/msg/String",
            "t",
            10,
            raw=True,
            events=bus.SubscriptionEvents(incompatible_type=told.append),
        )
        await until(lambda: told)
        assert "robot/msg/Wheel" in told[0].text
        assert subscription.get_publisher_count() == 0


class TestPublishers:
    async def test_by_a_schema_of_the_bus(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Wheel, "t", 10)
        mine = (await node.graph()).subscriptions_of("/t")[0]
        schema = await node.get_schema(mine.type_name, mine.type_hash)
        assert schema == bus.MessageSchema.of(Wheel) == bus.MessageSchema.of(schema.description)
        publisher = await node.create_publisher(schema, "t", 10)
        assert publisher.type is bytes
        for size in (5, LONG):
            publisher.publish_encoded(encoded(size))
            publisher.publish(encoded(size))
            await publisher.send(encoded(size))
            for _ in range(3):
                assert msgspec.msgpack.encode((await subscription.receive())[0]) == encoded(size)
        assert publisher.get_subscription_count() == 1
        for what in (Wheel(), "text", 5):
            with pytest.raises(bus.MessageTypeError, match="expected an encoded message as bytes, got"):
                publisher.publish(what)

    async def test_what_is_passed_on_stays_as_it_was(self, node: bus.Node) -> None:
        """As in a bridge: no program on the way knows the class."""
        first = await node.create_publisher(Wheel, "here", 10)
        last = await node.create_subscription(Wheel, "there", 10)
        incoming = await node.create_subscription(None, "here", 10, raw=True)
        outgoing = await node.create_publisher(incoming.schema, "there", incoming.qos)
        for number in range(5):
            first.publish(Wheel(str(number), [0.5] * number))
        for number in range(5):
            outgoing.publish_encoded((await incoming.receive())[0])
            assert (await last.receive())[0] == Wheel(str(number), [0.5] * number)

    async def test_the_hash_is_that_of_the_schema(self, node: bus.Node) -> None:
        """Another program may hash types differently: a schema keeps the hash that came with it."""
        strange = bus.MessageSchema("robot/msg/Wheel", "BUS01_other", bus.MessageSchema.of(Wheel).encoded)
        publisher = await node.create_publisher(strange, "t", 10)
        raw = await node.create_subscription(None, "t", 10, raw=True)
        made = await node.create_subscription(None, "t", 10)
        assert raw.schema == made.schema == strange
        publisher.publish_encoded(encoded())
        assert (await raw.receive())[0] == encoded()
        assert (await made.receive())[0].name == msgspec.msgpack.decode(encoded())["name"]

    async def test_descriptions_that_are_broken(self, node: bus.Node) -> None:
        for data in (b"\xc1", b"\x01", b"\x80", msgspec.msgpack.encode({"root": "a/msg/A", "types": {}})):
            with pytest.raises(bus.ConfigurationError):
                bus.MessageSchema("a/msg/A", "BUS01_1", data).to_class()
        with pytest.raises(bus.ConfigurationError):
            bus.MessageSchema.of({"root": "a/msg/A", "types": {}})
        with pytest.raises(bus.MessageTypeError):
            bus.MessageSchema.of(int)  # type: ignore[arg-type]
        await node.create_publisher(bus.MessageSchema("a/msg/A", "BUS01_1", b"\xc1"), "t", 10)
        raw = await node.create_subscription(None, "t", 10, raw=True)
        await raw.wait_for_publishers()
        with pytest.raises(bus.ConfigurationError, match="description of a/msg/A on the bus is broken"):
            await node.create_subscription(None, "t", 10)


class TestTakingMany:
    async def test_each_with_its_info(self, node: bus.Node) -> None:
        first = await node.create_publisher(Wheel, "t", 100)
        second = await node.create_publisher(Wheel, "t", 100)
        subscription = await node.create_subscription(None, "t", 200, raw=True)
        await subscription.wait_for_publishers(2)
        began_ns = time_ns()
        for number in range(50):
            for publisher in (first, second):
                publisher.publish(Wheel(str(number)))
            await asyncio.sleep(0)
        await until(lambda: subscription.statistics().queued == 100)
        batch = [await subscription.receive(), *subscription.take_many(30), *subscription.take_many(1000)]
        assert subscription.take_many(1000) == []
        assert [info.reception_sequence_number for _, info in batch] == [*range(1, 101)]
        for publisher in (first, second):
            mine = [(payload, info) for payload, info in batch if info.publisher_gid == publisher.gid]
            assert [info.publication_sequence_number for _, info in mine] == [*range(1, 51)]
            assert [msgspec.msgpack.decode(payload)["name"] for payload, _ in mine] == [*map(str, range(50))]
        assert {type(info) for _, info in batch} == {bus.MessageInfo}
        assert all(
            began_ns - 10**9 < info.source_timestamp <= info.received_timestamp + 10**6 for _, info in batch
        )
        assert subscription.statistics().delivered == 100

    @pytest.mark.parametrize("qos", [10, KEEP_ALL], ids=["keep last", "keep all"])
    async def test_as_take_does_it(self, node: bus.Node, qos: Any) -> None:
        publisher = await node.create_publisher(Wheel, "t", qos)
        one = await node.create_subscription(Wheel, "t", qos)
        other = await node.create_subscription(Wheel, "t", qos)
        for _ in range(3):
            for number in range(25):
                await publisher.send(Wheel(str(number)))
            await until(lambda: one.statistics().queued == other.statistics().queued >= 10)
            single = []
            while (taken := one.take()) is not None:
                single.append(taken)
            many = [taken for part in iter(lambda: other.take_many(7), []) for taken in part]
            assert [(message, info[2:4]) for message, info in many] == [
                (message, info[2:4]) for message, info in single
            ]
        assert one.statistics().dropped == other.statistics().dropped

    async def test_none_that_does_not_decode(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Wheel, "t", 10)
        publisher = await node.create_publisher(bus.MessageSchema.of(Wheel), "t", 10)
        for payload in (encoded(), b"\xc1", encoded(), b"", b"\xc1"):
            publisher.publish_encoded(payload)
        await until(lambda: subscription.statistics().expected == 5)
        found: list[Any] = []

        def is_all() -> bool:
            found.extend(subscription.take_many(10))
            return len(found) + subscription.statistics().dropped.get("undecodable", 0) == 5

        await until(is_all)
        assert len(found) == 2
        assert subscription.take_many(0) == []


class TestArrivals:
    async def test_they_are_announced_until_nobody_wants_it(self, node: bus.Node) -> None:
        publisher = await node.create_publisher(Wheel, "t", 10)
        subscription = await node.create_subscription(Wheel, "t", 10)
        taken: list[Any] = []
        subscription.set_arrival_callback(lambda: taken.extend(subscription.take_many(10)))
        for number in (1, 2):
            publisher.publish(Wheel("front"))
            await until(lambda number=number: len(taken) == number)
        subscription.set_arrival_callback(None)
        publisher.publish(Wheel("rear"))
        assert (await subscription.receive())[0].name == "rear"
        assert len(taken) == 2

    async def test_not_where_messages_go_to_a_callback(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Wheel, "t", 10, lambda message: None)
        with pytest.raises(bus.ConfigurationError, match="delivers to a callback"):
            subscription.set_arrival_callback(lambda: None)


class TestPacks:
    """By socket, and for long messages, there are no packs; then the other ways work."""

    @pytest.mark.parametrize("qos", [50, KEEP_ALL], ids=["keep last", "keep all"])
    async def test_they_are_passed_on_as_single_messages_are(
        self, node: bus.Node, route: str, qos: Any
    ) -> None:
        near = await node.create_publisher(Wheel, "near", qos)
        far = await node.create_publisher(Wheel, "far", qos)
        tap = await node.create_subscription(None, "near", qos, raw=True)
        listener = await node.create_subscription(None, "far", qos, raw=True)
        await near.wait_for_subscriptions()
        await far.wait_for_subscriptions()
        sent = [(encoded(size), THEN_NS + number) for number, size in enumerate((5, 9, 5000, 20_000, 3, 4))]
        for payload, then_ns in sent:
            assert near.publish_encoded(payload, source_time_ns=then_ns)
        await until(lambda: tap.statistics().queued == len(sent))
        packs = 0
        while tap.statistics().queued:
            before_ns = time_ns()
            pack = tap.take_packed(60_000, 10_000, merges=packs % 2 == 1)
            if pack is None:
                for payload, info in tap.take_many(1):
                    assert far.publish_encoded(payload, source_time_ns=info.source_timestamp)
                continue
            packs += 1
            assert pack.publisher_gid == near.gid and pack.has_more is bool(tap.statistics().queued)
            assert before_ns - _CLOCKS_NS < pack.received_timestamp < time_ns() + _CLOCKS_NS
            assert far.publish_packed(pack.data) == pack.messages
        assert (packs > 0) is (route == "shm")
        await until(lambda: listener.statistics().queued == len(sent))
        batch = listener.take_many(100)
        assert [(payload, info.source_timestamp) for payload, info in batch] == sent
        assert [info.publication_sequence_number for _, info in batch] == [*range(1, len(sent) + 1)]
        assert far.publish_packed(b"") == 0
        for one in (tap, listener):
            assert one.statistics().delivered == len(sent) and not one.statistics().dropped
        assert far.statistics().published == len(sent)

    @pytest.mark.parametrize("qos", [200, KEEP_ALL], ids=["keep last", "keep all"])
    async def test_they_go_on_after_single_messages(self, node: bus.Node, route: str, qos: Any) -> None:
        publisher = await node.create_publisher(Wheel, "t", qos)
        tap = await node.create_subscription(None, "t", qos, raw=True)
        await publisher.wait_for_subscriptions()
        for _ in range(150):
            publisher.publish_encoded(encoded())
        await until(lambda: tap.statistics().queued == 150)
        assert [len(tap.take_many(limit)) for limit in (1, 65, 3)] == [1, 65, 3]
        pack = tap.take_packed(60_000, 10_000)
        assert (pack is not None and pack.messages) == (81 if route == "shm" else False)
        assert len(tap.take_many(200)) == (0 if route == "shm" else 81)

    async def test_there_may_be_no_room(self, node: bus.Node) -> None:
        publisher = await node.create_publisher(Wheel, "t", KEEP_ALL)
        subscription = await node.create_subscription(None, "t", KEEP_ALL, raw=True)
        await publisher.wait_for_subscriptions()
        record = (1).to_bytes(8, "little") + bytes(8) + len(encoded()).to_bytes(4, "little") + encoded()
        done = 0
        while (last := publisher.publish_packed(record * 2000)) or publisher.publish_encoded(encoded()):
            done += last or 1
        assert done > 2000
        await until(lambda: subscription.statistics().queued == done)
        assert len(subscription.take_many(1 << 20)) == done


THEN_NS = 1_234_567_890_123_456_789


class TestSourceTime:
    @pytest.mark.parametrize("size", [5, 5000, LONG])
    @pytest.mark.parametrize("raw", [True, False])
    async def test_it_comes_with_the_message(self, node: bus.Node, raw: bool, size: int) -> None:
        heard: list[tuple[Any, bus.MessageInfo]] = []
        plain: list[Any] = []
        publisher = await node.create_publisher(Wheel, "t", 50)
        one = await node.create_subscription(Wheel, "t", 50, raw=raw)
        await node.create_subscription(
            Wheel, "t", 50, lambda message, info: heard.append((message, info)), raw=raw
        )
        await node.create_subscription(Wheel, "t", 50, plain.append, raw=raw)
        await publisher.wait_for_subscriptions(3)
        expected = encoded(size) if raw else msgspec.msgpack.decode(encoded(size), type=Wheel)
        for number in range(3):  # single messages, and several in a run
            for _ in range(1 + 4 * number):
                assert publisher.publish_encoded(encoded(size), source_time_ns=THEN_NS + number)
                publisher.publish_encoded(encoded(size))
            await until(lambda: len(heard) == len(plain) == one.statistics().queued)
            await asyncio.sleep(0.01)
        await until(lambda: len(heard) == len(plain) == one.statistics().queued == 30)
        for batch in ([await one.receive(), *one.take_many(50)], heard):
            assert all(message == expected for message, _ in batch)
            times = [info.source_timestamp for _, info in batch]
            assert times[::2] == [THEN_NS] + [THEN_NS + 1] * 5 + [THEN_NS + 2] * 9
            assert all(abs(time - time_ns()) < 60 * 10**9 for time in times[1::2])
        assert all(message == expected for message in plain)

    async def test_order_and_lifespan_go_by_the_publishing(self, node: bus.Node) -> None:
        """An old source time makes a message neither expired nor part of the history."""
        qos = bus.QoSProfile(50, lifespan=30.0)
        publishers = [await node.create_publisher(Wheel, "t", qos) for _ in range(2)]
        subscription = await node.create_subscription(Wheel, "t", qos)
        await subscription.wait_for_publishers(2)
        for number in range(10):
            for publisher in publishers:
                payload = msgspec.msgpack.encode(Wheel(str(number)))
                publisher.publish_encoded(payload, source_time_ns=THEN_NS - number)
        await until(lambda: subscription.statistics().queued == 20)
        batch = subscription.take_many(100)
        for publisher in publishers:
            mine = [message.name for message, info in batch if info.publisher_gid == publisher.gid]
            assert mine == [*"0123456789"]
        assert not subscription.statistics().dropped

    async def test_late_joiners_have_it_too(self, node: bus.Node) -> None:
        publisher = await node.create_publisher(Wheel, "t", LATCHED)
        for number in range(1, 9):
            publisher.publish_encoded(encoded(), source_time_ns=number)
        subscription = await node.create_subscription(Wheel, "t", LATCHED)
        times = [(await subscription.receive())[1].source_timestamp for _ in range(5)]
        assert times == [4, 5, 6, 7, 8]

    @pytest.mark.parametrize("wrong", [0, -1, 1 << 63, 1.5, "now"])
    async def test_what_is_no_time(self, node: bus.Node, wrong: Any) -> None:
        publisher = await node.create_publisher(Wheel, "t", 10)
        with pytest.raises(bus.ConfigurationError, match=r"source_time_ns is nanoseconds.* it is "):
            publisher.publish_encoded(encoded(), source_time_ns=wrong)
        assert publisher.statistics().published == 0

    async def test_a_time_and_no_message(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Wheel, "t", 10)
        publisher = await node.create_publisher(Wheel, "t", 10)
        publisher.publish_encoded(b"", source_time_ns=THEN_NS)
        publisher.publish_encoded(SOURCE_MARK + bytes(8) + encoded())
        publisher.publish_encoded(SOURCE_MARK + b"\xff" * 8 + encoded())
        publisher.publish_encoded(encoded())
        assert msgspec.msgpack.encode((await subscription.receive())[0]) == encoded()
        assert subscription.statistics().dropped == {"undecodable": 3}
