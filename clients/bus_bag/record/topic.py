"""One recorded topic: its subscription, the encoding of its messages as CDR, its counters."""

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

from bus.qos import Durability, QoSProfile, Reliability
from bus.schema import MessageSchema, depth_for
from bus.subscription import Subscription, SubscriptionStatistics
from bus.vocabulary import DropReason
from bus_bag.core import program_of
from bus_bag.losses import TopicLosses
from bus_bag.metadata import TopicMetadata
from bus_bag.record.choice import Found
from bus_bag.record.encoder import encoder_of
from bus_bag.schemas import SCHEMA, TYPE_HASH, schema_to_text
from bus_ros.cdr import Codec

__all__ = ["RecordedTopic", "profile_for"]


def profile_for(schema: MessageSchema) -> QoSProfile:
    """The QoS of a recorder's subscription. It matches every offer, blocks no publisher, and gets the
    messages kept by publishers."""
    return QoSProfile(
        depth_for(schema),
        reliability=Reliability.BEST_EFFORT,
        durability=Durability.BEST_AVAILABLE,
    )


class RecordedTopic:
    """A topic that is recorded. `schema` describes the type of `found`."""

    def __init__(self, found: Found, schema: MessageSchema) -> None:
        self.found = found
        self.name = found.topic
        self.encoder, self.why_json = encoder_of(schema)
        self.encode: Callable[[Any], list[Any]] = self.encoder.encode
        self.program = program_of(self.encoder.shape) if isinstance(self.encoder, Codec) else None
        """Encodes messages in the native core; None if it can't."""
        self.schema = schema
        self.subscription: Subscription[Any] | None = None
        self.is_lossless = False
        """Whether its publishers wait for this subscription."""
        self.final: SubscriptionStatistics | None = None
        """The counters of the subscription at the end of the topic's recording; None while it continues."""
        self.channel: int | None = None
        """Its channel in the bag; None before its first message."""
        self.is_latched = False
        """Whether at least one publisher keeps messages for late joiners."""
        self.written = 0
        self.repeated = 0
        """Messages written once more, at the beginning of further files."""
        self.passed_over = 0
        """Messages that came while the recording was paused, or left a snapshot's memory."""
        self.lost: dict[str, int] = {}
        """Messages lost after they were taken, by reason."""
        self._profiles: Counter[QoSProfile] = Counter()

    def encode_many(self, payloads: tuple[Any, ...]) -> list[bytes]:
        """CDR messages of short payloads. Raises CdrError if one of them does not have the type."""
        made = None if self.program is None else self.program.messages(payloads)
        return self.encoder.encode_many(payloads) if made is None else made

    def subscribed(self, subscription: Subscription[Any]) -> None:
        """Set the subscription from which messages come from now on."""
        self.subscription = subscription
        self.is_lossless = subscription.qos.is_lossless

    def update_offers(self, offers: Iterable[QoSProfile]) -> None:
        """Update the present publishers' profiles. The bag has the profiles known at its first message.

        A profile counts as often as there were publishers with it at one time: a player keeps as much for
        late joiners as all of these publishers together.
        """
        self._profiles |= Counter(offers)
        self.is_latched = any(one.durability is Durability.TRANSIENT_LOCAL for one in self._profiles)

    @property
    def metadata(self) -> TopicMetadata:
        return TopicMetadata(
            self.name,
            self.encoder.type_name,
            "cdr",
            tuple(self._profiles.elements()),
            self.encoder.type_hash,
        )

    @property
    def extra(self) -> dict[str, str]:
        """Further metadata of the channel: the type on the bus."""
        return {
            TYPE_HASH: self.schema.type_hash,
            SCHEMA: schema_to_text(self.schema),
        }

    def lose(self, reason: DropReason, count: int) -> None:
        self.lost[reason] = self.lost.get(reason, 0) + count

    @property
    def is_settled(self) -> bool:
        """Whether each message published so far was taken or is known to be lost."""
        if self.subscription is None:
            return True
        counters = self.subscription.statistics()
        return counters.expected == counters.delivered + counters.queued + sum(counters.dropped.values())

    def finish(self) -> None:
        """End the recording of the topic: later messages are neither recorded nor expected."""
        if self.subscription is not None:
            self.final = self.subscription.statistics()

    def losses(self) -> TopicLosses:
        """The present counters. Messages that are neither written nor lost are waiting."""
        if self.subscription is None:
            return TopicLosses(0)
        counters = self.final or self.subscription.statistics()
        lost = dict(counters.dropped)
        for reason, count in self.lost.items():
            lost[reason] = lost.get(reason, 0) + count
        expected = counters.expected - self.passed_over
        if self.final is not None:
            expected -= counters.queued  # these came after the end of the recording
        waiting = max(0, expected - self.written - sum(lost.values()))
        return TopicLosses(expected, self.written, waiting, {name: n for name, n in lost.items() if n})
