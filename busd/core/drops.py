"""Samples that subscriptions lose in the daemon: counted by reason, and reported to their processes.

Also takes them out of the queues if they are too old or too many. Must not know the rule for that.
"""

from collections.abc import Callable
from functools import partial

from bus.base.ids import EndpointId
from bus.vocabulary import DropReason
from bus.wire.layout import MAX_COUNT
from bus.wire.messages import Dropped
from bus.wire.runs import Run, RunQueue
from busd.core.effects import Effect, Send
from busd.core.entities import Subscription
from busd.core.matching import release
from busd.core.timers import Timers
from busd.core.work import STAMPS_PER_UNIT

DROP_REPORT_NS = 100_000_000
"""Drops are reported to a subscription this long after the first one, all at once."""


def _head(queue: RunQueue) -> tuple[int, int]:
    """The oldest sample: its publisher and number. It stays the same until it is sent or dropped."""
    run = queue.runs[0] if queue.runs else None
    return (0, 0) if run is None else (run.source, run.first_seq + queue.skipped)


class Drops:
    """Counts drops at their subscriptions."""

    def __init__(self, timers: Timers, emit: Callable[[Effect], None]) -> None:
        self._timers = timers
        self._emit = emit

    def drop(self, now_ns: int, subscription: Subscription, reason: str, count: int) -> None:
        """Count `count` samples that `subscription` lost, and have them reported to its process."""
        subscription.dropped[reason] = min(subscription.dropped.get(reason, 0) + count, MAX_COUNT)
        if not subscription.is_drop_report_due:
            subscription.is_drop_report_due = True
            self._timers.add(now_ns + DROP_REPORT_NS, lambda _: self.report(subscription))

    def replace(self, now_ns: int, subscription: Subscription) -> int:
        """Drop the oldest samples above the subscription's depth, and count them; returns the cost."""
        queue = subscription.queue
        head = _head(queue)
        if replaced := queue.trim():
            self.drop(now_ns, subscription, DropReason.REPLACED, replaced)
            subscription.missed = replaced + (subscription.missed if head == subscription.head_after else 0)
            subscription.most_missed = max(subscription.most_missed, subscription.missed)
            subscription.head_after = _head(queue)
            return queue.steps // STAMPS_PER_UNIT
        return 0

    def shed(
        self, now_ns: int, subscription: Subscription, reason: str, drop: Callable[[list[Run] | None], int]
    ) -> None:
        """Let `drop` take samples out of the subscription's queue, and count them.

        It returns how many, and appends their runs to the list that it is given.
        """
        gone: list[Run] | None = [] if subscription.is_lossless else None
        count = drop(gone)
        if count:
            self.drop(now_ns, subscription, reason, count)
            newest = {run.source: run for run in gone or ()}
            for source, run in newest.items():
                match = subscription.matches.get(EndpointId(source))
                last_seq = run.first_seq + run.count - 1
                # If the newest were dropped, no acknowledgement will ever cover them.
                if match is not None and last_seq >= match.publisher.next_seq - 1:
                    release(match, last_seq, self._emit)

    def expire(self, now_ns: int, subscription: Subscription) -> int:
        """Drop expired samples of the oldest run in the subscription's queue.

        Returns the cost; 0 if no sample has expired.
        """
        queue, before = subscription.queue, subscription.queue.count
        expire = partial(queue.drop_expired_of_head, now_ns)
        self.shed(now_ns, subscription, DropReason.EXPIRED, expire)
        expired = before - queue.count
        return 1 + expired // STAMPS_PER_UNIT if expired else 0

    def report(self, subscription: Subscription) -> None:
        """Report all drops of the subscription to its process."""
        subscription.is_drop_report_due = False
        peer = subscription.node.peer
        if subscription.id in peer.endpoints:
            self._emit(
                Send(peer.id, Dropped(subscription=subscription.id, dropped=dict(subscription.dropped)))
            )
