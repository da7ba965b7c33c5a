"""Liveliness: publishers after the end of their lease.

Three notions stay apart: a process is connected (its socket), it is responsive (heard within the broker's
lease, see `busd.core.silence`), a publisher is alive (asserted within its own lease; ROS 2, "About Quality of
Service settings").
"""

import logging
from collections.abc import Callable
from itertools import islice

from bus.wire.messages import LivelinessChanged, LivelinessLost
from busd.core.effects import Effect, Note, Send
from busd.core.entities import Match, Peer, Publisher
from busd.core.silence import Silences
from busd.core.timers import Timers
from busd.core.work import TELL, Meter, Rounds

_FEW = 64
"""Subscriptions that learn of a publisher between two looks at other work."""
_FEWER = 16
"""Publishers that come back, the same."""


class Leases:
    """Watches leases by timers that re-arm themselves. So a sign of life costs one assignment.

    `lease_ns` is for new processes; each keeps its first lease.
    """

    def __init__(
        self,
        timers: Timers,
        emit: Callable[[Effect], None],
        meter: Meter,
        *,
        lease_ns: int,
        silences: Silences,
    ) -> None:
        self._timers = timers
        self._emit = emit
        self._meter = meter
        self.lease_ns = lease_ns
        self._silences = silences
        self._returning: set[Peer] = set()
        # for publishers whose lease ended or that are back: rounds through their subscriptions
        self._rounds = Rounds(timers, meter, self._report_one, few=_FEW, price=TELL)

    def watch_publisher(self, now_ns: int, publisher: Publisher) -> None:
        """Watch the lease of a new publisher, if it has one.

        A publisher with manual liveliness is not alive before its first sign of life.
        """
        if publisher.lease_ns and publisher.is_manual:
            publisher.is_alive = False
        elif publisher.lease_ns:
            self._check_at(now_ns, now_ns + publisher.lease_ns, publisher)

    def note_alive(self, now_ns: int, peer: Peer) -> None:
        """Anything came from `peer`: its automatic publishers are alive."""
        if peer.is_silent:
            self._silences.end(now_ns, peer)
        peer.last_heard_ns = now_ns
        if peer.lapsed and peer not in self._returning:
            self._revive_some(now_ns, peer)

    def assert_publisher(self, now_ns: int, publisher: Publisher) -> None:
        """`publisher` published, or asserted its liveliness."""
        publisher.last_sign_ns = now_ns
        if not publisher.is_alive:
            self._revive(now_ns, publisher)
        elif publisher.unaware:
            unaware, publisher.unaware = publisher.unaware, {}
            self._rounds.begin(now_ns, (publisher, True), iter(unaware.values()))

    def _check_at(self, now_ns: int, due_ns: int, publisher: Publisher) -> None:
        # A timer keeps its publisher in memory: a long lease must not keep a publisher that has gone.
        due_ns = min(due_ns, now_ns + self.lease_ns)
        self._timers.add(due_ns, lambda now: self._check_publisher(now, publisher))

    def _check_publisher(self, now_ns: int, publisher: Publisher) -> None:
        peer = publisher.node.peer
        if publisher.id not in peer.endpoints or not publisher.is_alive:
            return
        sign_ns = publisher.last_sign_ns if publisher.is_manual else peer.last_heard_ns
        if now_ns - sign_ns < publisher.lease_ns:
            self._check_at(now_ns, sign_ns + publisher.lease_ns, publisher)
            return
        publisher.is_alive = False
        publisher.unaware.clear()  # its next sign of life reaches all
        if not publisher.is_manual:
            peer.lapsed.add(publisher)
        self._emit(
            Note(logging.INFO, f"{publisher.node.full_name} lost its liveliness on '{publisher.topic.name}'")
        )
        self._emit(Send(peer.id, LivelinessLost(publisher=publisher.id)))
        self._report(now_ns, publisher)

    def _revive_some(self, now_ns: int, peer: Peer) -> None:
        for publisher in tuple(islice(peer.lapsed, _FEWER)):
            self._revive(now_ns, publisher)
        self._meter.left -= TELL * _FEWER
        self._returning.discard(peer)
        if peer.lapsed:
            self._returning.add(peer)
            self._timers.add(now_ns, lambda now: self._revive_some(now, peer))

    def _revive(self, now_ns: int, publisher: Publisher) -> None:
        publisher.is_alive = True
        publisher.node.peer.lapsed.discard(publisher)
        self._check_at(now_ns, now_ns + publisher.lease_ns, publisher)
        self._report(now_ns, publisher)

    def _report(self, now_ns: int, publisher: Publisher) -> None:
        matches = iter(tuple(publisher.matches.values()))
        self._rounds.begin(now_ns, (publisher, publisher.is_alive), matches)

    def _report_one(self, now_ns: int, news: tuple[Publisher, bool], match: Match) -> None:
        if not match.has_ended:
            subscription, (publisher, is_alive) = match.subscription, news
            message = LivelinessChanged(subscription=subscription.id, publisher=publisher.id, alive=is_alive)
            self._emit(Send(subscription.node.peer.id, message))
