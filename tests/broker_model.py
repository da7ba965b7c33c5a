"""What busd should do, done one sample at a time with lists: matching, depth, durability, lifespan, death."""

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
    """All endpoints of all processes; `blocked` holds the processes that don't read."""

    def __init__(self) -> None:
        self.publishers: dict[int, ModelPublisher] = {}
        self.subscriptions: dict[int, ModelSubscription] = {}
        self.blocked: set[int] = set()

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

    def matches(self) -> set[tuple[int, int]]:
        return {
            (publisher.id, subscription.id)
            for publisher in self.publishers.values()
            for subscription in self.subscriptions.values()
            if self.do_match(publisher, subscription)
        }

    def subscribers_of(self, publisher: ModelPublisher) -> list[ModelSubscription]:
        return [one for one in self.subscriptions.values() if self.do_match(publisher, one)]

    def add_publisher(self, publisher: ModelPublisher) -> None:
        self.publishers[publisher.id] = publisher
        for subscription in self.subscribers_of(publisher):
            subscription.looks_at_age |= publisher.lifespan_ns > 0

    def add_subscription(
        self, subscription: ModelSubscription, last_seqs: dict[bytes, int], now_ns: int
    ) -> None:
        self.subscriptions[subscription.id] = subscription
        for publisher in self.publishers.values():
            if not self.do_match(publisher, subscription):
                continue
            subscription.looks_at_age |= publisher.lifespan_ns > 0
            if subscription.qos.durability == Durability.TRANSIENT_LOCAL:
                kept = [one for one in publisher.history if (one.expires_ns or now_ns) >= now_ns]
                kept = kept[-subscription.depth :] if subscription.depth else kept
                known = last_seqs.get(publisher.gid, 0)
                replays = [one._replace(is_replay=True) for one in kept if one.seq > known]
                subscription.queue.extend(replays)
                subscription.room_for_replays += len(replays)
        self.deliver(subscription)

    def publish(self, publisher: ModelPublisher, lost: int, payloads: list[str], now_ns: int) -> None:
        """`lost`: samples that the publisher's own queue replaced before these."""
        publisher.next_seq += lost
        expires_ns = now_ns + publisher.lifespan_ns if publisher.lifespan_ns else None
        samples = [
            ModelSample(publisher.id, publisher.next_seq + at, payload, expires_ns, False)
            for at, payload in enumerate(payloads)
        ]
        publisher.next_seq += len(samples)
        if publisher.qos.durability == Durability.TRANSIENT_LOCAL:
            publisher.history = (publisher.history + samples)[-_depth(publisher.qos) or None :]
        for subscription in self.subscribers_of(publisher):
            subscription.dropped["publisher_queue"] += lost
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

    def endpoints_of(self, process: int) -> set[int]:
        publishers = {one.id for one in self.publishers.values() if one.process == process}
        return publishers | {one.id for one in self.subscriptions.values() if one.process == process}


def _depth(qos: QoSProfile) -> int:
    return qos.depth if qos.history == History.KEEP_LAST else 0
