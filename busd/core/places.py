"""Places of lossless subscriptions of lost processes: their publishers keep them for the lease.

The publisher keeps the samples, within its window. busd says for how long (Unmatched), and tells it at once
if the process has ended: then nothing waits for the process. The publisher may be lost, too, before it has
repeated the missed samples. If it does not come back in time, busd counts them as lost. Must not know how a
subscription that is back is handled (`busd.core.matching`).
"""

from collections import deque
from collections.abc import Callable

from bus.base.ids import EndpointId, PeerId
from bus.vocabulary import DropReason
from bus.wire.messages import Unmatched
from busd.core.drops import Drops
from busd.core.effects import Effect, Send
from busd.core.entities import Match, Publisher, Subscription
from busd.core.timers import Timers
from busd.core.work import LOOKS_PER_UNIT, TELL, Meter, Rounds

MOST = 16_384
"""Places in all. Above that, publishers go on without the subscriptions of the process lost first."""

_LOOK_NS = 50_000_000
"""So long until the first look whether the process lives, because a killed process ends a moment after its
connection. The time until the next look doubles."""
_FEW = 16

Place = tuple[Publisher, EndpointId]
"""The publisher that keeps it, and the number that the subscription had."""


class _Lost:
    """One process that was lost."""

    __slots__ = ("id", "pid", "places", "until_ns")

    def __init__(self, peer: PeerId, pid: int, until_ns: int) -> None:
        self.id = peer
        self.pid = pid
        self.until_ns = until_ns
        self.places: deque[Place] = deque()


class Places:
    """`lives` says whether a pid still has a process."""

    def __init__(
        self,
        timers: Timers,
        emit: Callable[[Effect], None],
        meter: Meter,
        drops: Drops,
        lives: Callable[[int], bool],
    ) -> None:
        self._timers = timers
        self._emit = emit
        self._meter = meter
        self._drops = drops
        self._lives = lives
        self._lost: dict[PeerId, _Lost] = {}
        self._count = 0
        # through the places of processes that have ended
        self._rounds = Rounds(timers, meter, self._release, few=_FEW, price=TELL)

    def __len__(self) -> int:
        return self._count

    def keep(self, now_ns: int, match: Match) -> int:
        """How long the publisher must keep the place of a lost subscription. Their match ends now.

        0: it keeps none, as for a process that was silent for its lease already.
        """
        publisher, peer = match.publisher, match.subscription.node.peer
        if match.acked_seq is None or publisher.history is not None or not publisher.node.peer.keeps_places:
            return 0
        lost = self._lost.get(peer.id)
        if lost is None:
            lost = self._lost[peer.id] = _Lost(peer.id, peer.pid, now_ns + peer.lease_ns)
            self._check_in(now_ns, _LOOK_NS, lost)
        lost.places.append((publisher, match.subscription.id))
        self._count += 1
        if self._count > MOST:
            self._end(now_ns, next(iter(self._lost.values())))
        return peer.lease_ns

    def await_repeated(self, now_ns: int, match: Match) -> None:
        """The process of a publisher was lost; the match ends now.

        Samples that it was to repeat come when it is back. If it does not come back in time, they are lost.
        """
        if match.is_repeated:
            publisher, subscription = match.publisher, match.subscription
            first_seq, last_seq = match.began_seq, publisher.next_seq - 1
            self._timers.add(
                now_ns + publisher.node.peer.lease_ns,
                lambda now: self._miss(now, subscription, publisher, first_seq, last_seq),
            )

    def _miss(
        self, now_ns: int, subscription: Subscription, publisher: Publisher, first_seq: int, last_seq: int
    ) -> None:
        gid, matches = publisher.gid, subscription.matches
        self._meter.left -= len(matches) // LOOKS_PER_UNIT
        count = last_seq + 1 - max(first_seq, subscription.last_seqs.get(gid, 0) + 1)
        is_there = subscription.id in subscription.node.peer.endpoints
        if is_there and count > 0 and all(match.publisher.gid != gid for match in matches.values()):
            subscription.expected_besides += count
            subscription.remember(publisher, last_seq)
            self._drops.drop(now_ns, subscription, DropReason.DISCONNECTED, count)

    def _check_in(self, now_ns: int, wait_ns: int, lost: _Lost) -> None:
        due_ns = min(now_ns + wait_ns, lost.until_ns)
        self._timers.add(due_ns, lambda now: self._check(now, wait_ns, lost))

    def _check(self, now_ns: int, wait_ns: int, lost: _Lost) -> None:
        if self._lost.get(lost.id) is not lost:
            return
        if now_ns >= lost.until_ns:  # publishers have the same time, and go on by themselves
            self._forget(lost)
        elif not self._lives(lost.pid):
            self._end(now_ns, lost)
        else:
            self._check_in(now_ns, 2 * wait_ns, lost)

    def _end(self, now_ns: int, lost: _Lost) -> None:
        self._forget(lost)
        self._rounds.begin(now_ns, None, iter(lost.places))

    def _forget(self, lost: _Lost) -> None:
        del self._lost[lost.id]
        self._count -= len(lost.places)

    def _release(self, now_ns: int, _: None, place: Place) -> None:
        publisher, number = place
        peer = publisher.node.peer
        if publisher.id in peer.endpoints:
            self._emit(Send(peer.id, Unmatched(endpoint=publisher.id, other=number, lost=True)))
