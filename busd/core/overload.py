"""Choice of samples to drop if a process, or all processes of a user, hold too many bytes of samples.

Among a user's processes, the process with most bytes loses. Its longest queues lose their runs first, the
oldest of each, up to the newest. Then they lose the newest, too, except the run that has just come. So a
single message of any size gets through.
"""

from collections import deque
from collections.abc import Callable, Iterable
from functools import partial
from typing import TypeVar

from bus.base.ids import PeerId
from bus.vocabulary import DropReason
from bus.wire.runs import Account, Run, RunQueue
from busd.core.drops import Drops
from busd.core.effects import Effect
from busd.core.entities import Holder, Peer, Publisher, Subscription
from busd.core.quotas import Quotas
from busd.core.work import RUNS_AT_ONCE, RUNS_PER_UNIT, Work

_MANY_QUEUES = 64
_MOST_DROPPED = 1024
"""Runs that a queue drops one by one for its quota: they take at most a millisecond."""

_T = TypeVar("_T")


class Overload:
    """Keeps queues and histories within the accounts that they are charged to.

    `begin` has work done in the turns of a peer.
    """

    def __init__(
        self,
        quotas: Quotas,
        drops: Drops,
        emit: Callable[[Effect], None],
        begin: Callable[[PeerId, Work], None],
    ) -> None:
        self._quotas = quotas
        self._drops = drops
        self._emit = emit
        self._begin = begin

    def bound_all(self, now_ns: int, peers: Iterable[Peer]) -> None:
        """After the limits have changed."""
        for peer in peers:
            for subscription in peer.subscriptions()[:1]:
                self.bound(now_ns, subscription)
            for publisher in peer.publishers()[:1]:
                self.bound_history(now_ns, publisher)

    def bound(self, now_ns: int, subscription: Subscription) -> None:
        """Drop samples that wait for the subscription's process, while the process or its user is over its
        quota.
        """
        peer = subscription.node.peer
        if peer.queued.is_over or peer.user.queued.is_over:
            _relieve(peer, lambda one: one.queued, partial(self._drop_queued, now_ns, subscription))

    def bound_history(self, now_ns: int, publisher: Publisher) -> None:
        """The same for the histories of the publisher's process. That costs no present subscription a
        sample."""
        peer = publisher.node.peer
        if peer.history.is_over or peer.user.history.is_over:
            _relieve(peer, lambda one: one.history, partial(self._drop_history, now_ns, publisher))

    def _drop_queued(self, now_ns: int, latest: Subscription, peer: Peer, account: Account) -> None:
        def drop(one: Subscription, spare: int, slack: int) -> None:
            queue = one.queue
            too_much = partial(
                queue.drop_over_quota, spare=spare, account=account, slack=slack, most=_MOST_DROPPED
            )
            self._drops.shed(now_ns, one, DropReason.MEMORY_LIMIT, too_much)
            self._forget_rest(peer, queue)

        self._quotas.report_bytes(now_ns, peer, "bytes queued for", account, self._emit)
        longest_first = sorted(peer.subscriptions(), key=lambda one: one.queue.held_bytes, reverse=True)
        spared = latest if latest.queue.runs or not longest_first else longest_first[0]
        _drop_longest(account, longest_first, spared, drop)

    def _drop_history(self, now_ns: int, latest: Publisher, peer: Peer, account: Account) -> None:
        def drop(one: RunQueue, spare: int, slack: int) -> None:
            one.drop_over_quota(spare=spare, account=account, slack=slack, most=_MOST_DROPPED)
            self._forget_rest(peer, one)

        self._quotas.report_bytes(now_ns, peer, "bytes of history of", account, self._emit)
        histories = [one.history for one in peer.publishers() if one.history is not None]
        histories.sort(key=lambda one: one.held_bytes, reverse=True)
        _drop_longest(account, histories, latest.history, drop)

    def _forget_rest(self, peer: Peer, queue: RunQueue) -> None:
        """Free dropped runs in pieces: to free hundreds of thousands takes long."""
        if queue.rest:
            rest, queue.rest = queue.rest, deque()
            self._begin(peer.id, _free(rest))


def _free(runs: deque[Run]) -> Work:
    while runs:
        for _ in range(min(len(runs), RUNS_AT_ONCE)):
            runs.popleft()
        yield RUNS_AT_ONCE // RUNS_PER_UNIT


def _relieve(
    peer: Peer, account_of: Callable[[Holder], Account], relieve: Callable[[Peer, Account], None]
) -> None:
    """`relieve` the process while it is over its account; then its user, the processes with most first."""
    if (own := account_of(peer)).is_over:
        relieve(peer, own)
    whole = account_of(peer.user)
    if whole.is_over:
        for one in sorted(peer.user.peers.values(), key=lambda one: account_of(one).used, reverse=True):
            relieve(one, whole)
            if not whole.is_over:
                break


def _drop_longest(
    account: Account, longest_first: list[_T], spared: _T | None, drop: Callable[[_T, int, int], None]
) -> None:
    """`drop` from each, longest first, all but its newest run; then the newest, too, except the run of
    `spared`.
    """
    # The search for the longest queues costs work. With many queues, busd drops some more at once.
    slack = account.limit // 16 if len(longest_first) > _MANY_QUEUES else 0
    for spare in (1, 0):
        for one in longest_first:
            if not account.is_over:
                return
            if spare or one is not spared:
                drop(one, spare, slack)
