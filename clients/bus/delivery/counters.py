"""The counters of one subscription: messages published to it, and the fate of every message.

Adds up the counts of this process (`bus.delivery.receiver`) and the reports of the present broker and of
earlier ones. Must not know where messages come from.
"""

from time import monotonic_ns
from typing import Any

import msgspec

from bus.delivery.receiver import Receiver
from bus.delivery.sequence import PublisherProxy
from bus.wire.layout import MAX_COUNT
from bus.wire.messages import Dropped


class SubscriptionStatistics(msgspec.Struct, frozen=True):
    """Totals of one subscription.

    While no message is on its way, expected = delivered + queued + all dropped messages.

        print(subscription.statistics().dropped)
    """

    delivered: int
    """Messages taken by the program."""
    bytes: int
    """Their encoded size."""
    queued: int
    """Messages in this process that wait to be taken."""
    dropped: dict[str, int]
    """Messages lost, by reason: replaced (by the depth), publisher_queue (by the publisher's depth), expired,
    too_large, undecodable, memory_limit, disconnected (while busd was away). After a lost connection, a
    history may bring messages that a queue had dropped: these no longer count."""
    publishers: int
    """Publishers matched now."""
    expected: int = 0
    """Messages that its publishers have published to it since they were matched, history included, by their
    sequence numbers. Messages of departed publishers stay counted."""
    at_ns: int = 0
    """Time of counting: nanoseconds of the monotonic clock (`time.monotonic_ns`)."""
    age_count: int = 0
    """Messages with a measured age (the time from publishing to taking), in the last half second that had
    messages. If there are few messages, all are measured."""
    age_sum_ns: int = 0
    """The sum of these ages, in nanoseconds."""
    age_max_ns: int = 0
    """The highest of them."""


class DropCounters:
    """The counters of the subscription that takes from `receiver`."""

    def __init__(self, receiver: Receiver[Any]) -> None:
        self._receiver = receiver
        self._reported: dict[str, int] = {}  # by the present broker
        self._reported_before: dict[str, int] = {}  # by earlier brokers
        self._broker: object = None
        self._reported_by_it: dict[str, int] = {}  # in earlier connections
        self._received_before = 0

    def on_dropped(self, dropped: Dropped) -> None:
        """Add a report of the present broker: its drops, and after a lost connection the missed samples."""
        self._reported = dropped.dropped
        tracker = self._receiver.tracker
        if dropped.before:
            before, self._reported_by_it = self._reported_by_it, dropped.before
            tracker.explain(
                {reason: count - before.get(reason, 0) for reason, count in dropped.before.items()}
            )
        tracker.learn(dropped.missed)
        tracker.miss(dropped.missed)

    def disconnected(self, broker: object) -> None:
        """Note that the broker, or the connection to it, is gone: its last report is final."""
        if broker != self._broker:
            self._broker, self._reported_by_it = broker, {}
        self._reported_by_it = _sum(self._reported_by_it, self._reported)
        self._receiver.tracker.disconnected(self._reported_total, self._receiver.lapped_reason)
        self._reported_before = _sum(self._reported_before, self._reported)
        self._reported = {}
        self._received_before = self._receiver.tracker.received

    def matched(self, proxy: PublisherProxy) -> bool:
        """Note a match after a lost connection: dropped samples that may come again are no longer lost.

        Returns whether there are any.
        """
        tracker, before = self._receiver.tracker, self._reported_before
        left = tracker.claim_ahead(proxy)
        if not left:
            return False
        for reason, count in before.items():
            some = min(left, count)
            left -= some
            before[reason] = count - some
            tracker.explain_ahead(reason, some)
        self._reported_before = {reason: count for reason, count in before.items() if count}
        return True

    @property
    def dropped(self) -> dict[str, int]:
        """All lost samples, by reason, counted by busd and this process."""
        return _sum(self.dropped_here, self._reported)

    @property
    def dropped_here(self) -> dict[str, int]:
        """Samples lost here and under earlier brokers. The present broker knows them only by our report."""
        lapped = self._lapped
        return _sum(
            self._receiver.dropped,
            self._reported_before,
            self._receiver.tracker.absent(self._reported_total),
            {self._receiver.lapped_reason: lapped} if lapped else {},
        )

    @property
    def expected(self) -> int:
        tracker = self._receiver.tracker
        # Lost samples: missing numbers, and drops of the broker after the last received number.
        return self._by_other_ways + tracker.received + max(tracker.missing, self._reported_total)

    @property
    def expected_here(self) -> int:
        """The part of `expected` that the present broker did not route."""
        absent = sum(self._receiver.tracker.absent(self._reported_total).values())
        return min(self._by_other_ways + absent + self._lapped + self._received_before, MAX_COUNT)

    @property
    def _by_other_ways(self) -> int:
        receiver = self._receiver
        rings = 0 if receiver.reader is None else receiver.reader.expected
        return rings + receiver.tracker.lost_between + sum(self._reported_before.values())

    @property
    def _reported_total(self) -> int:
        return sum(self._reported.values())

    @property
    def _lapped(self) -> int:
        return self._receiver.tracker.lapped(self._reported_total)

    def statistics(self, publishers: int) -> SubscriptionStatistics:
        receiver = self._receiver
        age_count, age_sum_ns, age_max_ns = receiver.ages.window
        return SubscriptionStatistics(
            queued=receiver.queued,  # first, because it checks the rings
            delivered=receiver.delivered,
            bytes=receiver.bytes,
            dropped=self.dropped,
            publishers=publishers,
            expected=self.expected,
            at_ns=monotonic_ns(),
            age_count=age_count,
            age_sum_ns=age_sum_ns,
            age_max_ns=age_max_ns,
        )


def _sum(*parts: dict[str, int]) -> dict[str, int]:
    total: dict[str, int] = {}
    for part in parts:
        for reason, count in part.items():
            total[reason] = min(total.get(reason, 0) + count, MAX_COUNT)
    return total
