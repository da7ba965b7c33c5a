"""Messages that a client publishes."""

import msgspec
import pytest

from bus.msg.std_msgs import Int32, String
from bus.schema import MessageSchema
from bus.types.support import type_support
from bus_ros.cdr import codec_of
from bus_web.foxglove import publishing as module
from bus_web.foxglove.protocol import ClientChannel, Publish
from bus_web.foxglove.publishing import Publishing
from web_world import WebWorld

STRING = "std_msgs/msg/String"


def text(data: str) -> memoryview:
    payload = type_support(String).encode(String(data=data))
    return memoryview(b"".join(codec_of(MessageSchema.of(String)).encode(payload)))


def channel(id: int, topic: str = "/x", schema_name: str = STRING, **others: str) -> ClientChannel:
    return ClientChannel(id, topic, others.pop("encoding", "cdr"), schema_name, **others)


async def test_each_channel_is_a_publisher() -> None:
    world = WebWorld()
    publishing = Publishing(world.hub, world.client)
    await publishing.advertise([channel(1), channel(2, "/y", "std_msgs/String")])
    publishing.publish(Publish(1, text("one")))
    publishing.publish(Publish(2, text("two")))
    (one,), (two,) = world.node.publishers["/x"], world.node.publishers["/y"]
    assert (one.published, two.published) == ([String(data="one")], [String(data="two")])
    await publishing.unadvertise([1, 5])
    assert (one.is_closed, two.is_closed) == (True, False)
    await publishing.close()
    assert two.is_closed
    assert await world.told() == []
    await world.close()


async def test_the_type_is_that_of_the_bus_else_the_client_s() -> None:
    world = WebWorld()
    world.add("subscription", "/a", "/x", String)
    world.look()
    publishing = Publishing(world.hub, world.client)
    await publishing.advertise([channel(1), channel(2, schema_name="std_msgs/msg/Int32")])
    await publishing.advertise([channel(3, "/own", "demo/msg/Own", schema="int32 number\n")])
    (told,) = await world.told()
    assert told["message"] == f"channel 2 (/x): the topic has the type {STRING}, not std_msgs/msg/Int32"
    payload = type_support(Int32).encode(Int32(data=7))
    publishing.publish(Publish(3, memoryview(b"".join(codec_of(MessageSchema.of(Int32)).encode(payload)))))
    (published,) = world.node.publishers["/own"][0].published
    assert msgspec.structs.asdict(published) == {"number": 7}
    await world.close()


@pytest.mark.parametrize(
    ("one", "why"),
    [
        (channel(1), "there is a channel of this number already"),
        (channel(3, encoding="json"), "messages must be in cdr, not in 'json'"),
        (channel(3, "/add/_request"), "a service is called, not published to"),
        (channel(3, schema_name="no/msg/Where"), "no/msg/Where"),
        (
            channel(3, schema_name="no/msg/Where", schema="int32 x", schema_encoding="protobuf"),
            "no/msg/Where",
        ),
        (channel(3, schema_name="no/msg/Where", schema="#" * 262_145), "262145 characters; the limit is"),
        (channel(2), "a client can have at most 1 channels"),
    ],
)
async def test_what_can_not_be_published(
    one: ClientChannel, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = WebWorld()
    publishing = Publishing(world.hub, world.client)
    await publishing.advertise([channel(1)])
    if "most" in why:
        monkeypatch.setattr(module, "_MOST_CHANNELS", 1)
    await publishing.advertise([one])
    (told,) = await world.told()
    assert told["level"] == 2
    assert told["message"].startswith(f"channel {one.id} ({one.topic}): ")
    assert why in told["message"]
    assert sum(map(len, world.node.publishers.values())) == 1
    await world.close()


async def test_busd_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    async def refuse(*arguments: object) -> None:
        raise TimeoutError("busd does not answer")

    world = WebWorld()
    monkeypatch.setattr(world.node, "create_publisher", refuse)
    await Publishing(world.hub, world.client).advertise([channel(1)])
    (told,) = await world.told()
    assert told["message"] == "channel 1 (/x): busd does not answer"
    await world.close()


async def test_many_that_can_not_be_published_are_one_status() -> None:
    world = WebWorld()
    publishing = Publishing(world.hub, world.client)
    await publishing.advertise([channel(id, f"/no/{id}", encoding="json") for id in range(10_000)])
    (told,) = await world.told()
    assert told["message"].endswith("not in 'json' (and 9999 more)")
    await world.close()


async def test_messages_that_are_none() -> None:
    world = WebWorld()
    publishing = Publishing(world.hub, world.client)
    await publishing.advertise([channel(1)])
    publishing.publish(Publish(1, memoryview(b"\0\1\0\0\xff\0\0\0")))
    publishing.publish(Publish(8, text("x")))
    first, second = await world.told()
    assert first["message"].startswith("/x: ")
    assert second["message"] == "there is no channel 8 to publish on: advertise it first"
    assert world.node.publishers["/x"][0].published == []
    await world.close()
