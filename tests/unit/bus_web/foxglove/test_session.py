"""One client of Foxglove's protocol as a whole."""

import asyncio
import struct
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from typing import Any

import msgspec

from bus.msg.builtin_interfaces import Time
from bus.msg.std_msgs import String
from bus.types.classes import message_class
from bus_web.foxglove.session import Permissions, Session
from semantics import until
from web_world import WebWorld, turns

CLOCK: Any = message_class("rosgraph_msgs/msg/Clock")


class World(WebWorld):
    """`say` sends something to the session, and `hear` returns its answer."""

    def __init__(self) -> None:
        super().__init__()
        self.heard: list[dict[str, Any]] = []

    def say(self, op: str, **fields: Any) -> None:
        self.socket.said.put_nowait(msgspec.json.encode({"op": op, **fields}).decode())

    async def hear(self, op: str, fits: Callable[[Any], bool] = lambda told: True) -> dict[str, Any]:
        """The first answer that fits. It is newer than all answers returned before."""
        found: list[dict[str, Any]] = []

        def is_there() -> bool:
            while not found and len(self.heard) < len(self.socket.texts()):
                told = self.socket.texts()[len(self.heard)]
                self.heard.append(told)
                if told["op"] == op and fits(told):
                    found.append(told)
            return bool(found)

        await until(is_there)
        return found[0]

    async def messages(self, number: int) -> list[bytes]:
        """The binary frames, as soon as there are `number` of them."""

        def found() -> list[bytes]:
            return [one for one in self.socket.sent if not one.startswith(b"{")]

        await until(lambda: len(found()) >= number)
        return found()


@asynccontextmanager
async def session(world: World, **may: bool) -> AsyncIterator[None]:
    one = Session(world.hub, world.formats, world.socket, "a bus", "id", Permissions(**may))
    running = asyncio.get_running_loop().create_task(one.run())
    try:
        yield
    finally:
        running.cancel()
        with suppress(asyncio.CancelledError):
            await running
        await world.close()
        assert [some[-1].is_closed for some in world.node.subscriptions.values()].count(False) == 0


async def test_from_the_introduction_to_messages() -> None:
    world = World()
    chatter = world.add("publisher", "/talker", "/chatter", String)
    world.look()
    async with session(world):
        told = await world.hear("serverInfo")
        assert told["capabilities"] == ["connectionGraph", "parameters", "parametersSubscribe", "assets"]
        assert (told["sessionId"], told["name"].partition(", ")[2]) == ("id", "a bus")
        (channel,) = (await world.hear("advertise"))["channels"]
        world.say("subscribe", subscriptions=[{"id": 9, "channelId": channel["id"]}])
        await until(lambda: world.node.subscriptions)
        world.publish(chatter, String(data="hello"), came_ns=5)
        (frame,) = await world.messages(1)
        assert struct.unpack_from("<BIQ", frame) == (1, 9, 5)
        assert frame.endswith(b"hello\0")
        world.say("unsubscribe", subscriptionIds=[9, 10])
        await until(lambda: world.node.subscriptions["/chatter"][0].is_closed)
        world.say("subscribeConnectionGraph")
        told = await world.hear("connectionGraphUpdate")
        assert told["publishedTopics"] == [{"name": "/chatter", "publisherIds": ["/talker"]}]


async def test_mistakes_are_statuses() -> None:
    world = World()
    world.add("publisher", "/talker", "/chatter", String)
    world.look()
    async with session(world):
        await world.hear("advertise")
        wanted = [(1, 1), (1, 1), (2, 1), (3, 7)]
        world.say("subscribe", subscriptions=[{"id": id, "channelId": channel} for id, channel in wanted])
        told = await world.hear("status")
        assert told["message"] == "there is a subscription 1 already (and 2 more)"
        world.say("nonsense")
        assert (await world.hear("status"))["message"].startswith("not understood: ")


async def test_what_is_not_allowed_names_the_option() -> None:
    world = World()
    world.look()
    async with session(world):
        await world.hear("serverInfo")
        world.say("advertise", channels=[])
        assert "start bus web with --allow-publish" in (await world.hear("status"))["message"]
        world.say("setParameters", parameters=[{"name": "/a.b", "value": 1}], id="q")
        assert "start bus web with --allow-set" in (await world.hear("status"))["message"]
        assert (await world.hear("parameterValues"))["id"] == "q", "they are as they were"
        world.socket.said.put_nowait(b"\2" + struct.pack("<III", 1, 5, 3) + b"cdr")
        assert (await world.hear("serviceCallFailure"))["callId"] == 5
        assert "start bus web with --allow-call" in (await world.hear("status"))["message"]
        world.say("fetchAsset", uri="package://x", requestId=3)
        (missing,) = await world.messages(1)
        assert missing.endswith(b"'x' is not the name of a package")
    world = World()
    world.look()
    async with session(world, publish=True, call=True):
        told = await world.hear("serverInfo")
        assert {"clientPublish", "services"} <= {*told["capabilities"]}


async def test_where_there_is_a_clock_its_time_is_told() -> None:
    world = World()
    chatter = world.add("publisher", "/talker", "/chatter", String)
    world.look()
    async with session(world):
        (channel,) = (await world.hear("advertise"))["channels"]
        world.say("subscribe", subscriptions=[{"id": 9, "channelId": channel["id"]}])
        clock = world.add("publisher", "/sim", "/clock", CLOCK)
        world.look()
        told = await world.hear("serverInfo", lambda told: "time" in told["capabilities"])
        await until(lambda: "/clock" in world.node.subscriptions)
        world.publish(clock, CLOCK(clock=Time(sec=3, nanosec=7)))
        world.publish(chatter, String(data="x"))
        time, frame = await world.messages(2)
        assert struct.unpack("<BQ", time) == (2, 3_000_000_007)
        assert struct.unpack_from("<BIQ", frame) == (1, 9, 3_000_000_007)
        world.remove("/clock")
        world.look()
        told = await world.hear("serverInfo")
        assert "time" not in told["capabilities"]


async def test_one_that_is_slow_is_told_how_many_it_has_missed() -> None:
    world = World()
    chatter = world.add("publisher", "/talker", "/chatter", String)
    world.look()
    async with session(world):
        (channel,) = (await world.hear("advertise"))["channels"]
        world.say("subscribe", subscriptions=[{"id": 9, "channelId": channel["id"]}])
        await until(lambda: world.node.subscriptions)
        world.socket.may_send.clear()
        for _ in range(12):
            world.publish(chatter, String(data="x" * (1 << 20)))
        await turns()
        world.socket.may_send.set()
        told = await world.hear("status")
        left_out = 12 - len(await world.messages(7))
        assert told["message"] == (
            f"{left_out} messages left out, because this client reads too slowly: /chatter {left_out}"
        )


async def test_busd_is_away_and_comes_back() -> None:
    world = World()
    world.add("publisher", "/talker", "/chatter", String)
    graph = world.look()
    async with session(world):
        await world.hear("advertise")
        world.hub._lose("no answer")
        told = await world.hear("status")
        assert (told["message"], told["id"]) == ("the bus is away: no answer", "bus")
        world.remove("/chatter")
        world.look()
        assert (await world.hear("removeStatus"))["statusIds"] == ["bus"]
        assert "unadvertise" not in {one["op"] for one in world.socket.texts()}, "programs come back"
        assert graph.revision < world.hub.model.graph.revision
