"""The hot path: a run of samples from a publisher to the queues of its matched subscriptions.

Costs one step per run and subscription, whatever the number of samples in the run; no payload is decoded. If
there are many subscriptions, the publisher's turn pays for one step per run and *process*. Then each process
hands the run to its subscriptions in its own turns (`busd.core.crowd`). A queue that a run overfills is not
trimmed at once. The shell first sends as much as the subscriber's socket takes, then calls `trim`. So a
subscriber that keeps up loses nothing to batching.
"""

from collections.abc import Callable, Iterable
from itertools import islice

from bus.base.ids import EndpointId, PeerId
from bus.errors import RemoteProtocolError
from bus.vocabulary import DropReason
from bus.wire.layout import MAX_RUN_SAMPLES, RECORD_HEAD_BYTES
from bus.wire.runs import Run
from busd.core.crowd import NOT_SENT, Crowd, Loss, News
from busd.core.drops import Drops
from busd.core.effects import Effect
from busd.core.entities import Match, Peer, Publisher, Subscription
from busd.core.match import MatchEvent, MatchState
from busd.core.matching import give_credit, release
from busd.core.overload import Overload
from busd.core.work import (
    FRAME,
    LOOKS_PER_UNIT,
    QUEUES_PER_UNIT,
    SAMPLES_PER_UNIT,
    STAMPS_PER_UNIT,
    TELL,
    Meter,
    Work,
)

_MANY_QUEUES = 64
_FEW = 32
"""Subscriptions that get a waiting run between two looks at other work."""


