"""The order of events: pauses, outputs without room or with errors, seeks, and a bag that becomes
unreadable.
"""

import asyncio
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from time import monotonic_ns
from typing import Any

import pytest

from bus.errors import ConfigurationError
from bus.logger import get_logger
from bus_bag.errors import BagError
from bus_bag.play.options import PlayOptions
from bus_bag.play.player import Player, Span
from bus_bag.play.progress import Status
from bus_bag.play.read_ahead import ReadAheadQueue
from bus_bag.play.selection import Selection
from bus_bag.storage import BagMessage
from semantics import until

MS = 1_000_000
SPAN = Span(0, 100 * MS, True)


class Reader:
    """A bag of one topic. Its messages are numbers, each with the time at which it is due."""

    def __init__(self, *times_ms: float, error: Exception | None = None) -> None:
        self.times_ms = times_ms
        self.error = error
        self.may_read = threading.Event()
        self.may_read.set()

    def messages(self, start: int | None, topics: Any, by: str) -> Iterator[BagMessage]:
        assert self.may_read.wait(30)
        for number, at_ms in enumerate(self.times_ms):
            if (at_ns := round(at_ms * MS)) >= (start or 0):
                yield BagMessage("/a", at_ns, 0, 0, bytes([number]))
        if self.error is not None:
            raise self.error


class Output:
    """Takes published messages as soon as it has room."""

    def __init__(self) -> None:
        self.taken: list[int] = []
        self.room = asyncio.Event()
        self.room.set()
        self.error: Exception | None = None

    def publish_encoded(self, payload: bytes, *, source_time_ns: int | None = None) -> bool:
        if self.error is not None:
            raise self.error
        if self.room.is_set():
            assert source_time_ns is None
            self.taken.append(payload[0])
        return self.room.is_set()

    async def wait_for_room(self) -> None:
        await self.room.wait()


@asynccontextmanager
async def playing(reader: Any, output: Output, span: Span = SPAN, **given: Any) -> AsyncIterator[Player]:
    queue = ReadAheadQueue(reader, frozenset({"/a"}), {}, lambda one: bytes(one.data))
    options = PlayOptions(selection=Selection(), **given)
    try:
        async with Player(queue, {"/a": output}, span, options, get_logger("player")) as player:
            yield player
    finally:
        queue.close()


async def turns(count: int = 20) -> None:
    for _ in range(count):
        await asyncio.sleep(0.001)


async def test_messages_come_when_they_are_due() -> None:
    output = Output()
    async with playing(Reader(0, 20, 20, 40), output, rate=2.0) as player:
        begin_ns = monotonic_ns()
        assert await player.play()
        assert monotonic_ns() - begin_ns >= 20 * MS
        assert not await player.play()
        assert (output.taken, player.messages, player.lateness.count) == ([0, 1, 2, 3], 4, 4)
        assert not await player.play_next() and not await player.seek(0)


async def test_a_gap_is_skipped_if_it_is_long_enough() -> None:
    output = Output()
    hour = 3_600_000
    async with playing(Reader(0, 20, hour, hour + 20, 2 * hour), output, skipped_gap=50 * MS) as player:
        begin = monotonic_ns()
        assert await player.play()
        assert output.taken == [0, 1, 2, 3, 4]
        assert monotonic_ns() - begin >= 40 * MS  # the short ones are not
        assert player.bag_time >= 2 * hour * MS


async def test_a_gap_after_a_delay_is_skipped_and_the_delay_is_not() -> None:
    output = Output()
    async with playing(Reader(3_600_000), output, skipped_gap=0, delay=30 * MS) as player:
        begin = monotonic_ns()
        assert await player.play()
        assert output.taken == [0] and monotonic_ns() - begin >= 30 * MS


async def test_held_still_without_a_word() -> None:
    output = Output()
    async with playing(Reader(0, 3_600_000), output) as player:
        task = asyncio.create_task(player.play())
        while not output.taken:
            await turns(1)
        go_on = player.hold()
        at_ns = player.bag_time
        assert player.hold() is not go_on  # a pause within a pause does not end the first one
        await turns()
        assert player.bag_time == at_ns
        go_on()
        await turns()
        assert at_ns + 20 * MS <= player.bag_time and not player.is_paused
        player.stop()
        await task


async def test_an_output_without_room_is_waited_for() -> None:
    output = Output()
    output.room.clear()
    async with playing(Reader(0, 0), output) as player:
        task = asyncio.create_task(player.play())
        await turns()
        assert not output.taken
        output.room.set()
        assert await task
        assert output.taken == [0, 1]


async def test_a_message_that_cannot_be_published_is_told(caplog: pytest.LogCaptureFixture) -> None:
    output = Output()
    output.error = ConfigurationError("too large")
    async with playing(Reader(0), output) as player:
        assert await player.play()


async def test_a_bag_that_cannot_be_read_on_ends_it() -> None:
    output = Output()
    async with playing(Reader(0, 1, error=BagError("broken")), output) as player:
        with pytest.raises(BagError, match="broken"):
            await player.play()
        assert output.taken == [0, 1]


async def test_the_end_in_a_pause_waits_for_what_comes() -> None:
    output = Output()
    async with playing(Reader(0, 10), output, is_paused=True) as player:
        task = asyncio.create_task(player.play())
        assert await player.burst(0) == 2
        assert await player.burst(1) == 0
        assert (player.progress.status, player.bag_time) == (Status.PAUSED, 10 * MS)
        assert await player.seek(-5) and player.bag_time == 0
        assert await player.play_next()
        player.resume()
        assert await task
        assert output.taken == [0, 1, 0, 1]


