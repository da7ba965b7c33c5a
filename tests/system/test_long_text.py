"""Messages with long text: ASCII is copied once into the ring, and all text arrives unchanged."""

import asyncio
import tracemalloc

import msgspec
import pytest

import bus
from bus.msg.std_msgs import String
from bus.types.large_fields import LONG_TEXT
from semantics import KEEP_ALL, node

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("route")

by_shared_memory = pytest.mark.parametrize("route", ["shm"], indirect=True)

MIB = 1 << 20
LONG = LONG_TEXT + 3


class Page(msgspec.Struct):
    """Text before, between and after other fields, with its own array head."""

    number: int = 0
    text: str = ""
    other: str = ""
    width: int = 0


class Note(msgspec.Struct, array_like=True):
    """Encoded like the ready-made messages."""

    author: str = ""
    text: str = ""


TEXTS = {
    "short": "x" * 100,
    "one below": "x" * (LONG_TEXT - 1),
    "long": "0123456789" * (LONG // 10),
    "not ASCII": "\N{GREEK SMALL LETTER PI}" * LONG,
    "ASCII but for its end": "x" * LONG + "\N{SNOWMAN}",
    "with zeros": "a\0b" * LONG,
}


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
async def test_any_text_arrives_as_it_was(node: bus.Node, text: str) -> None:
    for kind, messages in (
        (String, [String(data=text)] * 3),
        (Page, [Page(1, text, "", 2), Page(3, "", text, 4), Page(5, text, text, 6)]),
        (Note, [Note("me", text), Note(text, "")]),
    ):
        subscription = await node.create_subscription(kind, f"t_{kind.__name__}", KEEP_ALL)
        publisher = await node.create_publisher(kind, f"t_{kind.__name__}", KEEP_ALL)
        for message in messages:
            await publisher.send(message)
            received, _ = await subscription.receive()
            assert received == message


async def test_short_and_long_in_turns(node: bus.Node) -> None:
    subscription = await node.create_subscription(String, "t", KEEP_ALL)
    publisher = await node.create_publisher(String, "t", KEEP_ALL)
    texts = [f"{number}" * (LONG if number % 3 else 1) for number in range(8)]
    for text in texts:
        await publisher.send(String(data=text))
        assert (await subscription.receive())[0].data == text
    assert publisher.statistics().published == len(texts)


async def test_a_late_joiner_gets_long_text_too(node: bus.Node) -> None:
    latched = bus.QoSProfile(depth=2, durability="transient_local")
    publisher = await node.create_publisher(String, "t", latched)
    for letter in "abc":
        publisher.publish(String(data=letter * LONG))
    await publisher.flush()
    subscription = await node.create_subscription(String, "t", latched)
    assert [(await subscription.receive())[0].data[:2] for _ in range(2)] == ["bb", "cc"]


async def test_from_another_thread(node: bus.Node) -> None:
    subscription = await node.create_subscription(String, "t", 10)
    publisher = await node.create_publisher(String, "t", 10)
    assert await asyncio.to_thread(publisher.publish, String(data="x" * LONG))
    assert (await subscription.receive())[0].data == "x" * LONG


async def test_what_is_wrong_beside_long_text_is_named(node: bus.Node) -> None:
    publisher = await node.create_publisher(Page, "t", 10)
    publisher.publish(Page(text="x" * LONG))
    with pytest.raises(bus.MessageTypeError, match=r"Expected `int`.*\$\.width"):
        publisher.publish(Page(text="x" * LONG, width="wide"))  # type: ignore[arg-type]
    with pytest.raises(bus.MessageTypeError, match=r"\$\.other"):
        publisher.publish(Page(text="x" * LONG, other="\ud800"))
    assert publisher.statistics().published == 1


@by_shared_memory
async def test_ascii_is_copied_once_in_and_once_out(node: bus.Node) -> None:
    """Into the ring, which is not Python's memory, and out of it."""
    subscription = await node.create_subscription(String, "t", 10)
    publisher = await node.create_publisher(String, "t", 10)
    message = String(data="x" * (4 * MIB))
    publisher.publish(message)  # grows the ring
    await subscription.receive()
    await publisher.wait_for_subscriptions(1)  # before that, a record is copied first: it can't be pinned
    tracemalloc.start()
    try:
        publisher.publish(message)
        assert tracemalloc.get_traced_memory()[1] < MIB
        received, _ = await subscription.receive()
        assert 4 * MIB < tracemalloc.get_traced_memory()[1] < 5 * MIB
    finally:
        tracemalloc.stop()
    assert received == message
