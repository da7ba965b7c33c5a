"""Subscriptions of lost processes: busd keeps accounts of the samples due by socket until they are back.

A process that loses its connection comes back when it can. Sequence numbers then show which samples of
present publishers it has missed. Only busd knows the publishers that have left meanwhile. So for each of
these, busd keeps the numbers of the first and the last sample for the subscription. The key is the gid of the
subscription, and only its user may claim the account. Owns these accounts and their bounds; routes nothing
and matches nothing.
"""

import logging
from collections.abc import Callable, Generator
from itertools import islice
from typing import TypeAlias
from weakref import WeakValueDictionary

import msgspec

from bus.base.ids import EndpointId
from bus.wire.bounds import MOST_REMEMBERED
from bus.wire.messages import AbsentRecord, Dropped
from busd.core.effects import Effect, Note, Send
from busd.core.entities import Owed, Publisher, Subscription, User
from busd.core.timers import Timers
from busd.core.work import Meter

KEEP_NS = 600_000_000_000
"""A process that is back within this time learns which samples it has missed."""
RETURN_NS = 10_000_000_000
"""How long a publisher that was lost, too, may be away until its history counts as gone."""
MOST_PER_USER = 16_384
"""Accounts kept for all subscriptions of a user; the longest absent loses its accounts first."""
MOST = 65_536
"""The same for all users together; the user with most loses first."""
LOG_AGAIN_NS = 10_000_000_000
"""At most this often, the log says how many subscriptions did not come back."""

_SOME = 64
_PAUSE_NS = 1_000_000

Key = tuple[int, str, bytes]
"""User, topic and gid of a subscription: no other user may claim what is kept for it."""
Missed = dict[bytes, tuple[int, int]]
"""As in the message Dropped."""
Steps: TypeAlias = Generator[int, int, int]
"""Like Work of busd.core.work. Returns the present time in ns."""


class _Source:
    """A publisher that absent subscriptions were matched with; one object for all of them."""

    __slots__ = ("__weakref__", "_last_seq", "has_left", "publisher")

    def __init__(self) -> None:
        self.publisher: Publisher | None = None  # as long as it is there
        self.has_left = False
        self._last_seq = 0

    @property
    def last_seq(self) -> int:
        return self._last_seq if self.publisher is None else self.publisher.next_seq - 1

    def end(self, last_seq: int, *, has_left: bool) -> None:
        self.publisher, self.has_left = None, has_left
        self._last_seq = max(self._last_seq, last_seq)


class _Account(msgspec.Struct, gc=False):
    """One publisher's samples for one absent subscription. There may be many, as of Owed."""

    owed: Owed
    source: _Source

    @property
    def has_ended(self) -> bool:
        """Whether this publisher will send nothing more, and nothing again."""
        return self.source.publisher is None and (self.source.has_left or not self.owed.is_kept)


Accounts = dict[bytes, _Account]
"""The key is the publisher's gid."""


class _Absentee:
    """One subscription that was lost."""

    __slots__ = ("accounts", "dropped", "lost_ns", "name", "user", "waited")

    def __init__(self, now_ns: int, subscription: Subscription, accounts: Accounts) -> None:
        peer = subscription.node.peer
        self.lost_ns = now_ns
        self.user: User = peer.user
        self.accounts = accounts
        self.dropped = subscription.dropped_in_all()
        self.waited = subscription.queue.count
        self.name = f"{subscription.node.full_name} of {peer.describe()} on '{subscription.topic.name}'"