class Router:
    """Routes runs; owns the queues that are over their bound at the moment.

    `begin` has work done in the turns of a process.
    """

    def __init__(
        self,
        emit: Callable[[Effect], None],
        drops: Drops,
        overload: Overload,
        meter: Meter,
        begin: Callable[[PeerId, Work], None],
        *,
        window_bytes: int,
        window_samples: int,
    ) -> None:
        self._emit = emit
        self._drops = drops
        self._overload = overload
        self._meter = meter
        self._begin = begin
        self._credit_bytes = window_bytes // 8
        self._credit_samples = window_samples // 8
        self._overfull: list[Subscription] = []

    @property
    def is_overfull(self) -> bool:
        """Whether `trim` is to be called."""
        return bool(self._overfull)

    def reconfigure(self, *, window_bytes: int, window_samples: int) -> None:
        """Give credit by other windows from now on."""
        # Publishers that are there keep their window: credit must come as often as that needs.
        self._credit_bytes = min(self._credit_bytes, window_bytes // 8)
        self._credit_samples = min(self._credit_samples, window_samples // 8)

    def route(self, now_ns: int, publisher: Publisher, run: Run, out: list[Effect]) -> None:
        """Queue `run` for every matched subscription.

        Raises RemoteProtocolError if the publisher's numbers go back, or a run claims too many samples.
        """
        size = len(run.body)
        payload_bytes = size - run.count * RECORD_HEAD_BYTES
        if payload_bytes < 0:
            raise RemoteProtocolError(f"data frame claims {run.count} samples in {size} bytes")
        if run.count > MAX_RUN_SAMPLES:
            raise RemoteProtocolError(
                f"data frame of {run.count} samples, a run has {MAX_RUN_SAMPLES} at most"
            )
        if run.only_for:
            self._catch_up(now_ns, publisher, run, out)
            return
        gap = run.first_seq - publisher.next_seq
        if gap < 0:
            raise RemoteProtocolError(
                f"publisher {publisher.id} sent sample {run.first_seq} after {publisher.next_seq - 1}"
            )
        publisher.next_seq = run.first_seq + run.count
        publisher.samples += run.count
        publisher.bytes += payload_bytes
        routed = publisher.routed
        self._meter.left -= FRAME + run.count // SAMPLES_PER_UNIT
        is_resumed, run.is_resumed = run.is_resumed, False  # of no concern to subscriptions
        if publisher.crowds or len(routed) > _MANY_QUEUES:
            self._gather(publisher)
        limit = publisher.max_message_bytes
        if payload_bytes > limit and self._is_too_large(run, limit):
            self._refuse_all(now_ns, publisher, run.count, gap, is_loss=not is_resumed)
            return
        run.source = publisher.id
        run.lifespan_ns = publisher.lifespan_ns
        history = publisher.history
        if history is not None and history.append(run):
            if history.trim():
                self._meter.left -= history.steps // STAMPS_PER_UNIT
            self._overload.bound_history(now_ns, publisher)
        if publisher.crowds:
            self._fan_out(now_ns, publisher, run, gap, out, is_loss=not is_resumed)
        else:
            if gap:
                self.miss(now_ns, publisher, gap, routed.values(), is_loss=not is_resumed)
            for subscription in routed.values():
                queue = subscription.queue
                if queue.append(run):
                    self._overfull.append(subscription)
                if not queue.is_ready:
                    out.append(subscription.flush)
        if publisher.ahead:
            self._admit(now_ns, publisher, run, out, is_loss=not is_resumed)
        if publisher.is_credit_ahead:
            give_credit(publisher, out.append)
        elif publisher.is_lossless and not publisher.awaited:
            publisher.uncredited_bytes += size
            if (
                publisher.uncredited_bytes >= self._credit_bytes
                or publisher.next_seq - publisher.credited > self._credit_samples
            ):
                give_credit(publisher, out.append)

    def passed_on(self, publisher: Publisher, first_seq: int, count: int, size: int) -> bool:
        """Count a run of `size` bytes, which the shell passes on to its only taker.

        False if only `route` can do it; then nothing is done.
        """
        payload_bytes = size - count * RECORD_HEAD_BYTES
        if (
            first_seq != publisher.next_seq
            or count > MAX_RUN_SAMPLES
            or not 0 <= payload_bytes <= publisher.max_message_bytes
        ):
            return False
        publisher.next_seq = first_seq + count
        publisher.samples += count
        publisher.bytes += payload_bytes
        self._meter.left -= FRAME + count // SAMPLES_PER_UNIT
        return True

    def _gather(self, publisher: Publisher) -> None:
        """Make `publisher.crowds` if its subscriptions are many, and remove them if not."""
        crowds, routed = publisher.crowds, publisher.routed
        if len(routed) <= _MANY_QUEUES:
            if not any(one.has_news or one.is_due for one in crowds.values()):
                crowds.clear()
        elif not crowds:
            self._meter.left -= len(routed) // LOOKS_PER_UNIT
            for subscription in routed.values():
                publisher.join_crowd(subscription, 0)

    def _fan_out(
        self, now_ns: int, publisher: Publisher, run: Run, gap: int, out: list[Effect], *, is_loss: bool
    ) -> None:
        """Queue `run` once for each process; a process with one subscription gets it at once."""
        crowds = publisher.crowds
        for peer, crowd in crowds.items():
            if len(crowd.members) == 1 and not crowd.has_news:
                subscription = publisher.routed[next(iter(crowd.members))]
                if gap:
                    self.miss(now_ns, publisher, gap, (subscription,), is_loss=is_loss)
                if subscription.queue.append(run):
                    self._overfull.append(subscription)
                out.append(subscription.flush)
            else:
                if gap:
                    crowd.lose(_reason(is_loss=is_loss), run.first_seq - gap, run.first_seq)
                crowd.append(run)
                self._make_due(publisher, peer, crowd)
        self._meter.left -= len(crowds) // QUEUES_PER_UNIT

    def _make_due(self, publisher: Publisher, peer: PeerId, crowd: Crowd) -> None:
        if not crowd.is_due:
            crowd.is_due = True
            self._begin(peer, self._hand_over(publisher, crowd))

    def _hand_over(self, publisher: Publisher, crowd: Crowd) -> Work:
        """Hand the waiting runs of a crowd to its members, in turns of their process, a few at a time."""
        now_ns = yield 0
        while (news := next(crowd.news(), None)) is not None:
            end_seq = _end_seq(news)
            members = iter(tuple(crowd.members))
            while few := list(islice(members, _FEW)):
                for number in few:
                    if (cursor := crowd.members.get(number, end_seq)) < end_seq:
                        match = publisher.matches[number]
                        self._hand(now_ns, match, max(cursor, news.first_seq), news, end_seq)
                        crowd.members[number] = end_seq
                now_ns = yield TELL * len(few)
            crowd.done(news, end_seq)
        crowd.is_due = False

    def _hand(self, now_ns: int, match: Match, first_seq: int, news: News, end_seq: int) -> None:
        """Hand the part of `news` between these numbers to one subscription."""
        subscription = match.subscription
        if isinstance(news, Run):
            part = news if first_seq == news.first_seq else news.after(first_seq - 1)
            if subscription.queue.append(part):
                self._overfull.append(subscription)
            self._emit(subscription.flush)
        elif news.reason == NOT_SENT:
            self.miss(now_ns, match.publisher, end_seq - first_seq, (subscription,), is_loss=False)
        else:
            self._lose(now_ns, match, news.reason, end_seq - first_seq, end_seq - 1)

    def settle(self, now_ns: int, match: Match) -> None:
        """Hand a subscription its waiting runs in a crowd: its match is about to end."""
        publisher, number = match.publisher, match.subscription.id
        crowd = publisher.crowds.get(match.subscription.node.peer.id)
        if crowd is None or number not in crowd.members:
            return
        for news in crowd.news():
            end_seq, cursor = _end_seq(news), crowd.members[number]
            if cursor < end_seq:
                self._hand(now_ns, match, max(cursor, news.first_seq), news, end_seq)
                crowd.members[number] = end_seq

    def _refuse_all(self, now_ns: int, publisher: Publisher, count: int, gap: int, *, is_loss: bool) -> None:
        """One of the `count` samples of a run is too large: no subscription gets any."""
        if publisher.crowds:
            first_seq = publisher.next_seq - count
            for peer, crowd in publisher.crowds.items():
                if gap:
                    crowd.lose(_reason(is_loss=is_loss), first_seq - gap, first_seq)
                crowd.lose(DropReason.TOO_LARGE, first_seq, publisher.next_seq)
                self._make_due(publisher, peer, crowd)
            return
        if gap:
            self.miss(now_ns, publisher, gap, publisher.routed.values(), is_loss=is_loss)
        for number in publisher.routed:
            self._lose(now_ns, publisher.matches[number], DropReason.TOO_LARGE, count, publisher.next_seq - 1)

    def _lose(self, now_ns: int, match: Match, reason: str, count: int, last_seq: int) -> None:
        """`count` samples up to `last_seq` don't come to the subscription, nor will their acknowledgement."""
        self._drops.drop(now_ns, match.subscription, reason, count)
        if match.publisher.id not in _sources(match.subscription):
            release(match, last_seq, self._emit)

    def trim(self, now_ns: int) -> None:
        """Bring the overfull queues within their bounds: oldest samples first, each counted.

        Expired samples go first, but only as many as necessary, so a full queue costs no more.
        """
        for subscription in self._overfull:
            queue = subscription.queue
            if subscription in subscription.node.peer.perishable:
                while queue.is_overfull and (price := self._drops.expire(now_ns, subscription)):
                    self._meter.left -= price
            self._meter.left -= self._drops.replace(now_ns, subscription)
            self._overload.bound(now_ns, subscription)
        self._overfull.clear()

    def expire(self, now_ns: int, peer: Peer) -> None:
        """Drop samples that outlived their lifespan while they waited for `peer`. Stops with the meter."""
        meter = self._meter
        meter.left -= len(peer.perishable) // QUEUES_PER_UNIT
        for subscription in peer.perishable:
            while meter.left > 0 and (price := self._drops.expire(now_ns, subscription)):
                meter.left -= price

    def report_drops(self, peers: Iterable[Peer]) -> None:
        """Report to each subscription the drops that are not reported yet."""
        for peer in peers:
            for subscription in peer.subscriptions():
                if subscription.is_drop_report_due:
                    self._drops.report(subscription)

    def _catch_up(self, now_ns: int, publisher: Publisher, run: Run, out: list[Effect]) -> None:
        """A run for one subscription, of samples that the others had before; as `route`."""
        self._meter.left -= FRAME + run.count // SAMPLES_PER_UNIT
        match = publisher.matches.get(EndpointId(run.only_for))
        if match is None or match.is_shared or match.state is MatchState.LEAVING:
            return  # the match has ended, or was never rerouted
        subscription = match.subscription
        if run.first_seq + run.count > publisher.next_seq and not publisher.has_shared:
            # A subscription would acknowledge samples that were never published, and busd would cut it off
            # for that.
            raise RemoteProtocolError(
                f"publisher {publisher.id} resent sample {run.first_seq + run.count - 1}, "
                f"the last one is {publisher.next_seq - 1}"
            )
        subscription.expected_besides += run.count
        if match.is_repeated:
            self._pass_over(now_ns, match, run.first_seq)
            match.began_seq = max(match.began_seq, run.first_seq + run.count)
        if match.state is MatchState.CATCHING_UP:
            subscription.remember(publisher, run.first_seq + run.count - 1)
        if self._is_too_large(run, publisher.max_message_bytes):
            self._lose(now_ns, match, DropReason.TOO_LARGE, run.count, run.first_seq + run.count - 1)
            return
        run.source = publisher.id
        run.lifespan_ns = publisher.lifespan_ns
        run.is_resumed = False
        if subscription.queue.append(run):
            self._overfull.append(subscription)
        out.append(subscription.flush)

    def caught_up(self, now_ns: int, match: Match) -> None:
        """The publisher has sent all samples that the subscription missed. From now on, it gets the samples
        for all.
        """
        self.give_up_repeated(now_ns, match)
        match.begin_routing()

    def give_up_repeated(self, now_ns: int, match: Match) -> None:
        """The publisher sends nothing again any more: samples that did not come are lost."""
        if match.is_repeated:
            self._pass_over(now_ns, match, match.publisher.next_seq)

    def _pass_over(self, now_ns: int, match: Match, next_seq: int) -> None:
        """The publisher no longer keeps the samples before `next_seq` that it should send again."""
        if (lost := next_seq - match.began_seq) > 0:
            match.began_seq = next_seq
            subscription = match.subscription
            subscription.expected_besides += lost
            subscription.remember(match.publisher, next_seq - 1)
            self._lose(now_ns, match, DropReason.DISCONNECTED, lost, next_seq - 1)

    def _admit(
        self, now_ns: int, publisher: Publisher, run: Run, out: list[Effect], *, is_loss: bool
    ) -> None:
        """Route `run` to the AHEAD matches for which something in it is new; from now on they are ROUTED."""
        for match in tuple(publisher.ahead.values()):
            if publisher.next_seq <= match.began_seq:
                continue
            match.on(MatchEvent.REACH)
            subscription = match.subscription
            if lost := max(0, run.first_seq - match.began_seq):
                reason = DropReason.PUBLISHER_QUEUE if is_loss else DropReason.DISCONNECTED
                self._drops.drop(now_ns, subscription, reason, lost)
            fresh = run if run.first_seq >= match.began_seq else run.after(match.began_seq - 1)
            if subscription.queue.append(fresh):
                self._overfull.append(subscription)
            out.append(subscription.flush)

    def miss(
        self,
        now_ns: int,
        publisher: Publisher,
        gap: int,
        subscriptions: Iterable[Subscription],
        *,
        is_loss: bool,
    ) -> None:
        for subscription in subscriptions:
            if is_loss:  # the publisher's own queue replaced them before they could be handed over
                self._drops.drop(now_ns, subscription, DropReason.PUBLISHER_QUEUE, gap)
            elif (match := publisher.matches[subscription.id]).is_return:
                # It would have got them, but was away.
                self._drops.drop(now_ns, subscription, DropReason.DISCONNECTED, gap)
            else:
                match.began_seq += gap  # these went to others, by another route

    @staticmethod
    def _is_too_large(run: Run, limit: int) -> bool:
        return any(len(payload) > limit for payload, _ in run.records())


def _end_seq(news: News) -> int:
    """The number after its last sample."""
    return news.end_seq if isinstance(news, Loss) else news.first_seq + news.count


def _reason(*, is_loss: bool) -> str:
    """Why numbers are missing before a run."""
    return DropReason.PUBLISHER_QUEUE if is_loss else NOT_SENT


def _sources(subscription: Subscription) -> set[int]:
    """Publishers with samples in the queue of a lossless subscription."""
    return {run.source for run in subscription.queue.runs} if subscription.is_lossless else set()