async def test_a_delay_is_shown_and_can_be_stopped() -> None:
    output = Output()
    async with playing(Reader(0), output, delay=3_600_000 * MS) as player:
        task = asyncio.create_task(player.play())
        await turns()
        assert (player.progress.status, player.bag_time, output.taken) == (Status.DELAYED, 0, [])
        player.stop()
        await task


async def test_calls_while_it_ends_are_answered() -> None:
    output = Output()
    async with playing(Reader(0, 3_600_000), output) as player:
        task = asyncio.create_task(player.play())
        while not output.taken:
            await turns(1)
        seeking = asyncio.create_task(player.seek(5))
        await asyncio.sleep(0)
        player.stop()
        await task
        assert await seeking in (False, True)


async def test_a_seek_where_the_bag_cannot_be_read_is_answered() -> None:
    output = Output()
    reader = Reader(0, 3_600_000)
    async with playing(reader, output) as player:
        task = asyncio.create_task(player.play())
        while not output.taken:
            await turns(1)
        reader.times_ms, reader.error = (), BagError("broken")
        assert not await player.seek(5)
        with pytest.raises(BagError, match="broken"):
            await task


async def test_the_bags_time_stands_still_while_it_is_read() -> None:
    output, reader = Output(), Reader(0, 1, 2)
    reader.may_read.clear()
    async with playing(reader, output, rate=50.0) as player:
        task = asyncio.create_task(player.play())
        await turns()
        assert player.bag_time == 0
        reader.may_read.set()
        assert await task
        assert output.taken == [0, 1, 2] and player.bag_time >= 2 * MS


async def test_stopped_before_it_begins_it_publishes_nothing() -> None:
    output = Output()
    async with playing(Reader(0, 1), output) as player:
        player.stop()
        assert await player.play()
        assert not await player.play()
        assert output.taken == []


async def test_stopped_within_a_burst_it_ends_at_the_next_message() -> None:
    output = Output()
    async with playing(Reader(0, 1), output, is_paused=True) as player:
        task = asyncio.create_task(player.play())
        output.room.clear()
        bursting = asyncio.create_task(player.burst(0))
        await turns()
        assert player.progress.status is Status.BURST
        player.stop()
        output.room.set()
        assert await bursting == 1
        assert await task
        assert output.taken == [0]
        assert await player.burst(1) == 0


async def test_two_seeks_at_once_go_to_the_later_one() -> None:
    output = Output()
    async with playing(Reader(0, 10, 20, 3_600_000), output, is_paused=True) as player:
        task = asyncio.create_task(player.play())
        seeks = [asyncio.create_task(player.seek(at * MS)) for at in (5, 15)]
        assert await asyncio.gather(*seeks) == [True, True]
        assert player.bag_time == 15 * MS
        assert await player.play_next()
        assert output.taken == [2]
        player.stop()
        assert await task


async def test_a_replay_that_stays_at_its_end_plays_again_from_there() -> None:
    output, jumps = Output(), list[tuple[Status, int]]()
    async with playing(Reader(0, 10), output, Span(0, 10 * MS, True), stays_at_end=True) as player:
        task = asyncio.create_task(player.play())
        await until(lambda: player.progress.status is Status.AT_END)
        assert (output.taken, player.is_paused, player.shown_time) == ([0, 1], True, 10 * MS)
        assert not await player.play_next() and await player.burst(0) == 0
        player.resume()
        assert player.progress.status is Status.DELAYED  # on its way back
        player.on_seek = lambda: jumps.append((player.progress.status, player.bag_time))
        await until(lambda: len(output.taken) == 4)
        await until(lambda: player.progress.status is Status.AT_END)
        assert (output.taken, player.seeks) == ([0, 1, 0, 1], 1)
        assert jumps == [(Status.DELAYED, 0)], "no longer at its end"
        assert await player.seek(3_600_000 * MS)  # the end is the farthest
        assert player.shown_time == 10 * MS
        await until(lambda: player.progress.status is Status.PAUSED)
        assert await player.play_next()
        await until(lambda: player.progress.status is Status.AT_END)
        player.stop()
        assert await task


async def test_a_looping_replay_does_not_stay() -> None:
    output = Output()
    async with playing(Reader(0), output, stays_at_end=True, is_looping=True) as player:
        task = asyncio.create_task(player.play())
        await until(lambda: len(output.taken) > 2)
        player.stop()
        assert await task


@pytest.mark.parametrize(("reader", "until_ns"), [(Reader(), -1), (Reader(0), 0)], ids=["empty", "none"])
async def test_a_loop_without_messages_ends(reader: Reader, until_ns: int) -> None:
    async with playing(reader, Output(), Span(0, 100 * MS, True, until_ns), is_looping=True) as player:
        assert await asyncio.wait_for(player.play(), 10)


async def test_a_stepped_replay_is_at_its_end_after_the_last_message() -> None:
    output = Output()
    async with playing(Reader(0, 10), output, stays_at_end=True, is_paused=True) as player:
        task = asyncio.create_task(player.play())
        assert await player.play_next() and player.progress.status is Status.PAUSED
        assert await player.burst(0) == 1
        await until(lambda: player.progress.status is Status.AT_END)
        player.stop()
        assert await task


async def test_a_seek_is_announced_before_the_messages_from_there() -> None:
    output = Output()
    async with playing(Reader(0, 10, 20), output, is_paused=True) as player:
        announced: list[tuple[int, int, list[int]]] = []
        player.on_seek = lambda: announced.append((player.seeks, player.bag_time, [*output.taken]))
        task = asyncio.create_task(player.play())
        assert await player.play_next() and not announced
        assert await player.seek(10 * MS)
        player.resume()
        assert await task
        assert (output.taken, announced) == ([0, 1, 2], [(1, 10 * MS, [0])])
