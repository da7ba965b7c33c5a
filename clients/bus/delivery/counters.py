"""The accounts of one subscription: what was published to it, and what has become of every message.

Puts together what its process has counted (`bus.delivery.receiver`) and what the brokers, this one and those
before it, have told. Must not know where messages come from.
"""

from time import monotonic_ns
from typing import Any

import msgspec

from bus.delivery.receiver import Receiver
from bus.wire.layout import MAX_COUNT
from bus.wire.messages import Dropped


class SubscriptionStatistics(msgspec.Struct, frozen=True):
    """Totals of one subscription.

    At a quiet moment, expected is delivered + queued + all that was dropped.

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
    too_large, undecodable, memory_limit, disconnected (while busd was away)."""
    publishers: int
    """Publishers matched now."""
    expected: int = 0
    """Messages that its publishers have published to it since they were matched, history included: by their
    sequence numbers. Publishers that have gone, count on."""
    at_ns: int = 0
    """When this was counted: nanoseconds of the monotonic clock (`time.monotonic_ns`)."""


class DropCounters:
    """Of the subscription that takes from `receiver`."""

    def __init__(self, receiver: Receiver[Any]) -> None:
        self._receiver = receiver
        self._told: dict[str, int] = {}
        self._told_before: dict[str, int] = {}  # by earlier brokers
        self._broker: object = None
        self._told_by_it: dict[str, int] = {}  # in earlier connections
        self._received_before = 0

    def tell(self, dropped: Dropped) -> None:
        """What the present broker has dropped, and after a loss of the connection, what was missed."""
        self._told = dropped.dropped
        sources = self._receiver.sources
        if dropped.before:
            told, self._told_by_it = self._told_by_it, dropped.before
            sources.explain({reason: count - told.get(reason, 0) for reason, count in dropped.before.items()})
        sources.learn(dropped.missed)
        sources.miss(dropped.missed)

    def disconnected(self, broker: object) -> None:
        """The broker is gone, or the connection to it: what it has told is final."""
        if broker != self._broker:
            self._broker, self._told_by_it = broker, {}
        self._told_by_it = _sum(self._told_by_it, self._told)
        self._receiver.sources.disconnected(self._told_total, self._receiver.lapped_reason)
        self._told_before = _sum(self._told_before, self._told)
        self._told = {}
        self._received_before = self._receiver.sources.received

    @property
    def dropped(self) -> dict[str, int]:
        """All that was lost, by reason, whoever counted it."""
        return _sum(self.dropped_here, self._told)

    @property
    def dropped_here(self) -> dict[str, int]:
        """What the present broker does not know of, unless it is told."""
        lapped = self._lapped
        return _sum(
            self._receiver.dropped,
            self._told_before,
            {self._receiver.lapped_reason: lapped} if lapped else {},
        )

    @property
    def expected(self) -> int:
        sources = self._receiver.sources
        # What is missing in the numbers was lost, and so is what the broker dropped behind the last of them.
        return self._by_other_ways + sources.received + max(sources.missing, self._told_total)

    @property
    def expected_here(self) -> int:
        """What the present broker did not route to it."""
        return min(self._by_other_ways + self._lapped + self._received_before, MAX_COUNT)

    @property
    def _by_other_ways(self) -> int:
        receiver = self._receiver
        rings = 0 if receiver.reader is None else receiver.reader.expected
        return rings + receiver.sources.lost_between + sum(self._told_before.values())

    @property
    def _told_total(self) -> int:
        return sum(self._told.values())

    @property
    def _lapped(self) -> int:
        return self._receiver.sources.lapped(self._told_total)

    def statistics(self, publishers: int) -> SubscriptionStatistics:
        receiver = self._receiver
        return SubscriptionStatistics(
            queued=receiver.queued,  # first: it looks at the rings
            delivered=receiver.delivered,
            bytes=receiver.bytes,
            dropped=self.dropped,
            publishers=publishers,
            expected=self.expected,
            at_ns=monotonic_ns(),
        )


def _sum(*parts: dict[str, int]) -> dict[str, int]:
    total: dict[str, int] = {}
    for part in parts:
        for reason, count in part.items():
            total[reason] = min(total.get(reason, 0) + count, MAX_COUNT)
    return total
