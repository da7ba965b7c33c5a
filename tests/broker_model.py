"""Expected behaviour of busd, with lists: matching, depth, durability, lifespan, death.

It handles one sample at a time. It also says which matches use shared memory: busd sees none of their samples
until the route is refused.
"""

from collections import Counter, deque
from dataclasses import dataclass, field
from typing import NamedTuple

from bus.qos import Durability, History, QoSProfile, Reliability


class ModelSample(NamedTuple):
    publisher: int
    seq: int
    payload: str
    expires_ns: int | None
    is_replay: bool


@dataclass(eq=False)
class ModelPublisher:
    id: int
    process: int
    topic: str
    kind: tuple[str, str]
    qos: QoSProfile
    gid: bytes
    next_seq: int
    has_ring: bool
    elsewhere: int = 0
    """Samples for only one subscription, since the last sample for all."""
    history: list[ModelSample] = field(default_factory=list)

    @property
    def lifespan_ns(self) -> int:
        return self.qos.lifespan_ns


@dataclass(eq=False)
class ModelSubscription:
    id: int
    process: int
    topic: str
    kind: tuple[str, str]
    qos: QoSProfile
    queue: deque[ModelSample] = field(default_factory=deque)
    room_for_replays: int = 0
    received: list[ModelSample] = field(default_factory=list)
    dropped: Counter[str] = field(default_factory=Counter)
    looks_at_age: bool = False
    returned: set[int] = field(default_factory=set)
    """Publishers that it received from before: samples sent to others meanwhile are lost for it."""

    @property
    def depth(self) -> int:
        return _depth(self.qos)

    def lose_oldest(self, reason: str) -> None:
        self.queue.popleft()
        self.dropped[reason] += 1

    def lose_expired(self, now_ns: int) -> None:
        while self.queue and (self.queue[0].expires_ns or now_ns) < now_ns:
            self.lose_oldest("expired")

    def read(self) -> None:
        self.received.extend(self.queue)
        self.queue.clear()
        self.room_for_replays = 0


