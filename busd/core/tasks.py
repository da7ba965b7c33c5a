"""Work for peers that is done in pieces: tasks that wait for the next turn of their peer.

A peer has one task at a time: for its request, or for the work that its end leaves. Until the task is done,
busd handles nothing else from the peer. Beside it there may be feeds (samples that wait for the peer). They
get half of each turn. Also owns the effects that are withheld from a peer while its task makes something:
first all others learn of it. Must not know what the work does.
"""

from collections import deque
from typing import Any

import msgspec

from bus.base.ids import PeerId
from bus.wire import messages as m
from busd.core.effects import Effect, Flush, Later, Send
from busd.core.entities import GRAPH, Peer
from busd.core.turns import BUDGET
from busd.core.work import UNLIMITED, Meter, Work

__all__ = ["Task", "Tasks"]


class Task(msgspec.Struct):
    """Work for a peer: to carry out `message`, or work after its end, or work for runs to it."""

    peer: Peer
    work: Work
    message: Any = None
    has_begun: bool = False


class Tasks:
    """The tasks of `peers`, and of peers that have gone. Their effects go to `out`."""

    def __init__(
        self,
        peers: dict[PeerId, Peer],
        meter: Meter,
        out: list[Effect],
    ) -> None:
        self.unfinished: dict[PeerId, Task] = {}
        """Tasks of peers, present or gone: done before their next message is handled. Opaque to the shell."""
        self.feeds: dict[PeerId, deque[Task]] = {}
        """Work done beside them, for peers that are present."""
        self.withheld: dict[PeerId, list[Effect]] = {}
        """Effects that peers do not get yet, by peer; only for peers that have a task."""
        self._peers = peers
        self._meter = meter
        self._out = out

    def has_work(self, peer_id: PeerId) -> bool:
        """Whether there is something to go on with for a peer."""
        return peer_id in self.unfinished or peer_id in self.feeds

    def do(self, now_ns: int, task: Task) -> None:
        """Do as much of a task as the meter allows; the rest is `unfinished`."""
        peer, work, meter = task.peer, task.work, self._meter
        try:
            while True:
                price = work.send(now_ns) if task.has_begun else next(work)
                task.has_begun = True
                meter.left -= price
                if meter.left <= 0:
                    self.unfinished[peer.id] = task
                    self._out.append(Later(peer.id))
                    if peer.withheld:
                        self.withheld.setdefault(peer.id, [])
                    return
        except StopIteration:
            pass
        if peer.id in self.withheld:
            self.withhold()
            self._out += self.withheld.pop(peer.id)
        peer.withheld = 0

    def begin(self, peer_id: PeerId, work: Work, *, is_first: bool = False) -> None:
        """`work` is to be done in turns of a peer, beside its requests. For a peer that has gone it is not
        done.
        """
        if (peer := self._peers.get(peer_id)) is not None:
            feeds = self.feeds.setdefault(peer_id, deque())
            (feeds.appendleft if is_first else feeds.append)(Task(peer, work))
            self._out.append(Later(peer_id))

    def feed(self, now_ns: int, peer_id: PeerId) -> None:
        """Do some of the work beside a peer's requests. The requests get half of its turn."""
        feeds, meter = self.feeds[peer_id], self._meter
        least = min(meter.left, BUDGET) // 2
        while feeds and meter.left > least:
            task = feeds.popleft()
            try:
                meter.left -= task.work.send(now_ns) if task.has_begun else next(task.work)
            except StopIteration:
                pass
            else:
                task.has_begun = True
                feeds.appendleft(task)
            if peer_id not in self.feeds:  # it was cut off
                return
        if feeds:
            self._out.append(Later(peer_id))
        else:
            del self.feeds[peer_id]

    def feed_all(self, now_ns: int) -> None:
        """Do at once all work that was begun beside requests."""
        for peer_id in tuple(self.feeds):
            while peer_id in self.feeds:
                self._meter.left = UNLIMITED
                self.feed(now_ns, peer_id)

    def drop(self, peer: Peer) -> None:
        """Forget all work begun for a peer that leaves."""
        self.unfinished.pop(peer.id, None)
        self.feeds.pop(peer.id, None)
        self.withheld.pop(peer.id, None)
        peer.withheld = 0

    def withhold(self) -> None:
        """Keep back effects that a peer must not get yet: news of an endpoint before all others know of
        it.
        """
        self._out[:] = [effect for effect in self._out if not self._is_withheld(effect)]

    def _is_withheld(self, effect: Effect) -> bool:
        if not isinstance(effect, Send | Flush):
            return False
        news = self.withheld.get(effect.peer)
        if news is None or not _concerns(effect, self._peers[effect.peer].withheld):
            return False
        news.append(effect)
        return True


def _concerns(effect: Send | Flush, number: int) -> bool:
    """Whether `effect` brings a peer news of its endpoint `number`, or of the graph (GRAPH)."""
    if isinstance(effect, Flush):
        return effect.queue.endpoint == number
    message = effect.message
    if number == GRAPH:
        return isinstance(message, m.GraphChanged)
    if isinstance(message, m.Created):
        return message.id == number
    return any(getattr(message, name, 0) == number for name in ("endpoint", "publisher", "subscription"))
