"""The playback of a recording for one viewer of Foxglove's protocol."""

import asyncio
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from typing import Any, NamedTuple

from bus.msg.std_msgs import String
from bus.types.classes import message_class
from bus_web.foxglove.clock import CLOCK
from bus_web.foxglove.session import Permissions, Session
from bus_web.playback import Request, Status
from semantics import until
from web_world import ListPlayback, WebWorld, turns

S = 1_000_000_000
Clock: Any = message_class("rosgraph_msgs/msg/Clock")


class Told(NamedTuple):
    """A state of playback, as sent."""

    status: int
    at_ns: int
    speed: float
    did_seek: bool
    id: str


def states(world: WebWorld) -> list[Told]:
    found: list[Told] = []
    for frame in world.socket.sent:
        if frame[0] == 5:
            status, at_ns, speed, did_seek, length = struct.unpack_from("<BQf?I", frame, 1)
            assert length == len(frame) - 19
            found.append(Told(status, at_ns, speed, did_seek, frame[19:].decode()))
    return found


def ask(
    world: WebWorld, id: str, *, pause: bool = False, speed: float = 1.0, seek_ns: int | None = None
) -> None:
    head = struct.pack("<BBfBQI", 3, pause, speed, seek_ns is not None, seek_ns or 0, len(id))
    world.socket.said.put_nowait(head + id.encode())


@asynccontextmanager
async def session(world: WebWorld, playback: ListPlayback | None) -> AsyncIterator[None]:
    world.look()
    one = Session(world.hub, world.formats, world.socket, "a bus", "id", Permissions(), playback)
    running = asyncio.get_running_loop().create_task(one.run())
    try:
        yield
    finally:
        running.cancel()
        with suppress(asyncio.CancelledError):
            await running
        await world.close()


async def test_the_server_names_the_capability_and_the_span() -> None:
    world, playback = WebWorld(), ListPlayback()
    playback.about = playback.about._replace(start_ns=S + 5, end_ns=(1 << 33) * S)
    async with session(world, playback):
        await until(lambda: states(world))
        info = world.socket.texts()[0]
        assert {"time", "playbackControl"} < set(info["capabilities"])
        assert info["dataStartTime"] == {"sec": 1, "nsec": 5}
        assert info["dataEndTime"] == {"sec": 2**32 - 1, "nsec": 0}  # a time has 32 bits of seconds
        assert states(world) == [Told(1, 100 * S, 1.0, False, "")]
    assert not playback.watchers


async def test_the_server_is_described_once_though_its_clock_comes_and_goes() -> None:
    """With a recording there is a time without a clock, too."""
    world = WebWorld()
    async with session(world, ListPlayback()):
        world.add("publisher", "/player", CLOCK, Clock)
        world.look()
        await until(lambda: CLOCK in world.node.subscriptions)
        world.remove(CLOCK)
        world.look()
        await until(lambda: world.node.subscriptions[CLOCK][0].is_closed)
        assert [one["op"] for one in world.socket.texts()].count("serverInfo") == 1


async def test_a_request_is_answered_by_the_state_after_it() -> None:
    world, playback = WebWorld(), ListPlayback()
    async with session(world, playback):
        await until(lambda: states(world))
        ask(world, "first", speed=0.1, seek_ns=105 * S)
        ask(world, "second", pause=True)
        await until(lambda: len(states(world)) == 3)
        assert playback.asked == [
            Request(seek_ns=105 * S, rate=0.1, is_paused=False),
            Request(rate=1.0, is_paused=True),
        ]
        assert [(one.id, one.did_seek) for one in states(world)[1:]] == [("first", True), ("second", False)]


async def test_changes_are_told_and_the_mere_passing_of_time_is_not() -> None:
    world, playback = WebWorld(), ListPlayback()
    async with session(world, playback):
        await until(lambda: states(world))
        for change in (
            {"status": Status.PLAYING},
            {"at_ns": 103 * S},
            {"rate": 0.5},
            {"seeks": 1, "at_ns": 101 * S, "status": Status.READING},
            {"status": Status.AT_END, "at_ns": 110 * S},
        ):
            playback.change(**change)
        await until(lambda: len(states(world)) == 5)
        assert states(world)[1:] == [
            Told(0, 100 * S, 1.0, False, ""),
            Told(0, 103 * S, 0.5, False, ""),
            Told(2, 101 * S, 0.5, True, ""),
            Told(3, 110 * S, 0.5, False, ""),
        ]


async def test_a_refusal_is_a_status_and_the_answer_has_the_state_as_it_is() -> None:
    world, playback = WebWorld(), ListPlayback()
    playback.refusal = "nan is not a rate"
    async with session(world, playback):
        ask(world, "id", speed=float("nan"))
        await until(lambda: len(states(world)) == 2)
        assert states(world)[1] == Told(1, 100 * S, 1.0, False, "id")
        said = [one for one in world.socket.texts() if one["op"] == "status"]
        assert [(one["message"], one["id"]) for one in said] == [("nan is not a rate", "playback")]


async def test_a_viewer_that_is_behind_gets_the_newest_state_later() -> None:
    world, playback = WebWorld(), ListPlayback()
    async with session(world, playback):
        await until(lambda: states(world))
        world.socket.may_send.clear()
        for number in range(1000):
            playback.change(rate=1.0 + number)
        await turns()
        world.socket.may_send.set()
        await until(lambda: states(world)[-1].speed == 1000.0)
        assert len(states(world)) < 100


async def test_each_of_too_many_requests_is_answered() -> None:
    world, playback = WebWorld(), ListPlayback()
    playback.may_answer.clear()
    async with session(world, playback):
        for number in range(100):
            ask(world, str(number), pause=True)
        await until(lambda: len(states(world)) == 1 + 100 - 64)
        playback.may_answer.set()
        await until(lambda: len(states(world)) == 1 + 100)
        assert {one.id for one in states(world)[1:]} == {str(number) for number in range(100)}
        assert len(playback.asked) == 64
        said = [one["message"] for one in world.socket.texts() if one["op"] == "status"]
        assert said == ["too many calls and questions are under way"]


async def test_messages_have_the_time_of_the_recording() -> None:
    world, playback = WebWorld(), ListPlayback()
    chatter = world.add("publisher", "/player", "/chatter", String)
    async with session(world, playback):
        await until(lambda: any(one["op"] == "advertise" for one in world.socket.texts()))
        world.socket.said.put_nowait('{"op":"subscribe","subscriptions":[{"id":9,"channelId":1}]}')
        await until(lambda: world.node.subscriptions)
        playback.change(at_ns=104 * S)
        world.publish(chatter, String(data="hello"), came_ns=5)
        await until(lambda: any(one[0] == 1 for one in world.socket.sent))
        (frame,) = [one for one in world.socket.sent if one[0] == 1]
        assert struct.unpack_from("<BIQ", frame) == (1, 9, 104 * S)


async def test_without_a_recording_a_request_is_refused_and_nothing_is_announced() -> None:
    world = WebWorld()
    async with session(world, None):
        ask(world, "id")
        await until(lambda: any(one["op"] == "status" for one in world.socket.texts()))
        info, said = (one for one in world.socket.texts() if one["op"] in ("serverInfo", "status"))
        assert said["message"] == "nothing is played here: start bus web with --bag"
        assert "playbackControl" not in info["capabilities"] and "dataStartTime" not in info
        assert states(world) == []
