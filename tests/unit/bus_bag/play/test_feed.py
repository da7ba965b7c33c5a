"""What is read ahead: its bounds, new beginnings, the latched state, errors, and the end."""

import asyncio
import threading
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from bus_bag.errors import BagError
from bus_bag.play.feed import Entry, Feed
from bus_bag.storage import BagMessage


class Reader:
    """A bag in memory; `gate` lets messages through one by one where it is given."""

    def __init__(self, *messages: BagMessage, error: Exception | None = None) -> None:
        self.said = messages
        self.error = error
        self.gate: threading.Semaphore | None = None
        self.begun = 0

    def messages(self, start: int | None, topics: Any, by: str) -> Iterator[BagMessage]:
        self.begun += 1
        for one in sorted(self.said, key=lambda one: getattr(one, by)):
            if self.gate is not None:
                self.gate.acquire()
            if one.topic in topics and getattr(one, by) >= (start or 0):
                yield BagMessage(one.topic, one.log_time, one.publish_time, one.sequence, one.data)
        if self.error is not None:
            raise self.error


def message(topic: str, log_time: int, data: bytes = b"", sequence: int = 0, sent: int = 0) -> BagMessage:
    return BagMessage(topic, log_time, sent or log_time, sequence, memoryview(data or str(log_time).encode()))


def decode(one: BagMessage) -> bytes | None:
    return None if one.data == b"bad" else bytes(one.data)


@asynccontextmanager
async def reading(reader: Any, **options: Any) -> AsyncIterator[Feed]:
    made = Feed(reader, frozenset({"/a", "/map"}), options.pop("depths", {"/map": 1}), decode, **options)
    try:
        yield made
    finally:
        made.close()


async def take(feed: Feed, count: int = 1 << 30) -> list[bytes]:
    return [entry.payload for entry in await entries(feed, count)]


async def entries(feed: Feed, count: int = 1 << 30) -> list[Entry]:
    taken: list[Entry] = []
    while len(taken) < count:
        if feed.peek() is not None:
            taken.append(feed.pop())
        elif feed.has_ended:
            break
        else:
            await feed.wait()
    return taken


async def test_all_in_order_but_what_is_left_out() -> None:
    reader = Reader(message("/a", 3), message("/a", 1), message("/b", 2), message("/a", 2, b"bad"))
    async with reading(reader) as feed:
        assert feed.peek() is None
        feed.start_at(None)
        assert await take(feed) == [b"1", b"3"]
        assert feed.has_ended and feed.peek() is None


async def test_a_start_in_the_middle_begins_with_the_state() -> None:
    maps = [message("/map", at, sequence=at) for at in (1, 2, 5)]
    async with reading(Reader(*maps, *(message("/a", at) for at in range(10)))) as feed:
        feed.start_at(4)
        found = await entries(feed)
        assert [(one.payload, one.time, one.is_state) for one in found][:3] == [
            (b"2", 4, True),
            (b"4", 4, False),
            (b"5", 5, False),
        ]
        feed.start_at(4)
        await entries(feed, 2)
        feed.start_at(None)
        assert (await take(feed))[:3] == [b"0", b"1", b"1"]


async def test_what_is_repeated_is_left_out_also_after_a_start_in_the_middle() -> None:
    said = [
        message("/map", 1, b"map", 7),
        message("/map", 5, b"map", 7, sent=1),
        message("/map", 6, b"new", 8),
    ]
    for start, expected in ((None, [b"map", b"new"]), (3, [b"map", b"new"]), (6, [b"map", b"new"])):
        async with reading(Reader(*said)) as feed:
            feed.start_at(start)
            assert await take(feed) == expected


async def test_the_order_of_sending() -> None:
    said = [message("/a", 10, b"late", sent=5), message("/a", 11, b"early", sent=3)]
    async with reading(Reader(*said), order="publish_time") as feed:
        feed.start_at(None)
        assert [(one.payload, one.time) for one in await entries(feed)] == [(b"early", 3), (b"late", 5)]


async def test_no_more_is_read_ahead_than_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    reader = Reader(*(message("/a", at, bytes([at]) * 100) for at in range(50)))
    async with reading(reader, size=10) as feed:
        feed.start_at(None)
        await feed.wait(is_full=True)
        assert len(feed._run.entries) == 10
        assert [data[0] for data in await take(feed)] == list(range(50))
    monkeypatch.setattr("bus_bag.play.feed._MOST_BYTES", 450)
    async with reading(reader, size=10) as feed:
        feed.start_at(None)
        await feed.wait(is_full=True)
        assert len(feed._run.entries) == 5
        assert [data[0] for data in await take(feed)] == list(range(50))


@pytest.mark.parametrize("size", [0, 1, 2])
async def test_one_message_at_a_time(size: int) -> None:
    async with reading(Reader(*(message("/a", at) for at in range(10))), size=size) as feed:
        feed.start_at(None)
        found = []
        end_s = time.monotonic() + 5
        while not feed.has_ended and time.monotonic() < end_s:
            if feed.peek() is not None:
                found.append(feed.pop().payload)
            await feed.wait()
        assert found == [str(at).encode() for at in range(10)]


async def test_a_new_beginning_while_the_thread_reads_or_waits_for_room() -> None:
    reader = Reader(*(message("/a", at) for at in range(100)))
    async with reading(reader, size=3) as feed:
        for start in (None, 50, 20, 90):
            feed.start_at(start)
            assert await take(feed, 2) == [str(start or 0).encode(), str((start or 0) + 1).encode()]
        reader.gate = threading.Semaphore(1)
        feed.start_at(None)
        assert await take(feed, 1) == [b"0"]
        feed.start_at(None)
        reader.gate.release(1000)
        assert len(await take(feed)) == 100


async def test_who_waits_hears_of_a_new_beginning_and_of_the_end() -> None:
    reader = Reader(message("/a", 1))
    reader.gate = threading.Semaphore(0)
    async with reading(reader) as feed:
        feed.start_at(None)
        waiting = asyncio.create_task(feed.wait())
        await asyncio.sleep(0)
        feed.start_at(None)
        await waiting
        reader.gate.release(2)
        assert await take(feed) == [b"1"]


async def test_an_error_comes_behind_what_could_be_read() -> None:
    async with reading(Reader(message("/a", 1), error=BagError("it is broken"))) as feed:
        feed.start_at(None)
        await feed.wait(is_full=True)
        assert await take(feed, 1) == [b"1"]
        with pytest.raises(BagError, match="it is broken"):
            await take(feed)