class Absentees:
    """`come` and `go` are for publishers; `find`, `settle`, `lose` and `forget` for subscriptions.

    `matched` is for both, `farewell` for the end of the daemon.
    """

    def __init__(self, timers: Timers, emit: Callable[[Effect], None], meter: Meter) -> None:
        self._timers = timers
        self._meter = meter
        self._emit = emit
        self._here: dict[Key, Subscription] = {}
        self._kept: dict[int, dict[Key, _Absentee]] = {}  # by user; the longest absent first
        self._held: dict[int, int] = {}  # by user: how many accounts these have
        self._total = 0
        self._sources: WeakValueDictionary[tuple[str, bytes], _Source] = WeakValueDictionary()
        self._open: dict[EndpointId, Accounts] = {}  # of subscriptions that are back
        self._is_looking = False
        self._logged_ns: int | None = None
        self._unclaimed_in_all = self._given_up_in_all = 0
        # Not yet in the log: subscriptions that did not come back, their waiting samples, the name of the
        # last one; and subscriptions without room.
        self._lost = self._waited = self._given_up = 0
        self._last_name = ""

    def record(self) -> AbsentRecord:
        """The records kept now, and the totals of dropped records."""
        return AbsentRecord(
            subscriptions=sum(map(len, self._kept.values())),
            unclaimed=self._unclaimed_in_all,
            given_up=self._given_up_in_all,
        )

    # --- publishers

    def come(self, publisher: Publisher) -> None:
        """A publisher is there, perhaps again."""
        if source := self._sources.get((publisher.topic.name, publisher.gid)):
            source.publisher, source.has_left = publisher, False

    def go(self, publisher: Publisher) -> None:
        """A publisher is about to leave the graph: its published samples are complete."""
        source = self._sources.get((publisher.topic.name, publisher.gid))
        if source is not None and source.publisher is publisher:
            source.end(publisher.next_seq - 1, has_left=publisher.has_left)

    # --- subscriptions; methods that are Steps return the present time

    def find(self, now_ns: int, subscription: Subscription, out: list[Effect]) -> Steps:
        """Before the first match of a subscription: if it is back, report the losses that it can't know.

        For a publisher that has left, busd tells it the samples missed. For a publisher without a sample
        delivered so far, busd tells it the first number that was for it; Matched then shows the samples
        missed.
        """
        key = _key(subscription)
        if (before := self._here.get(key)) is not None:  # it is lost, but still in the graph
            now_ns = yield from self.lose(now_ns, before)
        self._here[key] = subscription
        absentee = self._kept.get(key[0], {}).get(key)
        if absentee is None:
            return now_ns
        missed: Missed = {}
        for number, (gid, account) in enumerate(absentee.accounts.items(), 1):
            owed = subscription.owed[gid] = account.owed
            if account.has_ended:
                _count_missed(subscription, gid, account, missed)
            else:
                self._open.setdefault(subscription.id, {})[gid] = account
                if owed.first_seq:
                    received_seq = subscription.last_seqs.get(gid, 0)
                    subscription.last_seqs[gid] = max(received_seq, owed.first_seq - 1)
                    missed[gid] = owed.first_seq, 0
            if number % _SOME == 0:
                now_ns = yield _SOME
        self._take(key)  # not before: it may be lost again while this is done
        subscription.dropped_before = absentee.dropped
        # Samples that may come again are not yet dropped for good.
        comes_again = subscription.takes_history or subscription.is_lossless
        explained = {} if comes_again else absentee.dropped
        if missed or explained:
            out.append(_dropped(subscription, missed, explained))
        return now_ns

    def matched(self, publisher: Publisher, subscription: Subscription) -> None:
        """Both ends may have been lost: the new match itself shows the subscription its missed samples."""
        if subscription.id in self._open and publisher.id in subscription.matches:
            self._open[subscription.id].pop(publisher.gid, None)

    def settle(self, now_ns: int, subscription: Subscription, out: list[Effect]) -> Steps:
        """It is matched with all present publishers: missed samples of other publishers will not come.

        Exception: publishers that were lost, too, may come back with their history.
        """
        if subscription.id in self._open:
            now_ns = yield from self._settle(now_ns, subscription, out.append)
            if self._open.get(subscription.id):
                self._timers.add(now_ns + RETURN_NS, lambda now: self._settle_at_last(now, subscription))
            else:
                self._open.pop(subscription.id, None)
        return now_ns

    def lose(self, now_ns: int, subscription: Subscription) -> Steps:
        """The process of a subscription ended without a goodbye: keep its accounts."""
        key = _key(subscription)
        if self._here.get(key) is not subscription:
            return now_ns  # it is back already, or was never made whole
        open_accounts = self._open.get(subscription.id, {})
        accounts: Accounts = {}
        topic = subscription.topic.name
        looked = 0
        for match in tuple(islice(subscription.matches.values(), MOST_REMEMBERED)):
            publisher, owed = match.publisher, match.owed
            if owed is not None:
                source = self._sources.setdefault((topic, publisher.gid), _Source())
                source.publisher = publisher
                accounts[publisher.gid] = _Account(owed, source)
            looked += 1
            if looked % _SOME == 0:
                now_ns = yield _SOME
        for gid, owed in [*subscription.owed.items()][::-1]:
            if len(accounts) >= MOST_REMEMBERED:
                break
            if gid not in accounts:
                account = open_accounts.get(gid)
                if account is None:
                    account = _Account(owed, self._sources.setdefault((topic, gid), _Source()))
                    if account.source.publisher is None:
                        account.source.end(subscription.last_seqs.get(gid, 0), has_left=owed.has_left)
                accounts[gid] = account
            looked += 1
            if looked % _SOME == 0:
                now_ns = yield _SOME
        if self._here.get(key) is subscription:
            self.forget(subscription)
            # Accounts already kept stay: it has not learned of them yet.
            if accounts and key not in self._kept.get(key[0], {}):
                self._keep(now_ns, key, _Absentee(now_ns, subscription, accounts))
        return now_ns

    def forget(self, subscription: Subscription) -> None:
        """A subscription leaves the graph, and will not come back as the same."""
        self._open.pop(subscription.id, None)
        key = _key(subscription)
        if self._here.get(key) is subscription:
            del self._here[key]

    def farewell(self, now_ns: int) -> None:
        """The daemon ends, and with it all accounts."""
        for key in [key for kept in self._kept.values() for key in kept]:
            self._give_up(key)
        self._logged_ns = None
        self._log_absent(now_ns)

    # --- inside

    def _keep(self, now_ns: int, key: Key, absentee: _Absentee) -> None:
        uid = key[0]
        self._kept.setdefault(uid, {})[key] = absentee
        self._held[uid] = self._held.get(uid, 0) + len(absentee.accounts)
        self._total += len(absentee.accounts)
        absentee.user.absent += 1
        while (is_full := self._held.get(uid, 0) > MOST_PER_USER) or self._total > MOST:
            loser = uid if is_full else max(self._held, key=self._held.__getitem__)
            self._give_up(next(iter(self._kept[loser])), has_room=False)
        self._log_absent(now_ns)
        self._check_at(now_ns + KEEP_NS)

    def _take(self, key: Key) -> _Absentee | None:
        kept = self._kept.get(key[0], {})
        absentee = kept.pop(key, None)
        if absentee is not None:
            absentee.user.absent -= 1
            self._held[key[0]] -= len(absentee.accounts)
            self._total -= len(absentee.accounts)
            if not kept:
                del self._kept[key[0]], self._held[key[0]]
        return absentee

    def _give_up(self, key: Key, *, has_room: bool = True) -> None:
        """Drop the accounts of a subscription that did not come back in time, or is the longest absent of too
        many.
        """
        if (absentee := self._take(key)) is None:
            return
        if not has_room:
            self._given_up += 1
            self._given_up_in_all += 1
        if absentee.waited:
            self._unclaimed_in_all += absentee.waited
            self._lost += 1
            self._waited += absentee.waited
            self._last_name = absentee.name

    def _settle(
        self,
        now_ns: int,
        subscription: Subscription,
        emit: Callable[[Effect], None],
        *,
        is_last_time: bool = False,
    ) -> Steps:
        accounts = self._open[subscription.id]
        missed: Missed = {}
        for number, (gid, account) in enumerate(tuple(accounts.items()), 1):
            publisher = account.source.publisher
            if publisher is not None and publisher.id in subscription.matches:
                del accounts[gid]
            elif publisher is None and (is_last_time or account.has_ended):
                _count_missed(subscription, gid, account, missed)
                del accounts[gid]
            if number % _SOME == 0:
                now_ns = yield _SOME
        if missed:
            emit(_dropped(subscription, missed))
        return now_ns

    def _settle_at_last(self, now_ns: int, subscription: Subscription) -> None:
        if subscription.id in self._open:
            steps = self._settle(now_ns, subscription, self._emit, is_last_time=True)
            self._go_on_settling(now_ns, subscription, steps, has_begun=False)

    def _go_on_settling(
        self, now_ns: int, subscription: Subscription, steps: Steps, *, has_begun: bool = True
    ) -> None:
        """A step at a time, between other work."""
        if subscription.id in self._open:
            try:
                self._meter.left -= steps.send(now_ns) if has_begun else next(steps)
            except StopIteration:
                self._open.pop(subscription.id, None)
            else:
                self._timers.add(now_ns, lambda now: self._go_on_settling(now, subscription, steps))

    def _check_at(self, due_ns: int) -> None:
        if not self._is_looking:
            self._is_looking = True
            self._timers.add(due_ns, self._check)

    def _check(self, now_ns: int) -> None:
        """Give up subscriptions that are absent for too long, some at a time."""
        self._is_looking = False
        late_ns = now_ns - KEEP_NS
        late = [
            key
            for kept in self._kept.values()
            for key, absentee in islice(kept.items(), _SOME)
            if absentee.lost_ns <= late_ns
        ]
        for key in late[:_SOME]:
            self._give_up(key)
        self._meter.left -= _SOME
        self._log_absent(now_ns)
        if self._kept:
            oldest_ns = min(next(iter(kept.values())).lost_ns for kept in self._kept.values())
            self._check_at(max(oldest_ns + KEEP_NS, now_ns + _PAUSE_NS))
        elif self._lost or self._given_up:
            self._check_at(now_ns + LOG_AGAIN_NS)

    def _log_absent(self, now_ns: int) -> None:
        """Log one line about all since the last line, and not too often."""
        is_soon = self._logged_ns is not None and now_ns - self._logged_ns < LOG_AGAIN_NS
        if is_soon or not (self._lost or self._given_up):
            return
        self._logged_ns = now_ns
        if self._lost:
            text = (
                f"lost subscriptions that did not come back: {self._lost} (the last: {self._last_name}); "
                f"messages kept for them: {self._waited}"
            )
            self._emit(Note(logging.WARNING, text))
        if self._given_up:
            text = (
                "no room for the counts of all lost subscriptions; dropped, the longest absent first: "
                f"{self._given_up}"
            )
            self._emit(Note(logging.WARNING, text))
        self._lost = self._waited = self._given_up = 0


def _key(subscription: Subscription) -> Key:
    return subscription.node.peer.uid, subscription.topic.name, subscription.gid


def _count_missed(subscription: Subscription, gid: bytes, account: _Account, missed: Missed) -> None:
    """Up to the publisher's last sample, the subscription has all samples, or learns now which ones it has
    missed.
    """
    owed, source = account.owed, account.source
    received_seq = max(subscription.last_seqs.pop(gid, 0), owed.first_seq - 1)
    if owed.first_seq or source.last_seq > received_seq:
        missed[gid] = owed.first_seq, source.last_seq
    subscription.last_seqs[gid] = max(received_seq, source.last_seq)
    owed.has_left = source.has_left


def _dropped(subscription: Subscription, missed: Missed, before: dict[str, int] | None = None) -> Send:
    message = Dropped(
        subscription=subscription.id,
        dropped=dict(subscription.dropped),
        missed=missed,
        before=before or {},
    )
    return Send(subscription.node.peer.id, message)
