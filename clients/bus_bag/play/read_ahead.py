"""Reads and decodes messages of a bag in a thread, before they are due.

Owns: the queue and its limits. The event loop takes messages from it without a lock, because each side only
writes its own fields.
"""

import asyncio
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

from bus_bag.play.latched import Identity, LatchedState
from bus_bag.storage import BagMessage, JoinedBags, Order

__all__ = ["Entry", "ReadAheadQueue"]

_MOST_BYTES = 128 << 20
"""Limit of the waiting payloads in total; a single message may be longer."""
_LOW = 0.9
"""The thread continues when the queue is at most this part of its limit."""

Decode = Callable[[BagMessage], bytes | None]


class Entry(NamedTuple):
    """A message ready to publish."""

    topic: str
    time: int
    """The due time of the message in the bag, by the order in which the bag is played."""
    publish_time: int
    payload: bytes
    is_state: bool
    """Whether it is older than the beginning of a replay from the middle, and belongs to its state."""


class _Run:
    """State of reading since the last `start_at`."""

    def __init__(self, start_ns: int | None) -> None:
        self.start_ns = start_ns
        self.entries: deque[Entry] = deque()
        self.has_ended = False
        self.is_given_up = False
        self.error: Exception | None = None
        self.room = threading.Event()
        self.is_full = False
        self.put = self.taken = 0
        """Numbers of bytes."""
        self.wanted = 0
        """Number of entries that the event loop waits for; 0: it does not wait."""


