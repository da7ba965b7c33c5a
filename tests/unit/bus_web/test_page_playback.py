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
            {
                "op": "recording",
                "start_ms": None,
                "span_s": 10,
                "note": "walk: the recorder lost no messages",
                "bars": [],
                "bursts": [],
            }
        ]
        state = {"op": "playback", "status": "paused", "paused": True, "at_s": 0}
        state |= {"rate": 1, "messages": 0, "seeks": 0}
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
    chatter, mark = (world.add("publisher", "/player", topic, String) for topic in ("/chatter", "/mark"))
    async with page(world, playback):
        world.socket.said.put_nowait('{"op":"look","topics":{"/chatter":[],"/mark":[]}}')
        await until(lambda: len(world.node.subscriptions) == 2)
        world.publish(mark, String(data="here"))
        await until(lambda: told(world, "value"))  # so all earlier frames have been sent
        world.socket.may_send.clear()
        playback.change(rate=2.0)
        await turns()  # that state is on its way, and the next frames wait
        world.publish(chatter, String(data="before"))
        playback.change(seeks=1)
        world.socket.may_send.set()
        world.publish(chatter, String(data="after"))
        await until(lambda: len(told(world, "value")) == 2)
        ops = [
            one for one in world.socket.texts() if one["op"] == "playback" or one.get("topic") == "/chatter"
        ]
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
    timeline = LossTimeline.of([Slot(102, 1, {"replaced": 6}), Slot(103, 1, {"replaced": 6})], {"other": 1})
    later = LossTimeline.of([Slot(104, 1, {"recorder_cache": 1000})])
    some = {
        "/quiet": Losses(1, 5, LossTimeline.of([], {"other": 1})),
        "/imu": Losses(13, 20, timeline),
        "/image": Losses(1000, 2000, later),
    }
    fields = recording_fields(Recording("walk", 100 * S, 110 * S, some))
    assert fields["note"] == (
        "walk: while recording, /image lost 1,000 of 2,000; /imu lost 13 of 20; /quiet lost 1 of 5"
    )
    assert len(fields["bars"]) == 120
    assert fields["bars"][23:25] == [0, 0.5] and round(sum(fields["bars"])) == 1012
    assert fields["bursts"] == [
        (2, "/imu lost 12 replaced in 2 s"),
        (4, "/image lost 1,000 recorder cache"),
    ]


def test_the_largest_of_many_losses_are_named() -> None:
    slots = [Slot(10 * number, 1, {"replaced": number}) for number in range(1, 50)]
    one = Losses(1225, 5000, LossTimeline.of(slots))
    small = Losses(1, 1, LossTimeline.of([Slot(3600, 1, {"replaced": 1})]))
    many = {"/imu": one, **{f"/topic_{number:02}": small for number in range(25)}}
    fields = recording_fields(Recording("day", 0, 86_400 * S, many))
    assert fields["note"].endswith("/topic_00 lost 1 of 1; /topic_01 lost 1 of 1; 23 more topics")
    assert [at_s for at_s, _ in fields["bursts"]] == [10 * number for number in range(38, 50)]


def test_a_bag_without_a_record_and_a_bag_of_one_moment() -> None:
    assert recording_fields(Recording("walk", 100_000 * S, 100_001 * S, {}))["start_ms"] == 1e8
    fields = recording_fields(Recording("walk", S, S, None))
    assert (fields["note"], fields["bars"]) == (
        "walk: it has no record of losses; only bus bag record writes one",
        [],
    )
    broken = Recording("walk", S, S, None, "the record of losses of '/a' is broken")
    assert recording_fields(broken)["note"] == "walk: the record of losses of '/a' is broken"
    early = Losses(1, 1, LossTimeline.of([Slot(0, 1, {"replaced": 1}), Slot(1, 1, {"replaced": 1})]))
    fields = recording_fields(Recording("walk", S + 5, S + 5, {"/a": early}))
    assert round(sum(fields["bars"])) == 1
    assert fields["bursts"] == [(0, "/a lost 2 replaced in 2 s")]  # from before its first message on
