"""The playback of a recording on one page."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from typing import Any

import msgspec
import pytest

from bus.msg.std_msgs import String
from bus_plot.loss_timeline import LossTimeline, Slot
from bus_web import page_playback
from bus_web.page_playback import recording_fields
from bus_web.page_protocol import Mistake
from bus_web.page_session import PageSession
from bus_web.playback import Losses, Recording, Request, Status
from semantics import until
from web_world import ListPlayback, WebWorld, turns

S = 1_000_000_000


def say(world: WebWorld, **fields: Any) -> None:
    world.socket.said.put_nowait(msgspec.json.encode({"op": "play", **fields}).decode())


def told(world: WebWorld, op: str) -> list[dict[str, Any]]:
    return [one for one in world.socket.texts() if one["op"] == op]


@asynccontextmanager
async def page(world: WebWorld, playback: ListPlayback | None) -> AsyncIterator[asyncio.Task[None]]:
    world.look()
    running = asyncio.get_running_loop().create_task(
        PageSession(world.hub, world.socket, "a bus", playback).run()
    )
    try:
        yield running
    finally:
        running.cancel()
        with suppress(asyncio.CancelledError, Mistake):
            await running
        await world.close()


async def test_requests_reach_the_player_in_their_order() -> None:
    world, playback = WebWorld(), ListPlayback()
    async with page(world, playback):
        say(world, at_s=2.5)
        say(world, rate=2.0, paused=False)
        say(world, step=True)
        await until(lambda: len(playback.asked) == 3)
        assert playback.asked == [
            Request(seek_ns=102_500_000_000),
            Request(rate=2.0, is_paused=False),
            Request(step=True),
        ]


async def test_states_and_refusals_reach_the_page() -> None:
    world, playback = WebWorld(), ListPlayback()
    async with page(world, playback):
        await until(lambda: told(world, "playback"))
        assert told(world, "recording") == [
            {"op": "recording", "name": "walk", "start_ms": 1e5, "span_s": 10, "losses": [], "more": 0}
        ]
        state = {"op": "playback", "status": "paused", "at_s": 0, "rate": 1, "messages": 0, "seeks": 0}
        assert told(world, "playback") == [state]
        playback.change(status=Status.PLAYING, at_ns=101_234_567_890, messages=3)
        playback.change()  # nothing is new
        await until(lambda: len(told(world, "playback")) == 2)
        assert told(world, "playback")[1] == state | {"status": "playing", "at_s": 1.235, "messages": 3}
        playback.refusal = "no next message"
        say(world, step=True)
        await until(lambda: told(world, "refused"))
        assert told(world, "refused") == [{"op": "refused", "text": "no next message"}]
    assert not playback.watchers


async def test_the_age_of_a_recorded_message_is_in_the_time_of_its_recording() -> None:
    world, playback = WebWorld(), ListPlayback()
    chatter = world.add("publisher", "/player", "/chatter", String)
    async with page(world, playback):
        world.socket.said.put_nowait('{"op":"look","topics":{"/chatter":[]}}')
        await until(lambda: world.node.subscriptions)
        playback.change(at_ns=104 * S)
        for number, sent_ns in enumerate((103 * S, 1000 * S)):  # the second one is not of the recording
            world.publish(chatter, String(data="hello"), sent_ns=sent_ns, came_ns=1001 * S)
            await until(lambda number=number: len(told(world, "value")) == number + 1)
        assert [one["age_ms"] for one in told(world, "value")] == [1000, 1000]


async def test_after_a_seek_no_value_from_before_comes() -> None:
    world, playback = WebWorld(), ListPlayback()
    chatter = world.add("publisher", "/player", "/chatter", String)
    async with page(world, playback):
        world.socket.said.put_nowait('{"op":"look","topics":{"/chatter":[]}}')
        await until(lambda: world.node.subscriptions)
        world.socket.may_send.clear()
        playback.change(rate=2.0)
        await turns()  # that state is on its way, and the next frames wait
        world.publish(chatter, String(data="before"))
        playback.change(seeks=1)
        world.socket.may_send.set()
        world.publish(chatter, String(data="after"))
        await until(lambda: told(world, "value"))
        ops = [one for one in world.socket.texts() if one["op"] in ("playback", "value")]
        assert [one.get("seeks", one.get("number")) for one in ops] == [0, 0, 1, 2]


async def test_a_page_that_does_not_read_gets_the_newest_state_only() -> None:
    world, playback = WebWorld(), ListPlayback()
    async with page(world, playback):
        await until(lambda: told(world, "playback"))
        world.socket.may_send.clear()
        for number in range(1, 1000):
            playback.change(at_ns=(100 + number) * S)
        await turns()
        world.socket.may_send.set()
        await until(lambda: told(world, "playback")[-1]["at_s"] == 999)
        assert len(told(world, "playback")) <= 3  # one more may have been on its way


async def test_a_page_with_too_many_requests_is_refused_some() -> None:
    world, playback = WebWorld(), ListPlayback()
    playback.may_answer.clear()
    async with page(world, playback):
        for _ in range(100):
            say(world, at_s=1)
        await until(lambda: world.socket.said.empty())
        await until(lambda: told(world, "refused"))
        assert told(world, "refused")[0]["text"] == "16 requests are waiting for the player"
        playback.may_answer.set()
        await until(lambda: len(playback.asked) >= page_playback._MOST_WAITING)
        await turns()
        assert len(playback.asked) <= page_playback._MOST_WAITING + 1


@pytest.mark.parametrize(
    ("has_bag", "fields", "text"),
    [
        (False, {"paused": True}, "no bag is played here: start bus web with --bag"),
        (True, {"at_s": -1}, ">= 0"),
        (True, {"at_s": 1e300}, "<= 1"),
        (True, {"rate": "fast"}, "float"),
        (True, {"stop": True}, "unknown field"),
    ],
)
async def test_an_invalid_request_ends_the_session(has_bag: bool, fields: dict[str, Any], text: str) -> None:
    world, playback = WebWorld(), ListPlayback() if has_bag else None
    async with page(world, playback) as running:
        say(world, **fields)
        with pytest.raises(Mistake) as caught:
            await running
        assert text in str(caught.value)
        assert playback is None or not playback.asked


def test_losses_are_bars_over_the_time_of_the_bag() -> None:
    timeline = LossTimeline.of([Slot(102, 1, {"replaced": 6}), Slot(103, 1, {"replaced": 2})], {"other": 1})
    some = {"/quiet": Losses(1, 5, LossTimeline.of([], {"other": 1})), "/imu": Losses(9, 20, timeline)}
    fields = recording_fields(Recording("walk", 100 * S + S // 2, 104 * S + S // 2, some))
    imu, quiet = fields["losses"]
    assert (imu["topic"], imu["lost"], imu["expected"], imu["earlier"]) == ("/imu", 9, 20, {"other": 1})
    assert (imu["begin_s"], imu["width_s"], imu["bars"]) == (-0.5, 1, [0, 0, 6, 2, 0])
    assert imu["bursts"] == [[1.5, 2, {"replaced": 8}]]
    assert (quiet["topic"], quiet["bars"], quiet["bursts"]) == ("/quiet", [0] * 5, [])


def test_a_long_bag_has_few_bars_and_many_topics_are_cut() -> None:
    one = Losses(1, 1, LossTimeline.of([Slot(3600, 1, {"replaced": 1})]))
    many = {f"/topic_{number:02}": one for number in range(25)}
    fields = recording_fields(Recording("day", 0, 86_400 * S, many))
    assert (len(fields["losses"]), fields["more"]) == (20, 5)
    row = fields["losses"][0]
    assert (row["topic"], row["width_s"], len(row["bars"]), sum(row["bars"])) == ("/topic_00", 720, 120, 1)


def test_a_bag_without_a_record_and_a_bag_of_one_moment() -> None:
    assert recording_fields(Recording("walk", S, S, None))["losses"] is None
    one = Losses(1, 1, LossTimeline.of([Slot(1, 1, {"replaced": 1})]))
    assert recording_fields(Recording("walk", S, S, {"/a": one}))["losses"][0]["bars"] == [1]
