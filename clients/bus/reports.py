"""Tells the broker the counters of endpoints, when they have changed, twice a second at most."""

import asyncio
from collections.abc import Callable, Iterable

from bus.declarations import Endpoint
from bus.wire import messages as m

_REPORT_S = 0.5


class Reports:
    """`send(endpoint, totals)` sends one."""

    def __init__(self, loop: asyncio.AbstractEventLoop, send: Callable[[Endpoint, m.Report], None]) -> None:
        self._loop = loop
        self._send = send
        self._due: set[Endpoint] = set()
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
        if endpoint in self._due:
            self._due.discard(endpoint)
            self._send(endpoint, endpoint.totals())

    def end(self) -> None:
        """Tell what is not yet told, and nothing more."""
        self._has_ended = True
        if self._timer is not None:
            self._timer.cancel()
            self._send_all()

    def _arm(self) -> None:
        if not self._has_ended:
            self._timer = self._loop.call_later(_REPORT_S, self._send_all)

    def _send_all(self) -> None:
        self._timer = None
        due, self._due = self._due, set()
        for endpoint in due:
            totals = endpoint.totals()
            self._send(endpoint, totals)
            if totals.queued and endpoint.refusal is None:
                self._due.add(endpoint)  # nobody says so when they are taken
        if self._due:
            self._arm()
