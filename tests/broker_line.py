"""The smallest worlds for tests of the broker: one publisher, one subscription."""

from broker_endpoints import Publisher, Subscription
from broker_world import World
from bus.qos import QoSProfile
from bus.wire import messages as m
from busd.core.limits import Limits, TopicRule


class Line:
    """A world with one publisher and one subscription, in two processes."""

    def __init__(
        self,
        offered: QoSProfile | None = None,
        requested: QoSProfile | None = None,
        limits: Limits | None = None,
        rules: tuple[TopicRule, ...] = (),
    ) -> None:
        self.world = World(limits, rules)
        self.talker = self.world.process("talker")
        self.listener = self.world.process("listener")
        self.publisher = self.talker.publisher("/topic", offered)
        self.subscription = self.listener.subscription("/topic", requested)

    @property
    def dropped(self) -> dict[str, int]:
        """The broker's counters of samples dropped for the subscription."""
        return self.subscription.statistics(self.talker).dropped

    def told(self) -> list[dict[str, int]]:
        """The drops reported to the subscription."""
        return [message.dropped for message in self.subscription.got(m.Dropped)]


class Pair:
    """A talker and a listener that share memory, and their match."""

    def __init__(
        self,
        offered: QoSProfile | None = None,
        requested: QoSProfile | None = None,
        *,
        publisher_first: bool = True,
    ) -> None:
        self.world = World()
        self.talker = self.world.process("talker", shares=True)
        self.listener = self.world.process("listener", shares=True)
        if publisher_first:
            self.publisher = self.talker.publisher("/topic", offered)
        self.subscription = self.listener.subscription("/topic", requested)
        if not publisher_first:
            self.publisher = self.talker.publisher("/topic", offered)

    def match(self) -> tuple[Publisher, Subscription]:
        return self.publisher, self.subscription


def route(publisher: Publisher, subscription: Subscription) -> str:
    """The route of the match, in the graph."""
    (found,) = (
        one.route
        for one in publisher.process.world.process().graph().matches
        if (one.publisher, one.subscription) == (publisher.id, subscription.id)
    )
    return found


def note(world: World, text: str) -> bool:
    return any(text in line for line in world.notes)
