"""Tells the broker the counters of endpoints, when they have changed, twice a second at most.

Some at a time: those of a thousand at once would hold up messages for milliseconds, here and at the broker,
and twice a second each would cost more than their messages.
"""

import asyncio
from collections.abc import Callable, Iterable

from bus.declarations import Endpoint
from bus.wire import messages as m

_REPORT_S = 0.5
_PAUSE_S = 0.1
_SOME = 64


class Reports:
    """`send(endpoint, frames)` sends the reports of some endpoints, one of which is `endpoint`."""

    def __init__(self, loop: asyncio.AbstractEventLoop, send: Callable[[Endpoint, bytes], None]) -> None:
        self._loop = loop
        self._send = send
        self._due: set[Endpoint] = set()
        self._going: set[Endpoint] = set()  # their turn has come
        self._timer: asyncio.TimerHandle | None = None
        self._has_ended = False

    def add(self, endpoint: Endpoint) -> None:
        """Its counters have changed; the broker is told soon."""
        self._due.add(endpoint)
        if self._timer is None:
            self._arm()

    def add_all(self, endpoints: Iterable[Endpoint]) -> None:
        self._due.update(endpoints)
        if self._timer is None:
            self._arm()

    def send_last(self, endpoint: Endpoint) -> None:
        """The endpoint goes: what is not yet told is told now."""
        if endpoint in self._due or endpoint in self._going:
            self._tell([endpoint])
            self._due.discard(endpoint)
            self._going.discard(endpoint)

    def end(self) -> None:
        """Tell what is not yet told, and nothing more."""
        self._has_ended = True
        if self._timer is not None:
            self._timer.cancel()
            self._tell([*(self._due | self._going)])

    def _arm(self) -> None:
        if not self._has_ended:
            self._timer = self._loop.call_later(_REPORT_S, self._begin)

    def _begin(self) -> None:
        self._going, self._due = self._due, set()
        self._go_on()

    def _go_on(self) -> None:
        try:
            self._tell([self._going.pop() for _ in range(min(_SOME, len(self._going)))])
        finally:
            self._timer = None
            if self._going:
                self._timer = self._loop.call_later(_PAUSE_S, self._go_on)
            elif self._due:
                self._arm()

    def _tell(self, endpoints: list[Endpoint]) -> None:
        frames = []
        for endpoint in endpoints:
            totals = endpoint.totals()
            if endpoint.id:  # else the broker does not know it at the moment
                known = endpoint
                frames.append(m.encode_frame(totals))
            if totals.queued and endpoint.refusal is None:
                self._due.add(endpoint)  # nobody says so when they are taken
        if frames:
            self._send(known, b"".join(frames))