class Model:
    """All endpoints of all processes; `blocked` are the processes that don't read.

    `shared` are the matches by shared memory; `late` are rerouted matches without a catch-up yet.
    """

    def __init__(self) -> None:
        self.publishers: dict[int, ModelPublisher] = {}
        self.subscriptions: dict[int, ModelSubscription] = {}
        self.blocked: set[int] = set()
        self.sharing: set[int] = set()
        self.shared: set[tuple[int, int]] = set()
        self.late: set[tuple[int, int]] = set()

    def do_match(self, publisher: ModelPublisher, subscription: ModelSubscription) -> bool:
        offered, requested = publisher.qos, subscription.qos
        return (
            publisher.topic == subscription.topic
            and publisher.kind == subscription.kind
            and (
                offered.reliability == Reliability.RELIABLE
                or requested.reliability == Reliability.BEST_EFFORT
            )
            and (
                offered.durability == Durability.TRANSIENT_LOCAL
                or requested.durability == Durability.VOLATILE
            )
        )

    def matches(self) -> set[tuple[int, int, str]]:
        return {
            (publisher.id, subscription.id, self.route(publisher, subscription))
            for publisher in self.publishers.values()
            for subscription in self.subscriptions.values()
            if self.do_match(publisher, subscription)
        }

    def route(self, publisher: ModelPublisher, subscription: ModelSubscription) -> str:
        return "shm" if (publisher.id, subscription.id) in self.shared else "socket"

    def subscribers_of(self, publisher: ModelPublisher) -> list[ModelSubscription]:
        """Subscriptions that get by the route socket the samples for all."""
        others = self.shared | self.late
        return [
            one
            for one in self.subscriptions.values()
            if self.do_match(publisher, one) and (publisher.id, one.id) not in others
        ]

    def add_publisher(self, publisher: ModelPublisher) -> None:
        self.publishers[publisher.id] = publisher
        for subscription in self.subscriptions.values():
            if self.do_match(publisher, subscription) and not self._share(publisher, subscription):
                subscription.looks_at_age |= publisher.lifespan_ns > 0

    def add_subscription(
        self, subscription: ModelSubscription, last_seqs: dict[bytes, int], now_ns: int
    ) -> None:
        self.subscriptions[subscription.id] = subscription
        for publisher in self.publishers.values():
            if self.do_match(publisher, subscription) and not self._share(publisher, subscription):
                subscription.looks_at_age |= publisher.lifespan_ns > 0
                if publisher.gid in last_seqs:
                    subscription.returned.add(publisher.id)
                is_lossless = publisher.qos.is_lossless and subscription.qos.is_lossless
                is_durable = subscription.qos.durability == Durability.TRANSIENT_LOCAL
                if is_durable or (is_lossless and publisher.gid in last_seqs):
                    self._replay(publisher, subscription, last_seqs.get(publisher.gid, 0), now_ns)
        self.deliver(subscription)

    def reroute(self, publisher: ModelPublisher, subscription: ModelSubscription) -> None:
        """Change a match from shared memory to the socket."""
        self.shared.remove((publisher.id, subscription.id))
        self.late.add((publisher.id, subscription.id))
        subscription.looks_at_age |= publisher.lifespan_ns > 0

    def _share(self, publisher: ModelPublisher, subscription: ModelSubscription) -> bool:
        """Whether the new match uses shared memory; notes it."""
        if publisher.has_ring and subscription.process in self.sharing:
            self.shared.add((publisher.id, subscription.id))
            return True
        return False

    def _replay(
        self, publisher: ModelPublisher, subscription: ModelSubscription, known: int, now_ns: int
    ) -> None:
        kept = [one for one in publisher.history if (one.expires_ns or now_ns) >= now_ns]
        kept = kept[-subscription.depth :] if subscription.depth else kept
        replays = [one._replace(is_replay=True) for one in kept if one.seq > known]
        subscription.queue.extend(replays)
        subscription.room_for_replays += len(replays)

    def publish(
        self, publisher: ModelPublisher, lost: int, gone: int, payloads: list[str], now_ns: int
    ) -> int:
        """Publish samples, after `lost` (replaced in the publisher's queue) and `gone` (by another route).

        Returns how many went by another route since the last sample that came here.
        """
        publisher.next_seq += lost + gone
        elsewhere, publisher.elsewhere = publisher.elsewhere + gone, 0
        samples = self._make(publisher, payloads, now_ns)
        if publisher.qos.durability == Durability.TRANSIENT_LOCAL:
            publisher.history = (publisher.history + samples)[-_depth(publisher.qos) or None :]
        for subscription in self.subscribers_of(publisher):
            subscription.dropped["publisher_queue"] += lost
            if publisher.id in subscription.returned:
                subscription.dropped["disconnected"] += elsewhere
            self._queue(subscription, samples, now_ns)
        return elsewhere

    def catch_up(
        self, publisher: ModelPublisher, subscription: ModelSubscription, payloads: list[str], now_ns: int
    ) -> None:
        """Deliver samples to a late subscription; all others had them by another route."""
        publisher.elsewhere += len(payloads)
        self._queue(subscription, self._make(publisher, payloads, now_ns), now_ns)
        self.late.discard((publisher.id, subscription.id))

    def _make(self, publisher: ModelPublisher, payloads: list[str], now_ns: int) -> list[ModelSample]:
        expires_ns = now_ns + publisher.lifespan_ns if publisher.lifespan_ns else None
        first_seq = publisher.next_seq
        publisher.next_seq += len(payloads)
        return [
            ModelSample(publisher.id, first_seq + at, payload, expires_ns, False)
            for at, payload in enumerate(payloads)
        ]

    def _queue(self, subscription: ModelSubscription, samples: list[ModelSample], now_ns: int) -> None:
        subscription.queue.extend(samples)
        self.deliver(subscription)
        room = subscription.depth + subscription.room_for_replays
        if subscription.depth and len(subscription.queue) > room:
            if subscription.looks_at_age:
                subscription.lose_expired(now_ns)
            while len(subscription.queue) > room:
                subscription.lose_oldest("replaced")

    def deliver(self, subscription: ModelSubscription) -> None:
        if subscription.process not in self.blocked:
            subscription.read()

    def unblock(self, process: int, now_ns: int) -> None:
        self.blocked.discard(process)
        for subscription in self.subscriptions.values():
            if subscription.process == process:
                if subscription.looks_at_age:
                    subscription.lose_expired(now_ns)
                subscription.read()

    def remove(self, endpoint: int) -> None:
        self.publishers.pop(endpoint, None)
        self.subscriptions.pop(endpoint, None)
        self.shared = {ends for ends in self.shared if endpoint not in ends}
        self.late = {ends for ends in self.late if endpoint not in ends}

    def endpoints_of(self, process: int) -> set[int]:
        publishers = {one.id for one in self.publishers.values() if one.process == process}
        return publishers | {one.id for one in self.subscriptions.values() if one.process == process}


def _depth(qos: QoSProfile) -> int:
    return qos.depth if qos.history == History.KEEP_LAST else 0
