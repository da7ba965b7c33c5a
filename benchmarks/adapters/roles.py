"""What the publisher and the subscriber of every system have in common: the words, the counting, the stamps.

Must not know how a message is sent or how it comes.
"""

import asyncio
from collections.abc import Callable
from time import monotonic_ns
from typing import Any

import msgspec

from benchmarks.work import HEAD, Arrivals, Work, arrivals, pace, text_of
from benchmarks.worker import Parent

LAST = "the last"
"""The text of the last message, where some may be lost; also the way `Work.publish_by` asks for that."""


def stamped(work: Work) -> str:
    """A paced message that is sent now, by who has a timer and no schedule: it is due now."""
    now_ns = monotonic_ns()
    return f"{now_ns} {now_ns} ".ljust(work.size)


async def publish(parent: Parent, work: Work, send: Callable[[str], object]) -> None:
    """The publisher of a system whose `send` blocks until there is room, and reaches the subscriber."""
    parent.tell("ready")
    if work.rate:
        await parent.wait_for("go")
        await pace(send, work)
    else:
        text = text_of(work.size)
        await parent.wait_for("warm_up")
        for _ in range(work.warm_up):
            send(text)
        await parent.wait_for("go")
        begin_ns = monotonic_ns()
        for _ in range(work.count):
            send(text)
        parent.tell("sent", begin_ns=begin_ns)
    await asyncio.Event().wait()


class Stamps:
    """When the messages of a paced stream came, and what they say of when they were sent."""

    def __init__(self, work: Work) -> None:
        self._work = work
        self._heads: list[str | bytes] = []
        self._arrived_ns: list[int] = []

    def note(self, head: str | bytes) -> bool:
        """A message that begins with `head` came now; returns whether it was the last."""
        self._arrived_ns.append(monotonic_ns())
        self._heads.append(head[:HEAD])
        return len(self._heads) == self._work.total

    async def report(self, parent: Parent) -> None:
        """Say that all came, and on request when. Between the two the parent reads clocks."""
        parent.tell("complete")
        await parent.wait_for("report")
        parent.tell("received", **msgspec.to_builtins(self.arrivals()))

    def arrivals(self) -> Arrivals:
        """What the stamps say of the way."""
        return arrivals(self._heads, self._arrived_ns, self._work)


class Taker:
    """The subscriber of a system: call `take` with each text or bytes, until `is_done`."""

    def __init__(self, parent: Parent, work: Work) -> None:
        self.is_done = False
        self.take: Callable[[Any], None] = self._paced if work.rate else self._flood
        self._parent = parent
        self._work = work
        self._stamps = Stamps(work)
        self._count = 0
        self._done: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    async def finish(self) -> None:
        """Wait until all have come, and report."""
        await self._done
        if self._work.rate:
            await self._stamps.report(self._parent)
        await asyncio.Event().wait()

    def _paced(self, payload: str | bytes) -> None:
        if self._stamps.note(payload):
            self._end()

    def _flood(self, payload: object) -> None:
        self._count = count = self._count + 1
        if count == self._work.warm_up:
            self._parent.tell("warm")
        elif count == self._work.total:
            end_ns = monotonic_ns()
            self._parent.tell("received", end_ns=end_ns, count=count, dropped={})
            self._end()

    def _end(self) -> None:
        self.is_done = True
        self._done.set_result(None)
