"""Processes, nodes and endpoints that have gone leave nothing in the broker, whatever they did."""

import gc
import sys
from collections.abc import Callable
from types import BuiltinFunctionType, FunctionType, ModuleType
from weakref import ref

import pytest

from broker_world import ALL_MAY, SECOND, UID, Refusal, World
from bus.base.ids import EndpointId
from bus.qos import QoSProfile
from bus.wire import messages as m
from busd.core.absent import KEEP_NS, LOG_AGAIN_NS
from busd.core.access import AccessRule

GUEST = UID + 1
ALL = QoSProfile(history="keep_all")
KEPT = QoSProfile(depth=3, durability="transient_local")
SHORT = QoSProfile(depth=3, lifespan=0.5, liveliness_lease_duration=0.5)
SETTLING = 400
"""The broker remembers a few past things, such as 128 publishers, in tables with some spare room."""
TIMES = 300


class Stage:
    """A world in which one talker and one listener stay, with matches by both routes."""

    def __init__(self) -> None:
        hidden = AccessRule(
            topics=("/hidden",), actions=frozenset(("observe",)), is_for_all=True, allow=False
        )
        self.world = World(access=(hidden, ALL_MAY))
        self.talker = self.world.process("talker", shares=True)
        self.listener = self.world.process("listener")
        self.publisher = self.talker.publisher("/topic", ALL)
        self.subscription = self.listener.subscription("/topic", QoSProfile(depth=3))

    def live(self, seconds: float) -> None:
        """Time passes, and the processes that stay give signs of life."""
        for _ in range(1 + int(seconds // 5)):
            for process in (self.talker, self.listener):
                process.tell(m.Ping())
            self.world.advance(min(seconds, 5))

    def weight(self) -> int:
        """Bytes of all objects that can be reached from the broker."""
        gc.collect()
        seen, waiting, total = set[int](), [self.world.broker], 0
        while waiting:
            one = waiting.pop()
            if id(one) in seen or isinstance(one, type | ModuleType | BuiltinFunctionType):
                continue
            seen.add(id(one))
            total += sys.getsizeof(one)
            waiting += (one.__closure__ or ()) if isinstance(one, FunctionType) else gc.get_referents(one)
        return total


def come_and_go(stage: Stage) -> None:
    process = stage.world.process()
    process.subscription("/topic").destroy()
    process.subscription("/topic", ALL)
    process.publisher("/topic", KEPT).publish(*"abcde")
    process.node("second").destroy()
    process.die()


def be_ahead(stage: Stage) -> None:
    process = stage.world.process()
    ahead = process.node().subscription("/topic", ALL, last_seqs={stage.publisher.gid: 1 << 40})
    stage.publisher.publish("x")
    ahead.destroy()
    process.die()


def leave_a_ring_half_way(stage: Stage) -> None:
    process = stage.world.process(shares=True)
    subscription = process.subscription("/topic", ALL)
    process.is_blocked = True
    subscription.refuse(stage.publisher)
    process.die()


def leave_a_ring_and_the_bus(stage: Stage) -> None:
    process = stage.world.process(shares=True)
    subscription = process.subscription("/topic", ALL)
    subscription.refuse(stage.publisher)
    stage.publisher.catch_up(subscription, "x")
    process.die()


def come_back(stage: Stage) -> None:
    """A publisher that the subscription knows comes back, and continues its numbers."""
    process = stage.world.process()
    publisher = process.node().publisher("/topic", KEPT, gid=bytes(15) + b"g", next_seq=10 * process.id)
    publisher.publish(*"abc")
    process.die()


def expire(stage: Stage) -> None:
    process = stage.world.process()
    perishable = process.subscription("/topic", SHORT)
    publisher = process.publisher("/topic", SHORT)
    stage.listener.is_blocked = True
    publisher.publish("x")
    stage.world.advance(1)
    perishable.destroy()
    process.die()


def lose_some(stage: Stage) -> None:
    process = stage.world.process()
    process.subscription("/topic", QoSProfile(depth=1))
    process.is_blocked = True
    stage.publisher.publish_many("abc")
    stage.publisher.lose(2)
    process.die()


def watch(stage: Stage) -> None:
    process = stage.world.process(uid=GUEST)
    process.request(m.Observe(request=0), m.GraphSnapshot)
    process.publisher("/topic", kind=("test_msgs/msg/Guest", f"of guest {process.id}"))
    stage.world.advance(1)
    process.die()


def be_refused(stage: Stage) -> None:
    process = stage.world.process(uid=GUEST)
    for action in (process.publisher, process.subscription):
        with pytest.raises(Refusal):
            action("no topic")
    process.tell(m.DestroyNode(node=1 << 30))


STORIES = (
    come_and_go,
    be_ahead,
    leave_a_ring_half_way,
    leave_a_ring_and_the_bus,
    come_back,
    expire,
    lose_some,
    watch,
    be_refused,
)


@pytest.mark.parametrize("story", STORIES, ids=lambda story: story.__name__)
def test_nothing_is_left_of(story: Callable[[Stage], None]) -> None:
    stage = Stage()

    def play(times: int) -> int:
        for _ in range(times):
            story(stage)
            stage.listener.unblock()
            stage.world.advance(0.2)
            stage.live(0)
        # Busd keeps records for this time, for endpoints that may come back.
        stage.live((KEEP_NS + LOG_AGAIN_NS) / SECOND)
        return stage.weight()

    weight = play(SETTLING)
    assert play(TIMES) - weight < 20 * TIMES, "something is left each time"


def test_a_broker_that_is_dropped_whole_is_gone_with_its_matches() -> None:
    """Then its matches close the descriptors that they hold."""
    stage = Stage()
    stage.world.process(shares=True).subscription("/topic", ALL)
    matches = stage.world.broker.graph.publishers[EndpointId(stage.publisher.id)].matches
    assert {one.route for one in matches.values()} == {"shm", "socket"}
    broker = ref(stage.world.broker)
    ring = ref(stage.world.broker.graph.publishers[EndpointId(stage.publisher.id)].ring)
    del stage, matches
    gc.collect()
    assert broker() is ring() is None
