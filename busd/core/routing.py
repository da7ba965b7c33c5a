"""The hot path: a run of samples from a publisher to the queues of its matched subscriptions.

Costs one step per run and subscription, whatever the number of samples in the run; no payload is decoded.
A queue that a run overfills is not trimmed at once: the shell first sends what the subscriber's socket takes,
then calls `trim`, so that a subscriber that keeps up loses nothing to batching.
"""

from collections.abc import Callable
from functools import partial

from bus.errors import RemoteProtocolError
from bus.ids import EndpointId
from bus.wire.layout import MAX_COUNT, MAX_RUN_SAMPLES, RECORD_HEAD_BYTES
from bus.wire.messages import Dropped
from bus.wire.runs import Run
from busd.core.effects import Effect, Send
from busd.core.entities import Publisher, Subscription
from busd.core.matching import give_credit
from busd.core.timers import Timers

DROP_REPORT_NS = 100_000_000
"""Drops are told to a subscription this long after the first one, all at once."""


class Router:
    """Routes runs; owns the queues that are over their bound at the moment."""

    def __init__(
        self, timers: Timers, emit: Callable[[Effect], None], *, window_bytes: int, window_samples: int
    ) -> None:
        self._timers = timers
        self._emit = emit
        self._credit_bytes = window_bytes // 8
        self._credit_samples = window_samples // 8
        self._overfull: list[Subscription] = []

    def route(self, now_ns: int, publisher: Publisher, run: Run, out: list[Effect]) -> bool:
        """Queue `run` for every matched subscription; returns whether `trim` is to be called.

        Raises RemoteProtocolError where the publisher's numbers go back, or a run claims too many samples.
        """
        size = len(run.body)
        payload_bytes = size - run.count * RECORD_HEAD_BYTES
        if payload_bytes < 0:
            raise RemoteProtocolError(f"data frame claims {run.count} samples in {size} bytes")
        if run.count > MAX_RUN_SAMPLES:
            raise RemoteProtocolError(
                f"data frame of {run.count} samples, a run has {MAX_RUN_SAMPLES} at most"
            )
        if run.source:
            return self._catch_up(now_ns, publisher, run, out)
        gap = run.first_seq - publisher.next_seq
        if gap:
            self._miss(now_ns, publisher, gap, is_loss=not run.is_resumed)
        publisher.next_seq = run.first_seq + run.count
        publisher.samples += run.count
        publisher.bytes += payload_bytes
        limit = publisher.max_message_bytes
        if payload_bytes > limit and self._is_too_large(run, limit):
            for subscription in publisher.routed.values():
                self.drop(now_ns, subscription, "too_large", run.count)
                if publisher.id not in _sources(subscription):
                    self._release(publisher, subscription)
            return False
        run.source = publisher.id
        run.lifespan_ns = publisher.lifespan_ns
        run.is_resumed = False  # of no concern to subscriptions
        history = publisher.history
        if history is not None:
            history.push(run)
            history.drop_over_quota()
        for subscription in publisher.routed.values():
            queue = subscription.queue
            if queue.append(run):
                self._overfull.append(subscription)
            if not queue.is_ready:
                out.append(subscription.flush)
        if publisher.is_credit_ahead:
            give_credit(publisher, out.append)
        elif publisher.is_lossless and not publisher.acked:
            publisher.uncredited_bytes += size
            if (
                publisher.uncredited_bytes >= self._credit_bytes
                or publisher.next_seq - publisher.credited > self._credit_samples
            ):
                give_credit(publisher, out.append)
        return bool(self._overfull)

    def trim(self, now_ns: int) -> None:
        """Bring the overfull queues within their bounds: oldest samples first, each counted."""
        for subscription in self._overfull:
            queue = subscription.queue
            if subscription in subscription.node.peer.perishable:
                self.expire(now_ns, subscription)
            replaced = queue.trim()
            if replaced:
                self.drop(now_ns, subscription, "replaced", replaced)
            self.bound(now_ns, subscription)
        self._overfull.clear()

    def bound(self, now_ns: int, subscription: Subscription) -> None:
        """Drop what waits for the subscription's process while that is over its quota.

        The longest queues lose their oldest first, each but its newest run; these go last, and never the one
        that has just come for `subscription`, so that a single message of any size gets through.
        """
        account, peer = subscription.queue.account, subscription.node.peer
        if account.used <= account.limit:
            return
        longest_first = sorted(peer.subscriptions(), key=lambda one: one.queue.held_bytes, reverse=True)
        spared = subscription if subscription.queue.runs else longest_first[0]
        for spare in (1, 0):
            for one in longest_first:
                if spare or one is not spared:
                    self._shed(now_ns, one, "memory_limit", partial(one.queue.drop_over_quota, spare=spare))

    def expire(self, now_ns: int, subscription: Subscription) -> None:
        """Drop what has outlived its lifespan at the head of the subscription's queue."""
        self._shed(
            now_ns, subscription, "expired", lambda gone: subscription.queue.drop_expired(now_ns, gone)
        )

    def drop(self, now_ns: int, subscription: Subscription, reason: str, count: int) -> None:
        """Count `count` samples that `subscription` lost, and see to it that its process learns of it."""
        subscription.dropped[reason] = min(subscription.dropped.get(reason, 0) + count, MAX_COUNT)
        if not subscription.is_drop_report_due:
            subscription.is_drop_report_due = True
            self._timers.add(now_ns + DROP_REPORT_NS, lambda _: self.report_drops(subscription))

    def report_drops(self, subscription: Subscription) -> None:
        subscription.is_drop_report_due = False
        peer = subscription.node.peer
        if subscription.id in peer.endpoints:
            self._emit(
                Send(peer.id, Dropped(subscription=subscription.id, dropped=dict(subscription.dropped)))
            )

    def _catch_up(self, now_ns: int, publisher: Publisher, run: Run, out: list[Effect]) -> bool:
        """A run for one subscription, of samples that the others had before; as `route`."""
        subscription = publisher.matches.get(EndpointId(run.source))
        if subscription is None or subscription.id in publisher.shared:
            return False  # it has left, or was never rerouted
        if self._is_too_large(run, publisher.max_message_bytes):
            self.drop(now_ns, subscription, "too_large", run.count)
            return False
        run.source = publisher.id
        run.lifespan_ns = publisher.lifespan_ns
        run.is_resumed = False
        if subscription.queue.append(run):
            self._overfull.append(subscription)
        out.append(subscription.flush)
        return bool(self._overfull)

    def _shed(
        self, now_ns: int, subscription: Subscription, reason: str, drop: Callable[[list[Run] | None], int]
    ) -> None:
        gone: list[Run] | None = [] if subscription.is_lossless else None
        count = drop(gone)
        if count:
            self.drop(now_ns, subscription, reason, count)
            for run in gone or ():
                publisher = subscription.matches.get(EndpointId(run.source))
                if publisher is not None and run.first_seq + run.count == publisher.next_seq:
                    self._release(publisher, subscription)

    def _release(self, publisher: Publisher, subscription: Subscription) -> None:
        """The newest samples were dropped, so that no acknowledgement will ever cover them."""
        if subscription.id in publisher.acked:
            acked = publisher.acked[subscription.id]
            publisher.acked[subscription.id] = max(acked, publisher.next_seq - 1)
            give_credit(publisher, self._emit)

    def _miss(self, now_ns: int, publisher: Publisher, gap: int, *, is_loss: bool) -> None:
        if gap < 0:
            last_seq = publisher.next_seq - 1
            raise RemoteProtocolError(
                f"publisher {publisher.id} sent sample {last_seq + 1 + gap} after {last_seq}"
            )
        if is_loss:
            # The publisher's own queue replaced them before they could be handed over.
            for subscription in publisher.routed.values():
                self.drop(now_ns, subscription, "publisher_queue", gap)

    @staticmethod
    def _is_too_large(run: Run, limit: int) -> bool:
        return any(len(payload) > limit for payload, _ in run.records())


def _sources(subscription: Subscription) -> set[int]:
    """The publishers that a lossless subscription has samples of in its queue."""
    return {run.source for run in subscription.queue.runs} if subscription.is_lossless else set()
