"""Silence: processes that were not heard for their lease, and publishers that must not wait for them.

A silent process is there as long as its connection is: it may be busy, or stopped, and wake up. So it keeps
its nodes, endpoints and matches. But nothing waits for it: a lossless publisher goes on without its lossless
subscriptions until busd hears it again. Samples that they miss are counted at the place of the loss, as with
any slow subscription. (The leases of publishers are in `busd.core.leases`.)
"""

import logging
from collections.abc import Callable, Iterator, Mapping

from bus.base.ids import PeerId
from busd.core.effects import Effect, Note
from busd.core.entities import Match, Peer
from busd.core.matching import give_credit, report_silence
from busd.core.timers import NEVER_NS, Timers
from busd.core.work import LOOKS_PER_UNIT, TELL, Meter, Rounds

_FEW = 16
"""Matches that are gone through between two looks at other work."""


class Silences:
    """Watches `peers`. `lives` says whether a pid still has a process; `evict` cuts a peer off."""

    def __init__(
        self,
        timers: Timers,
        emit: Callable[[Effect], None],
        meter: Meter,
        *,
        peers: Mapping[PeerId, Peer],
        lives: Callable[[int], bool],
        evict: Callable[[int, Peer, str], None],
    ) -> None:
        self._timers = timers
        self._emit = emit
        self._meter = meter
        self._peers = peers
        self._lives = lives
        self._evict = evict
        self._looks: list[int] = []  # times of the looks for silent processes, the next one at the end
        # for processes that fell silent or are heard again: rounds through matches with waiting publishers
        self._rounds = Rounds(timers, meter, self._report_one, few=_FEW, price=2 * TELL)

    def watch(self, now_ns: int, peer: Peer) -> None:
        """Notice when nothing has come from `peer` for its lease."""
        self._check_at(now_ns + peer.lease_ns)

    def end(self, now_ns: int, peer: Peer) -> None:
        """It is heard again; its last message before that came at its `last_heard_ns`."""
        silent_ns = now_ns - peer.last_heard_ns
        peer.is_silent = False
        self.watch(now_ns, peer)
        text = f"{peer.describe()} is heard again, after {silent_ns / 1e9:.1f} s: "
        text += "publishers wait for it again"
        self._emit(Note(logging.INFO, text))
        self._rounds.begin(now_ns, (peer, silent_ns), _matches(peer))

    def _check_at(self, due_ns: int) -> None:
        # One timer for all: one each would keep a peer that has gone in memory to the end of its lease.
        if not self._looks or due_ns < self._looks[-1]:
            self._looks.append(due_ns)
            self._timers.add(due_ns, self._check)

    def _check(self, now_ns: int) -> None:
        while self._looks and self._looks[-1] <= now_ns:
            self._looks.pop()
        next_ns = NEVER_NS
        for peer in tuple(self._peers.values()):
            silent_ns = now_ns - peer.last_heard_ns
            left_ns = peer.lease_ns - silent_ns % peer.lease_ns
            if silent_ns >= peer.lease_ns and not self._lives(peer.pid):
                # Another process holds its connection, a child that inherited it, say.
                self._evict(now_ns, peer, f"no sign of life for {silent_ns / 1e9:.1f} s, and it has ended")
                continue
            if silent_ns >= peer.lease_ns and not peer.is_silent:
                self._begin(now_ns, peer, silent_ns)
            next_ns = min(next_ns, now_ns + left_ns)
        if next_ns < NEVER_NS:
            self._check_at(next_ns)

    def _begin(self, now_ns: int, peer: Peer, silent_ns: int) -> None:
        peer.is_silent = True
        text = (
            f"no sign of life from {peer.describe()} for {silent_ns / 1e9:.1f} s: "
            "it keeps its place, and publishers that wait for it continue without it"
        )
        self._emit(Note(logging.WARNING, text))
        self._rounds.begin(now_ns, (peer, silent_ns), _matches(peer))

    def _report_one(self, now_ns: int, news: tuple[Peer, int], match: Match) -> None:
        """Report the present state, however often this is called."""
        (peer, silent_ns), waiting = news, match.publisher.node.peer
        if match.has_ended or not match.is_lossless or peer.id not in self._peers:
            return
        if match.is_shared:
            if peer.is_silent and not waiting.hears_of_silence:  # an older program would wait for ever
                self._evict(now_ns, peer, f"no sign of life for {silent_ns / 1e9:.1f} s")
                return
        elif not peer.is_silent:
            if match.acked_seq is None:  # else it was not excused: its account goes on
                match.await_acks()
        elif match.excuse():
            self._meter.left -= len(match.publisher.awaited) // LOOKS_PER_UNIT
            give_credit(match.publisher, self._emit)
        if waiting is not peer:
            report_silence(match, silent_ns, self._emit)


def _matches(peer: Peer) -> Iterator[Match]:
    """Matches of its lossless subscriptions."""
    for subscription in peer.subscriptions():
        if subscription.is_lossless:
            yield from tuple(subscription.matches.values())
