"""The hot path: a run of samples from a publisher to the queues of its matched subscriptions.

Costs one step per run and subscription, whatever the number of samples in the run; no payload is decoded.
A queue that a run overfills is not trimmed at once: the shell first sends what the subscriber's socket takes,
then calls `trim`, so that a subscriber that keeps up loses nothing to batching.
"""

from collections.abc import Callable

from bus.errors import RemoteProtocolError
from bus.wire.messages import Dropped
from bus.wire.runs import Run
from busd.core.effects import Effect, Flush, Send
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

        Raises RemoteProtocolError where the publisher's numbers go back.
        """
        gap = run.first_seq - publisher.next_seq
        if gap:
            self._miss(now_ns, publisher, gap)
        publisher.next_seq = run.first_seq + run.count
        size = len(run.body)
        publisher.samples += run.count
        publisher.bytes += size
        if size > publisher.max_message_bytes and self._is_too_large(run, publisher.max_message_bytes):
            for subscription in publisher.matches.values():
                self.drop(now_ns, subscription, "too_large", run.count)
            return False
        run.source = publisher.id
        run.lifespan_ns = publisher.lifespan_ns
        history = publisher.history
        if history is not None:
            history.push(run)
            history.drop_over_quota()
        for subscription in publisher.matches.values():
            queue = subscription.queue
            if queue.append(run):
                self._overfull.append(subscription)
            if not queue.is_ready:
                out.append(Flush(subscription.node.peer.id, queue))
        if publisher.is_windowed and not publisher.acked:
            publisher.uncredited_bytes += size
            if (
                publisher.uncredited_bytes >= self._credit_bytes
                or publisher.next_seq - publisher.credited > self._credit_samples
            ):
                give_credit(publisher, out)
        return bool(self._overfull)

    def trim(self, now_ns: int) -> None:
        """Bring the overfull queues within their bounds: oldest samples first, each counted."""
        for subscription in self._overfull:
            queue = subscription.queue
            if subscription.has_lifespan:
                self.expire(now_ns, subscription)
            replaced = queue.trim()
            if replaced:
                self.drop(now_ns, subscription, "replaced", replaced)
            over = queue.drop_over_quota()
            if over:
                self.drop(now_ns, subscription, "memory_limit", over)
        self._overfull.clear()

    def expire(self, now_ns: int, subscription: Subscription) -> None:
        """Drop what has outlived its lifespan at the head of the subscription's queue."""
        expired = subscription.queue.drop_expired(now_ns)
        if expired:
            self.drop(now_ns, subscription, "expired", expired)

    def drop(self, now_ns: int, subscription: Subscription, reason: str, count: int) -> None:
        """Count `count` samples that `subscription` lost, and see to it that its process learns of it."""
        subscription.dropped[reason] = subscription.dropped.get(reason, 0) + count
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

    def _miss(self, now_ns: int, publisher: Publisher, gap: int) -> None:
        if gap < 0:
            raise RemoteProtocolError(
                f"publisher {publisher.id} sent sample {publisher.next_seq + gap} after {publisher.next_seq - 1}"
            )
        # The publisher's own queue replaced them before they could be handed over.
        for subscription in publisher.matches.values():
            self.drop(now_ns, subscription, "publisher_queue", gap)

    @staticmethod
    def _is_too_large(run: Run, limit: int) -> bool:
        return any(len(payload) > limit for payload, _ in run.records())
