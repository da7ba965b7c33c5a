"""Topics as channels: their announcement to a client."""

import asyncio
from typing import Any

import pytest

from bus.graph import GraphEndpoint
from bus.msg.sensor_msgs import Imu
from bus.msg.std_msgs import Int32, String
from bus.schema import MessageSchema
from bus_web.foxglove import channels as module
from bus_web.foxglove.channels import Channels
from web_world import WebWorld, turns


class World(WebWorld):
    def __init__(self) -> None:
        super().__init__()
        self.channels = Channels(self.formats, self.client)

    async def update(self, *, keep: bool = False) -> list[str]:
        self.look()
        gone = self.channels.update(self.hub.subscriptions.kinds, keep=keep)
        await self.channels.advertise_new()
        return gone


def kind_of(one: GraphEndpoint) -> tuple[str, str]:
    return one.type_name, one.type_hash


def named(told: list[dict[str, Any]]) -> list[Any]:
    """The topics of announced channels, and the ids of removed ones."""
    return [
        [channel["topic"] for channel in one["channels"]] if one["op"] == "advertise" else one["channelIds"]
        for one in told
    ]


async def test_they_come_change_their_type_and_go() -> None:
    world = World()
    first = world.add("publisher", "/a", "/x", String)
    world.add("subscription", "/b", "/y", String)
    world.add("publisher", "/a", "/hidden/_topic", String)
    assert await world.update() == []
    assert named(await world.told()) == [["/x", "/y"]]
    assert world.channels.topic_of(1) == "/x"
    assert world.channels.codec_of("/x", kind_of(first)) is not None
    world.remove("/x")
    other = world.add("publisher", "/a", "/x", Int32)
    assert await world.update() == ["/x"]
    assert named(await world.told()) == [[1], ["/x"]]
    assert (world.channels.topic_of(1), world.channels.topic_of(3)) == (None, "/x")
    assert world.channels.codec_of("/x", kind_of(first)) is None
    assert world.channels.codec_of("/x", kind_of(other)) is not None
    await world.close()


async def test_after_an_outage_they_stay_but_for_those_of_another_type() -> None:
    world = World()
    for topic in ("/x", "/y"):
        world.add("publisher", "/a", topic, String)
    await world.update()
    await world.told()
    for topic in ("/x", "/y"):
        world.remove(topic)
    world.add("publisher", "/a", "/y", Int32)
    assert await world.update(keep=True) == ["/y"]
    assert await world.update() == ["/x"]
    assert named(await world.told()) == [[2], ["/y"], [1]]
    await world.close()


async def test_one_that_can_not_be_described_is_left_out_and_said_once() -> None:
    world = World()
    world.node.schemas["a/msg/B", "h"] = MessageSchema("a/msg/B", "h", b"\xc1")
    world.add("publisher", "/a", "/odd", type_name="a/msg/B", type_hash="h")
    world.add("publisher", "/a", "/gone", type_name="a/msg/C", type_hash="h")
    for _ in range(2):
        await world.update()
    (said,) = await world.told()
    assert said["message"].startswith("/odd is left out: ")
    await world.close()


async def test_many_are_told_in_portions_as_the_client_reads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_PORTION", 100)
    world = World()
    for number in range(3):
        world.add("publisher", "/a", f"/imu{number}", Imu)
    await world.told()
    world.socket.may_send.clear()
    telling = asyncio.get_running_loop().create_task(world.update())
    await turns()
    assert world.socket.sent == []
    assert not telling.done(), "it has not read the first"
    world.socket.may_send.set()
    await telling
    assert named(await world.told()) == [["/imu0"], ["/imu1"], ["/imu2"]]
    await world.close()
