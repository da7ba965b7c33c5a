"""Shared code of the publishers and subscribers of all systems: words, counting, stamps.

Must not know how messages are sent or received.
"""

import asyncio
import os
import traceback
from collections.abc import Awaitable, Callable
from inspect import isawaitable, iscoroutinefunction
from threading import Event, Thread
from time import monotonic_ns
from typing import Any

import msgspec

from benchmarks.work import AT_ONCE, HEAD, Arrivals, Stamped, Work, arrivals, pace, text_of
from benchmarks.worker import Parent

LAST = "the last"
"""The text of the last message if some may be lost; also the value of `Work.publish_by` for it."""

_STEP, _STEP_BYTES = 1_000, 4 << 20
_STEPS = 4


def stamped(work: Work) -> str:
    """A message with stamps, for a publisher with a timer instead of a schedule: it is due now."""
    text: str = Stamped(work.size, monotonic_ns()).now()
    return text


async def publish(
    parent: Parent, work: Work, send: Callable[[str], object], flush: Callable[[], object] = lambda: None
) -> None:
    """The publisher of a system whose `send` blocks until there is room, and reaches all subscribers.

    `send` may be a coroutine function. In a flood it may buffer messages until `flush`.
    """
    if work.publish_by == AT_ONCE:
        sent = send(stamped(work))
        if isawaitable(sent):
            await sent
        parent.tell("ready")
        await parent.wait_for("end")
        return
    parent.tell("ready")
    if work.rate:
        await parent.wait_for("go")
        await pace(send, work)
    else:
        text = text_of(work.size)
        await parent.wait_for("warm_up")
        await _flood(send, text, work.warm_up)
        flush()
        await parent.wait_for("go")
        begin_ns = monotonic_ns()
        await _flood(send, text, work.count)
        flush()
        parent.tell("sent", begin_ns=begin_ns)
    await asyncio.Event().wait()


async def _flood(send: Callable[[str], Any], text: str, count: int) -> None:
    if iscoroutinefunction(send):
        for _ in range(count):
            await send(text)
    else:
        for _ in range(count):
            send(text)


class Window:
    """Limits how far a flood may be ahead of its subscribers, for systems without flow control.

    Each subscriber confirms after every `step` messages. The publisher waits when `sent` returns True, until
    `taken` returns True.
    """

    def __init__(self, work: Work) -> None:
        self.step = max(1, min(_STEP, _STEP_BYTES // work.size))
        self._subscribers = work.subscribers
        self._ahead = 0
        self._limit = _STEPS * self.step * work.subscribers

    def sent(self) -> bool:
        """Count one more message sent to all; returns whether the publisher must wait."""
        self._ahead += self._subscribers
        return self._ahead >= self._limit

    def taken(self) -> bool:
        """Handle a confirmation of `step` messages; returns whether there is room again."""
        self._ahead -= self.step
        return self._ahead < self._limit


class Stamps:
    """Arrival times of a paced stream's messages, and the sending times in their stamps."""

    def __init__(self, work: Work) -> None:
        self._work = work
        self._heads: list[str | bytes] = []
        self._arrived_ns: list[int] = []

    def note(self, head: str | bytes) -> bool:
        """Record the arrival of a message that begins with `head`; returns whether it was the last."""
        self._arrived_ns.append(monotonic_ns())
        self._heads.append(head[:HEAD])
        return len(self._heads) == self._work.total

    async def report(self, parent: Parent) -> None:
        """Report that all messages have arrived, and on request the times. Between both, the parent reads
        clocks."""
        parent.tell("complete")
        await self.report_what_came(parent)

    async def report_when(self, all_came: Awaitable[object], parent: Parent) -> None:
        """As `report` after `all_came`, or on an earlier request: some messages may have been lost."""
        asked = asyncio.ensure_future(self.report_what_came(parent))
        done = asyncio.ensure_future(all_came)
        await asyncio.wait({asked, done}, return_when=asyncio.FIRST_COMPLETED)
        if done.done():
            parent.tell("complete")
        await asked

    async def report_what_came(self, parent: Parent) -> None:
        """Report the arrivals so far after the word `report`."""
        await parent.wait_for("report")
        parent.tell("received", at_ns=self.last_ns, **msgspec.to_builtins(self.arrivals()))

    @property
    def last_ns(self) -> int:
        """The arrival of the newest message."""
        return self._arrived_ns[-1] if self._arrived_ns else 0

    def arrivals(self) -> Arrivals:
        """The times computed from the stamps."""
        return arrivals(self._heads, self._arrived_ns, self._work)


class Taker:
    """The subscriber of a system: call `take` with each text or bytes, from any thread, until `is_done`.

    `may_lose`: the end of a flood may be lost, so the parent asks for the arrivals so far with the word
    `look`.
    """

    def __init__(self, parent: Parent, work: Work, *, may_lose: bool = False) -> None:
        self.is_done = False
        flood = self._lossy_flood if may_lose else self._flood
        self.take: Callable[[Any], None] = self._paced if work.rate else flood
        self._parent = parent
        self._work = work
        self._stamps = Stamps(work)
        self._count = 0
        self._last_ns = 0
        self._loop = asyncio.get_running_loop()
        self._done: asyncio.Future[None] = self._loop.create_future()

    async def finish(self) -> None:
        """Wait until all messages have arrived, and report."""
        if not self._work.rate:
            await self._answer()
        await self._stamps.report_when(self._done, self._parent)
        await asyncio.Event().wait()

    async def _answer(self) -> None:
        while True:
            await self._parent.wait_for("look")
            self._parent.tell("seen", end_ns=self._last_ns, count=self._count)

    def _paced(self, payload: str | bytes) -> None:
        if self._stamps.note(payload):
            self._end()

    def _flood(self, payload: object) -> None:
        self._count = count = self._count + 1
        if count == self._work.warm_up:
            self._parent.tell("warm")
        elif count == self._work.total:
            self._last_ns = monotonic_ns()
            self._parent.tell("received", end_ns=self._last_ns, count=count, dropped={})
            self._end()

    def _lossy_flood(self, payload: object) -> None:
        self._last_ns = monotonic_ns()
        self._flood(payload)

    def _end(self) -> None:
        self.is_done = True
        self._loop.call_soon_threadsafe(self._done.set_result, None)


def take_in_thread(taker: Taker, receive: Callable[[], Any]) -> None:
    """Call `receive`, which blocks, in a thread, and pass its results to `taker`.

    Only that thread works then, but the loop still notices when the parent closes stdin.
    """

    def take_all() -> None:
        take = taker.take
        try:
            while not taker.is_done:
                take(receive())
            Event().wait()  # the kernel's counters of a thread end with the thread
        except BaseException:
            traceback.print_exc()
            os._exit(1)

    Thread(target=take_all, daemon=True).start()
