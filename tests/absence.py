"""A subscription that is lost and comes back, in a world of the broker: for the tests of busd.core.absent."""

from broker_endpoints import Publisher, Subscription
from broker_world import ALL_MAY, UID, World
from bus.qos import QoSProfile
from bus.wire import messages as m
from busd.core.limits import Limits

DEEP = QoSProfile(depth=100)
LATCHED = QoSProfile(depth=3, durability="transient_local")


class Story:
    """A talker, and a listener that is lost and comes back with the same identity.

    `shares`: the talker has a ring for others; `by_ring`: the listener reads it, too.
    """

    def __init__(
        self,
        offered: QoSProfile = DEEP,
        requested: QoSProfile = DEEP,
        *,
        uid: int = UID,
        shares: bool = False,
        by_ring: bool = False,
    ) -> None:
        self.world = World(Limits(lease_s=3600), access=(ALL_MAY,))
        self.requested = requested
        self.by_ring = by_ring
        self.talker = self.world.process("talker", shares=shares or by_ring)
        self.publisher = self.talker.publisher("/topic", offered)
        self.listener = self.world.process("listener", uid=uid, shares=by_ring)
        self.subscription = self.listener.subscription("/topic", requested)
        self.gid = self.subscription.gid

    @property
    def heard(self) -> int:
        """The last number that the listener has received."""
        return max((sample.seq for sample in self.subscription.samples), default=0)

    def lose(self) -> None:
        self.listener.die()

    def come_back(
        self,
        last_seqs: dict[bytes, int] | None = None,
        *,
        uid: int = UID,
        topic: str = "/topic",
        is_blocked: bool = False,
    ) -> Subscription:
        """Reconnect the listener; by default it reports the numbers that it has received."""
        known = {self.publisher.gid: self.heard} if last_seqs is None else last_seqs
        self.listener = self.world.process("listener", uid=uid, shares=self.by_ring)
        node = self.listener.node()
        self.listener.is_blocked = is_blocked
        self.subscription = node.subscription(topic, self.requested, gid=self.gid, last_seqs=known)
        return self.subscription

    def come_as_talker(self, *, next_seq: int) -> Publisher:
        """Reconnect the talker's process."""
        gid, qos = self.publisher.gid, LATCHED
        self.talker = self.world.process("talker")
        self.publisher = self.talker.node().publisher("/topic", qos, gid=gid, next_seq=next_seq)
        return self.publisher


def missed(subscription: Subscription) -> list[dict[bytes, tuple[int, int]]]:
    """For publishers that have left: the first and the last number lost, as reported to the subscription."""
    pairs = [
        {gid: pair for gid, pair in told.missed.items() if pair[1]} for told in subscription.got(m.Dropped)
    ]
    return [pair for pair in pairs if pair]


def begun(subscription: Subscription) -> dict[bytes, int]:
    """For publishers that exist, or may come back: the first number, as reported to the subscription."""
    return {
        gid: first_seq
        for told in subscription.got(m.Dropped)
        for gid, (first_seq, last_seq) in told.missed.items()
        if not last_seq
    }


def before(subscription: Subscription) -> list[dict[str, int]]:
    return [told.before for told in subscription.got(m.Dropped) if told.before]


def kept(world: World) -> m.AbsentRecord:
    return world.broker._absentees.record()
