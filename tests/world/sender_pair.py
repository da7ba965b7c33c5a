"""A publisher and its matched subscription in two processes of a whole bus without sockets, for tests."""

from typing import Any

from bus.qos import QoSProfile
from bus.subscription import Subscription
from bus.wire import messages as m
from client_world import Client, ClientWorld, Numbered

__all__ = ["HISTORY", "KEEP_ALL", "LAST_10", "PADDING", "Pair", "heard"]

PADDING = "x" * 20_000
LAST_10, KEEP_ALL = QoSProfile(10), QoSProfile(history="keep_all")
HISTORY = QoSProfile(10, durability="transient_local")


class Pair:
    """A talker and a listener, each a process, with a publisher and its matched subscription."""

    def __init__(
        self, route: str, qos: QoSProfile = LAST_10, requested: QoSProfile | None = None, world: Any = None
    ) -> None:
        self.world: ClientWorld = world or ClientWorld()
        self.talker = self.world.client(shares=route == "shm")
        self.listener = self.world.client(shares=route == "shm")
        self.subscription = self.listener.subscription(requested or qos)
        self.world.settle()
        self.publisher = self.talker.publisher(qos)
        self.world.settle()
        assert [match.route for match in self.publisher.matches] == [route]

    def publish(self, count: int = 1, padding: str = "") -> int:
        taken = self.talker.publish(self.publisher, count, padding)
        self.world.settle()
        return taken

    def heard(self, subscription: Subscription[Numbered] | None = None) -> list[int]:
        return heard(self.listener, subscription or self.subscription)

    @property
    def dropped(self) -> dict[str, int]:
        return self.subscription.statistics().dropped

    def refuse(self) -> None:
        """The subscription's process cannot read the ring; busd tells it to leave the ring."""
        core = self.subscription._core
        refusal = m.RefuseRoute(endpoint=core.id, other=self.publisher._core.id, text="a test")
        self.listener.send_about(core, refusal)

    def route(self) -> str:
        (match,) = self.publisher.matches
        return match.route


def heard(client: Client, subscription: Subscription[Numbered]) -> list[int]:
    found = [number for _, number in client.take(subscription)]
    assert found == sorted(set(found)), "each once, in order"
    return found
