"""One subscription for each viewed topic."""

import gc
from typing import Any
from weakref import ref

import pytest

from bus.errors import QuotaExceeded
from bus.msg.std_msgs import Int32, String
from bus.qos import Durability, QoSProfile, Reliability
from bus.schema import MessageSchema, schema_of
from bus.types.support import type_support
from bus_web import shared_subscriptions as module
from bus_web.kept import Kept
from bus_web.shared_subscriptions import Heard
from semantics import until
from web_world import WebWorld, turns

LATCHED = QoSProfile(2, durability=Durability.TRANSIENT_LOCAL)


class Listener:
    def __init__(self) -> None:
        self.heard: list[Heard] = []
        self.faults: list[str] = []

    def on_message(self, topic: str, heard: Heard) -> None:
        self.heard.append(heard)

    def on_fault(self, topic: str, text: str) -> None:
        self.faults.append(text)

    @property
    def values(self) -> list[Any]:
        return [one.message.data for one in self.heard]


async def test_as_long_as_somebody_looks() -> None:
    world = WebWorld()
    subscriptions = world.hub.subscriptions
    chatter = world.add("publisher", "/talker", "/chatter", String)
    first, second = Listener(), Listener()
    subscriptions.add("/chatter", first)
    await turns()
    assert world.node.subscriptions == {}, "nobody knows its type yet"
    world.look()
    await turns()
    (made,) = world.node.subscriptions["/chatter"]
    assert (made.profile.depth, made.profile.reliability) == (5, Reliability.BEST_EFFORT)
    world.publish(chatter, String(data="a"))
    subscriptions.add("/chatter", second)
    subscriptions.add("/chatter", third := Listener(), is_last_wanted=False)
    world.publish(chatter, String(data="b"))
    assert [one.values for one in (first, second, third)] == [["a", "b"], ["a", "b"], ["b"]]
    assert first.heard[1] is second.heard[1], "decoded once"
    for one in (first, second, third):
        assert not made.is_closed
        subscriptions.remove("/chatter", one)
    subscriptions.remove("/chatter", first)
    await turns()
    assert made.is_closed
    await world.close()


async def test_a_topic_of_another_type_now() -> None:
    world = WebWorld()
    world.add("publisher", "/talker", "/x", String)
    world.look()
    world.hub.subscriptions.add("/x", listener := Listener())
    await turns()
    world.remove("/x")
    world.look()
    await turns()
    assert not world.node.subscriptions["/x"][0].is_closed, "it may come back"
    number = world.add("publisher", "/talker", "/x", Int32)
    world.look()
    await turns()
    assert [one.is_closed for one in world.node.subscriptions["/x"]] == [True, False]
    world.publish(number, Int32(data=5))
    assert listener.values == [5]
    await world.close()


async def test_busd_does_not_answer_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    world = WebWorld()
    chatter = world.add("publisher", "/talker", "/chatter", String)
    world.look()
    get_schema, silences = world.node.get_schema, iter(range(3))

    async def get_schema_late(*kind: str) -> MessageSchema:
        for _ in silences:
            raise TimeoutError("busd does not answer")
        return await get_schema(*kind)

    monkeypatch.setattr(world.node, "get_schema", get_schema_late)
    world.hub.subscriptions.add("/chatter", listener := Listener())
    await turns()
    world.publish(chatter, String(data="a"))
    assert (listener.values, listener.faults) == (["a"], [])
    await world.close()


async def test_a_type_that_nobody_describes() -> None:
    world = WebWorld()
    world.add("publisher", "/talker", "/x", type_name="a/msg/B", type_hash="h")
    world.look()
    world.hub.subscriptions.add("/x", listener := Listener())
    await turns()
    assert listener.faults == ["no endpoint has a/msg/B any more"]
    await world.close()


async def test_a_refusal_is_told_to_later_viewers_and_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_AGAIN_S", 0.001)
    world = WebWorld()
    chatter = world.add("publisher", "/talker", "/chatter", String)
    world.look()
    get_schema, tries = world.node.get_schema, 0

    async def refuse(*kind: str) -> MessageSchema:
        nonlocal tries
        tries += 1
        raise QuotaExceeded("endpoints", used=2, limit=2)

    monkeypatch.setattr(world.node, "get_schema", refuse)
    first, second = Listener(), Listener()
    world.hub.subscriptions.add("/chatter", first)
    await until(lambda: tries > 2)
    world.hub.subscriptions.add("/chatter", second)
    (text,) = first.faults
    assert text.startswith("endpoints: 2 of 2 in use") and second.faults == [text]
    monkeypatch.setattr(world.node, "get_schema", get_schema)
    await until(lambda: world.node.subscriptions)
    world.publish(chatter, String(data="a"))
    assert first.values == second.values == ["a"]
    await world.close()


async def test_all_topics_share_the_bound_of_what_is_kept() -> None:
    """The topic that keeps most loses its oldest message."""
    world = WebWorld()
    subscriptions = world.hub.subscriptions
    subscriptions._kept = Kept(most_bytes=10_000)
    numbers = {
        topic: world.add("publisher", "/talker", topic, String, LATCHED) for topic in ("/small", "/large")
    }
    world.look()
    for topic in numbers:
        subscriptions.add(topic, Listener())
    await turns()
    for text, topic in (("a", "/small"), ("b" * 5000, "/large"), ("c" * 5000, "/large")):
        world.publish(numbers[topic], String(data=text))
    late = {topic: Listener() for topic in numbers}
    for topic, listener in late.items():
        subscriptions.add(topic, listener)
    assert (late["/small"].values, late["/large"].values) == (["a"], ["c" * 5000])
    assert subscriptions._kept.dropped == 1
    await world.close()


async def test_who_looks_later_gets_what_publishers_keep() -> None:
    world = WebWorld()
    one = world.add("publisher", "/one", "/tf_static", String, LATCHED)
    other = world.add("publisher", "/other", "/tf_static", String, LATCHED)
    world.look()
    world.hub.subscriptions.add("/tf_static", first := Listener())
    await turns()
    for text, publisher in (("a", one), ("b", other), ("c", one), ("d", one)):
        world.publish(publisher, String(data=text))
    world.hub.subscriptions.add("/tf_static", late := Listener(), is_last_wanted=False)
    assert (first.values, late.values) == (["a", "b", "c", "d"], ["b", "c", "d"])
    await world.close()


def test_a_message_goes_with_who_has_it() -> None:
    """It does not wait for the garbage collector: images would take some 20 MB more at any time."""

    class Payload(bytearray):
        pass

    schema = schema_of(type_support(String))
    gc.disable()
    try:
        payload = Payload(100)
        heard = Heard(schema, lambda data: data, payload, None, 1)  # type: ignore[arg-type]
        is_there = ref(payload)
        del payload, heard
        assert is_there() is None
    finally:
        gc.enable()
