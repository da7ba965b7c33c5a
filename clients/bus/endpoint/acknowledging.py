"""Acknowledges samples that a subscription takes from lossless publishers: many at once, few a little
later."""

import asyncio
from typing import Any, Protocol

from bus.delivery.port import Owner
from bus.delivery.receiver import Receiver
from bus.delivery.sequence import PublisherProxy
from bus.endpoint.matches import Matches
from bus.link.link import Link
from bus.wire import messages as m

__all__ = ["Acknowledging"]

_DELAY_S = 0.02


class _Subscription(Owner, Protocol):
    """The interface of the subscription for its acknowledgements."""

    link: Link
    matches: Matches
    receiver: Receiver[Any]
    held_back: frozenset[bytes]


class Acknowledging:
    """Acknowledges for `core`. Held-back publishers get no acknowledgement, and so no more room."""

    def __init__(self, core: _Subscription) -> None:
        self._core = core
        self._bytes = self._samples = 1
        """Bytes and samples that are acknowledged at once."""
        self._timer: asyncio.TimerHandle | None = None

    def set_window(self, answer: m.Created) -> None:
        """Set the thresholds from the broker's window for publishers."""
        self._bytes = answer.window_bytes // 8
        self._samples = answer.window_samples // 8

    def on_taken(self, proxy: PublisherProxy) -> None:
        """After samples of a lossless publisher were taken: acknowledge many now, few a little later."""
        samples = proxy.taken_seq - proxy.acked_seq
        if proxy.shown_gid in self._core.held_back:
            return
        if proxy.unacked_bytes >= self._bytes or samples >= self._samples:
            self._send(proxy)
        elif self._timer is None:
            self._timer = self._core.link.later(_DELAY_S, self._send_all)

    def catch_up(self, publisher_gid: bytes) -> None:
        """Acknowledge samples taken meanwhile from a publisher that is no longer held back."""
        for proxy in self._core.receiver.tracker.values():
            if proxy.shown_gid == publisher_gid and proxy.taken_seq > proxy.acked_seq:
                self.on_taken(proxy)

    def end(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def _send_all(self) -> None:
        self._timer = None
        for proxy in self._core.receiver.tracker.values():
            if proxy.taken_seq > proxy.acked_seq and proxy.shown_gid not in self._core.held_back:
                self._send(proxy)

    def _send(self, proxy: PublisherProxy) -> None:
        core = self._core
        proxy.acked_seq, proxy.unacked_bytes = proxy.taken_seq, 0
        # A departed publisher, or one of an earlier broker, needs no acknowledgement.
        if proxy.number in core.matches and core.receiver.tracker.get(proxy.number) is proxy:
            ack = m.Ack(subscription=core.id, source=proxy.number, seq=proxy.taken_seq)
            core.link.send_about(core, ack)
