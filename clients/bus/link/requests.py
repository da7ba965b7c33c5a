"""Requests that the broker has not answered yet, and the limit of their waits.

If an answer is due and the broker has sent nothing at all for ANSWER_S, it counts as hung. A busy broker
keeps sending, so requests wait for it. Independent of the content of requests and answers.
"""

import asyncio
from time import monotonic_ns
from typing import Any, Protocol

import msgspec

from bus.errors import BusError
from bus.link.heartbeat import LATE_NS
from bus.link.reach import TELL_S, no_answer, no_answer_yet
from bus.logger import get_logger

__all__ = ["ANSWER_S", "Request", "Requests"]

ANSWER_S = 10.0
"""Silence after which a broker counts as hung, if an answer is due."""

_UNREAD_S = 0.05
"""Time until the next check if this process has unread data."""

_log = get_logger("bus")


class Source(Protocol):
    """The source of answers: the connection."""

    path: str
    heard_ns: int
    """Time of the last data from the broker."""

    @property
    def is_quiet(self) -> bool:
        """Whether all received data was read."""


class Request(msgspec.Struct):
    """A request that waits for its answer."""

    answer: asyncio.Future[Any]
    since_ns: int


class Requests:
    """The waiting requests. They share one timer, because most answers come long before it."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._loop = asyncio.get_running_loop()
        self.waiting: dict[int, Request] = {}
        """Requests by number. The connection removes them itself, which saves a call for each."""
        self._timer: asyncio.TimerHandle | None = None
        self._due_ns = 0  # time of the timer
        self._stood_still_ns = 0  # until this time, requests may not have left, and answers may be unread
        self._warned_ns = 0
        """Time of the last log line about a silent broker; 0: none."""

    def begin(self, number: int) -> asyncio.Future[Any]:
        """A future for the answer to request `number`. Send it now, and remove it from `waiting` at the end.

        The future fails with TimeoutError if the broker sends nothing at all for ANSWER_S.
        """
        answer = self._loop.create_future()
        self.waiting[number] = Request(answer, monotonic_ns())
        if self._timer is None:
            self._check_in(min(TELL_S, ANSWER_S))
        return answer

    def end(self, reason: BusError) -> None:
        """Fail all requests with `reason`, because no more answers will come."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        for request in self.waiting.values():
            if not request.answer.done():
                request.answer.set_exception(reason)
            # Perhaps no call waits any more: asyncio must not report that the error was never retrieved.
            if not request.answer.cancelled():
                request.answer.exception()
        self.waiting.clear()

    def _check_in(self, time_s: float) -> None:
        self._due_ns = monotonic_ns() + int(time_s * 1e9)
        self._timer = self._loop.call_later(time_s, self._check)

    def _check(self) -> None:
        """End the waits for answers if the broker has sent nothing at all for ANSWER_S.

        After TELL_S, log that this process waits.
        """
        self._timer = None
        now_ns = monotonic_ns()
        if now_ns - self._due_ns > LATE_NS:
            self._stood_still_ns = now_ns
        source = self._source
        heard_ns = max(source.heard_ns, self._stood_still_ns)
        due_s = []
        longest_s = 0.0
        for request in self.waiting.values():
            left_s = ANSWER_S - (now_ns - max(request.since_ns, heard_ns)) / 1e9
            if request.answer.done():
                continue
            longest_s = max(longest_s, ANSWER_S - left_s)
            if left_s > 0:
                warn_s = left_s - ANSWER_S + TELL_S
                due_s.append(warn_s if 0 < warn_s < left_s else left_s)
            elif source.is_quiet:
                request.answer.set_exception(TimeoutError(no_answer(source.path, ANSWER_S)))
            else:
                due_s.append(_UNREAD_S)
        is_news = not self._warned_ns or self._warned_ns < source.heard_ns
        if is_news and due_s and longest_s >= TELL_S and source.is_quiet:
            self._warned_ns = now_ns
            _log.warning(no_answer_yet(source.path))
        if due_s:
            self._check_in(min(due_s))
