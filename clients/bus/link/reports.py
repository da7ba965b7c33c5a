"""Reports the counters of endpoints to the broker when they have changed, at most twice a second.

It reports a few endpoints at a time. A thousand at once would delay messages for milliseconds, here and at
the broker, and a thousand reports twice a second would cost more than the messages. So each of a thousand
endpoints is reported every two seconds.
"""

import asyncio
from collections.abc import Callable, Iterable

from bus.link.declarations import Counted
from bus.wire import messages as m

_REPORT_S = 0.5
_PAUSE_S = 0.1
_SOME = 64


class Reports:
    """The due reports of a link.

    `send(endpoint, frames)` sends the reports of some endpoints, `endpoint` among them. There are no frames
    if the broker knows none of them at the moment.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, send: Callable[[Counted, bytes], None]) -> None:
        self._loop = loop
        self._send = send
        self._due: set[Counted] = set()
        self._going: set[Counted] = set()  # endpoints of the present round
        self._timer: asyncio.TimerHandle | None = None
        self._has_ended = False

    def add(self, endpoint: Counted) -> None:
        """Report the changed counters of an endpoint soon."""
        self._due.add(endpoint)
        if self._timer is None:
            self._arm()

    def add_all(self, endpoints: Iterable[Counted]) -> None:
        self._due.update(endpoints)
        if self._timer is None:
            self._arm()

    def send_last(self, endpoint: Counted) -> None:
        """Send the last report of an endpoint that ends."""
        if endpoint in self._due or endpoint in self._going:
            self._send_totals([endpoint])
            self._due.discard(endpoint)
            self._going.discard(endpoint)

    def flush(self) -> None:
        """Send all due reports now, which also drops the references to their endpoints."""
        if self._timer is not None and not self._has_ended:
            self._timer.cancel()
            self._timer = None
            due = [*(self._due | self._going)]
            self._due.clear()
            self._going.clear()
            self._send_totals(due)
            if self._due:
                self._arm()

    def end(self) -> None:
        """Send all due reports, and none after that."""
        self._has_ended = True
        if self._timer is not None:
            self._timer.cancel()
            self._send_totals([*(self._due | self._going)])
        self._due.clear()
        self._going.clear()

    def _arm(self) -> None:
        if not self._has_ended:
            self._timer = self._loop.call_later(_REPORT_S, self._begin)

    def _begin(self) -> None:
        self._going, self._due = self._due, set()
        self._go_on()

    def _go_on(self) -> None:
        some = [self._going.pop() for _ in range(min(_SOME, len(self._going)))]
        try:
            self._send_totals(some)
        except BaseException:
            self._due.update(some)  # reports already sent are repeated with the same values
            raise
        finally:
            self._timer = None
            if self._going:
                self._timer = self._loop.call_later(_PAUSE_S, self._go_on)
            elif self._due:
                self._arm()

    def _send_totals(self, endpoints: list[Counted]) -> None:
        if not endpoints:
            return
        told = [(endpoint, endpoint.totals()) for endpoint in endpoints]
        for endpoint, totals in told:
            if totals.queued and endpoint.refusal is None:
                self._due.add(endpoint)  # no event reports when they are taken
        # The broker may not know some endpoints at the moment. Counting may call a user's code, which may
        # close others.
        known = [
            (endpoint, totals) for endpoint, totals in told if endpoint.id and endpoint.id == totals.endpoint
        ]
        frames = b"".join(m.encode_frame(totals) for _, totals in known)
        self._send(known[0][0] if known else endpoints[0], frames)