class ReadAheadQueue:
    """Reads `bags` in `order`; `depths` has the transient local topics among `topics`.

    `decode` returns the payload of a message, or None to skip it. It is called in the thread. `look_back`: as
    in PlayOptions.
    """

    def __init__(
        self,
        bags: JoinedBags,
        topics: frozenset[str],
        depths: Mapping[str, int],
        decode: Decode,
        *,
        order: Order = "log_time",
        size: int = 1000,
        look_back: int = 0,
    ) -> None:
        self._bags = bags
        self._topics = topics
        self._depths = depths
        self._decode = decode
        self._order: Order = order
        self._size = max(1, size)
        self._look_back = look_back
        self._low = max(1, int(self._size * _LOW))
        self._run = _Run(None)
        self._run.has_ended = True
        self._runs: deque[_Run | None] = deque()
        self._has_run = threading.Event()
        self._loop = asyncio.get_running_loop()
        self._news = asyncio.Event()
        self._thread = threading.Thread(target=self._work, name="reads the bag", daemon=True)
        self._thread.start()

    def start_at(self, time_ns: int | None) -> None:
        """Drop the read messages, and read from that time on. The latched state of the moment comes first.

        None: from the beginning of the bag.
        """
        self._give_up()
        self._run = _Run(time_ns)
        self._pass_on(self._run)

    def peek(self) -> Entry | None:
        """The next message; None if none has been read yet. With `has_ended`, None means the end.

        Raises the error that reading has raised.
        """
        run = self._run
        if run.entries:
            return run.entries[0]
        if run.error is not None:
            raise run.error
        return None

    def pop(self) -> Entry:
        """Remove and return the message of `peek`."""
        run = self._run
        entry = run.entries.popleft()
        run.taken += len(entry.payload)
        if run.is_full and not self._has(run, self._low, _MOST_BYTES * _LOW):
            run.is_full = False
            run.room.set()
        return entry

    @property
    def has_ended(self) -> bool:
        """Whether there are no further messages."""
        run = self._run
        return run.has_ended and not run.entries

    async def wait(self, *, is_full: bool = False) -> None:
        """Wait for a message, or with `is_full` for a full queue; or for the end.

        Cancellation leaves nothing behind.
        """
        run = self._run
        while not run.has_ended and not run.is_given_up:
            self._news.clear()
            run.wanted = self._size if is_full else 1
            if len(run.entries) >= run.wanted or run.is_full or run.has_ended:
                break
            await self._news.wait()
        run.wanted = 0

    def close(self) -> None:
        """End the thread. It ends after decoding its current message."""
        self._give_up()
        self._pass_on(None)
        self._thread.join()

    def _give_up(self) -> None:
        self._run.is_given_up = True
        self._run.room.set()
        self._news.set()

    def _pass_on(self, run: _Run | None) -> None:
        self._runs.append(run)
        self._has_run.set()

    def _has(self, run: _Run, count: int, size: float) -> bool:
        return len(run.entries) >= count or run.put - run.taken >= size

    # --- in the thread

    def _work(self) -> None:
        while True:
            self._has_run.wait()
            self._has_run.clear()
            while self._runs:
                run = self._runs.popleft()
                if run is None:
                    return
                if not run.is_given_up:
                    self._read(run)

    def _read(self, run: _Run) -> None:
        try:
            for entry in self._entries(run):
                run.put += len(entry.payload)
                run.entries.append(entry)
                if self._has(run, self._size, _MOST_BYTES):
                    self._wait_for_room(run)
                elif 0 < run.wanted <= len(run.entries):
                    self._notify(run)
                if run.is_given_up:
                    return
        except Exception as error:
            run.error = error
        run.has_ended = True
        self._notify(run)

    def _wait_for_room(self, run: _Run) -> None:
        run.room.clear()
        run.is_full = True
        self._notify(run)
        # The loop may have taken entries before it saw `is_full`. Then it did not set `room`.
        if self._has(run, self._low, _MOST_BYTES * _LOW) and not run.is_given_up:
            run.room.wait()
        run.is_full = False

    def _notify(self, run: _Run) -> None:
        if run.wanted:
            try:
                self._loop.call_soon_threadsafe(self._news.set)
            except RuntimeError:  # the loop is closed: no task waits any more
                pass

    def _entries(self, run: _Run) -> Iterator[Entry]:
        state: LatchedState[BagMessage] = LatchedState(self._depths)
        if run.start_ns is not None and self._depths:
            yield from self._state(run, run.start_ns, state)
        if run.start_ns is not None and self._look_back:
            yield from self._recent(run, run.start_ns)
        for message in self._bags.messages(run.start_ns, self._topics, self._order):
            if message.topic in self._depths and not _add(state, message):
                continue
            payload = self._decode(message)
            if payload is not None:
                yield Entry(message.topic, self._time(message), message.publish_time, payload, False)

    def _state(self, run: _Run, start_ns: int, state: LatchedState[BagMessage]) -> Iterator[Entry]:
        for message in self._bags.messages(None, frozenset(self._depths), self._order):
            if run.is_given_up:
                return
            if self._time(message) >= start_ns:
                break
            _add(state, message)
        for message in state:
            payload = self._decode(message)
            if payload is not None:
                yield Entry(message.topic, start_ns, message.publish_time, payload, True)

    def _recent(self, run: _Run, start_ns: int) -> Iterator[Entry]:
        """The last message of each other topic shortly before `start_ns`, in the order of their times."""
        found: dict[str, BagMessage] = {}
        topics = self._topics - self._depths.keys()
        for message in self._bags.messages(start_ns - self._look_back, topics, self._order):
            if run.is_given_up:
                return
            if start_ns <= self._time(message):
                break
            found[message.topic] = message
        for message in sorted(found.values(), key=self._time):
            payload = self._decode(message)
            if payload is not None:
                yield Entry(message.topic, start_ns, message.publish_time, payload, True)

    def _time(self, message: BagMessage) -> int:
        return message.log_time if self._order == "log_time" else message.publish_time


def _add(state: LatchedState[BagMessage], message: BagMessage) -> bool:
    data = bytes(message.data)  # a copy, because it may be a view of a larger piece of the file
    message.data = data
    return state.add(message.topic, Identity(message.publish_time, message.sequence, data), message)
