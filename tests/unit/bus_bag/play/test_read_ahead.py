"""Reading ahead: its bounds, restarts at another time, the latched state, errors, and the end."""

import asyncio
import threading
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from bus_bag.errors import BagError
from bus_bag.play.read_ahead import Entry, ReadAheadQueue
from bus_bag.storage import BagMessage


class Reader:
    """A bag in memory. If `gate` is given, it lets messages through one by one."""

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
async def reading(reader: Any, **options: Any) -> AsyncIterator[ReadAheadQueue]:
    made = ReadAheadQueue(
        reader, frozenset({"/a", "/map"}), options.pop("depths", {"/map": 1}), decode, **options
    )
    try:
        yield made
    finally:
        made.close()


async def take(queue: ReadAheadQueue, count: int = 1 << 30) -> list[bytes]:
    return [entry.payload for entry in await entries(queue, count)]


async def entries(queue: ReadAheadQueue, count: int = 1 << 30) -> list[Entry]:
    taken: list[Entry] = []
    while len(taken) < count:
        if queue.peek() is not None:
            taken.append(queue.pop())
        elif queue.has_ended:
            break
        else:
            await queue.wait()
    return taken


async def test_all_in_order_but_what_is_left_out() -> None:
    reader = Reader(message("/a", 3), message("/a", 1), message("/b", 2), message("/a", 2, b"bad"))
    async with reading(reader) as queue:
        assert queue.peek() is None
        queue.start_at(None)
        assert await take(queue) == [b"1", b"3"]
        assert queue.has_ended and queue.peek() is None


async def test_a_start_in_the_middle_begins_with_the_state() -> None:
    maps = [message("/map", at, sequence=at) for at in (1, 2, 5)]
    async with reading(Reader(*maps, *(message("/a", at) for at in range(10)))) as queue:
        queue.start_at(4)
        found = await entries(queue)
        assert [(one.payload, one.time, one.is_state) for one in found][:3] == [
            (b"2", 4, True),
            (b"4", 4, False),
            (b"5", 5, False),
        ]
        queue.start_at(4)
        await entries(queue, 2)
        queue.start_at(None)
        assert (await take(queue))[:3] == [b"0", b"1", b"1"]


async def test_what_is_repeated_is_left_out_also_after_a_start_in_the_middle() -> None:
    said = [
        message("/map", 1, b"map", 7),
        message("/map", 5, b"map", 7, sent=1),
        message("/map", 6, b"new", 8),
    ]
    for start, expected in ((None, [b"map", b"new"]), (3, [b"map", b"new"]), (6, [b"map", b"new"])):
        async with reading(Reader(*said)) as queue:
            queue.start_at(start)
            assert await take(queue) == expected


async def test_the_order_of_sending() -> None:
    said = [message("/a", 10, b"late", sent=5), message("/a", 11, b"early", sent=3)]
    async with reading(Reader(*said), order="publish_time") as queue:
        queue.start_at(None)
        assert [(one.payload, one.time) for one in await entries(queue)] == [(b"early", 3), (b"late", 5)]


async def test_no_more_is_read_ahead_than_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    reader = Reader(*(message("/a", at, bytes([at]) * 100) for at in range(50)))
    async with reading(reader, size=10) as queue:
        queue.start_at(None)
        await queue.wait(is_full=True)
        assert len(queue._run.entries) == 10
        assert [data[0] for data in await take(queue)] == list(range(50))
    monkeypatch.setattr("bus_bag.play.read_ahead._MOST_BYTES", 450)
    async with reading(reader, size=10) as queue:
        queue.start_at(None)
        await queue.wait(is_full=True)
        assert len(queue._run.entries) == 5
        assert [data[0] for data in await take(queue)] == list(range(50))


@pytest.mark.parametrize("size", [0, 1, 2])
async def test_one_message_at_a_time(size: int) -> None:
    async with reading(Reader(*(message("/a", at) for at in range(10))), size=size) as queue:
        queue.start_at(None)
        found = []
        end_s = time.monotonic() + 5
        while not queue.has_ended and time.monotonic() < end_s:
            if queue.peek() is not None:
                found.append(queue.pop().payload)
            await queue.wait()
        assert found == [str(at).encode() for at in range(10)]


async def test_a_new_beginning_while_the_thread_reads_or_waits_for_room() -> None:
    reader = Reader(*(message("/a", at) for at in range(100)))
    async with reading(reader, size=3) as queue:
        for start in (None, 50, 20, 90):
            queue.start_at(start)
            assert await take(queue, 2) == [str(start or 0).encode(), str((start or 0) + 1).encode()]
        reader.gate = threading.Semaphore(1)
        queue.start_at(None)
        assert await take(queue, 1) == [b"0"]
        queue.start_at(None)
        reader.gate.release(1000)
        assert len(await take(queue)) == 100


async def test_who_waits_hears_of_a_new_beginning_and_of_the_end() -> None:
    reader = Reader(message("/a", 1))
    reader.gate = threading.Semaphore(0)
    async with reading(reader) as queue:
        queue.start_at(None)
        waiting = asyncio.create_task(queue.wait())
        await asyncio.sleep(0)
        queue.start_at(None)
        await waiting
        reader.gate.release(2)
        assert await take(queue) == [b"1"]


async def test_an_error_comes_behind_what_could_be_read() -> None:
    async with reading(Reader(message("/a", 1), error=BagError("it is broken"))) as queue:
        queue.start_at(None)
        await queue.wait(is_full=True)
        assert await take(queue, 1) == [b"1"]
        with pytest.raises(BagError, match="it is broken"):
            await take(queue)


async def test_a_look_back_begins_with_the_last_message_of_each_topic_shortly_before() -> None:
    said = [message("/a", at) for at in (1, 4, 5, 7)] + [message("/map", at) for at in (2, 6)]
    async with reading(Reader(*said, message("/b", 5)), look_back=3) as queue:
        queue.start_at(6)
        assert [(one.payload, one.is_state, one.time) for one in await entries(queue)] == [
            (b"2", True, 6),  # latched, however old
            (b"5", True, 6),
            (b"6", False, 6),
            (b"7", False, 7),
        ]
        queue.start_at(1000)
        assert await take(queue) == [b"6"]
        queue.start_at(None)
        assert [one.is_state for one in await entries(queue)] == [False] * 6


async def test_a_look_back_can_be_given_up() -> None:
    reader = Reader(*[message("/a", at) for at in range(10)])
    async with reading(reader, look_back=100, depths={}) as queue:
        reader.gate = threading.Semaphore(3)
        queue.start_at(9)
        reader.gate.release(100)
        queue.start_at(8)
        assert await take(queue) == [b"7", b"8", b"9"]
