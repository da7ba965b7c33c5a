"""Every handler and every timer of the core, with tables of thousands: no turn does more than its budget.

The tests count steps, not microseconds: lines of Python that the core executes. Each message type and each
timer has an entry here; one without an entry fails the test. The whole cost of an entry must also be charged.
"""

import ast
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import busd.core
from broker_endpoints import Publisher, Subscription
from broker_world import ALL_MAY, SECOND, TEXT, UID, Process, World
from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.layout import PLACES
from busd.core.access import ACTIONS, Access, AccessRule
from busd.core.limits import Limits
from busd.core.turns import BUDGET
from effort import is_nightly
from line_counter import LineCounter

LINES_PER_UNIT = 40
"""Maximum of lines for one unit that is charged."""
LINES_OF_A_TURN = 30_000
"""Maximum of lines in one turn, which take about a millisecond."""
KEEP_ALL = QoSProfile(history="keep_all")
DEEP = QoSProfile(depth=100_000)
KEPT = QoSProfile(depth=100_000, durability="transient_local")
ALICE = 1001


def many() -> int:
    return 100_000 if is_nightly() else 4_000


class Big(World):
    """A world that measures turns, once `measure` was called."""

    def __init__(self) -> None:
        most = 1 << 20
        names = (
            "connections",
            "nodes",
            "endpoints",
            "matches",
            "topics",
            "declarations_per_s",
            "descriptors",
        )
        limits = {f"{name}_per_{whose}": most for name in names[1:] for whose in ("peer", "user")}
        super().__init__(
            Limits(connections=most, connections_per_user=most, topics=most, depth=1 << 20, **limits),  # type: ignore[arg-type]
            access=(ALL_MAY,),
        )
        self.counter = LineCounter()
        self.turns: list[int] = []
        self.charged = 0
        self._begun_at = -1

    def measure(self, action: Callable[[], object]) -> None:
        """Do `action` in turns, and count each of them."""
        self.budget, self._begun_at = BUDGET, 0
        self.broker.meter.left = BUDGET
        before, depth = sys.gettrace(), sys.getrecursionlimit()
        sys.setrecursionlimit(100_000)  # each turn of a world begins within the turn before
        sys.settrace(self.counter.enter)
        try:
            action()
        finally:
            sys.settrace(before)
            sys.setrecursionlimit(depth)
        self.refill()

    def refill(self) -> None:
        if self._begun_at >= 0:
            self.turns.append(self.counter.lines - self._begun_at)
            self._begun_at = self.counter.lines
            self.charged += self.budget - self.broker.meter.left
        super().refill()


Scene = Callable[[Big], Callable[[], object]]


def asked(process: Process, message: m.Message) -> Callable[[], object]:
    return lambda: process.tell(message)


# --- one for each message; preparations are not counted


def a_ping(world: Big) -> Callable[[], object]:
    return asked(world.process(), m.Ping(number=1))


def a_pong(world: Big) -> Callable[[], object]:
    return asked(world.process(), m.Pong(number=1))


def a_share(world: Big) -> Callable[[], object]:
    return world.process().share


def a_type_among_many(world: Big) -> Callable[[], object]:
    process = world.process()
    for number in range(many() // 10):
        process.declare_type((f"a/msg/T{number}", "h"))
    return lambda: process.declare_type(("a/msg/New", "h"))


def a_node_among_namesakes(world: Big) -> Callable[[], object]:
    process = world.process()
    for _ in range(many() // 4):
        process.node("same")
    return lambda: process.node("same")


def a_node_of_many_ends(world: Big) -> Callable[[], object]:
    process = world.process()
    node = process.node()
    for number in range(many() // 4):
        node.publisher(f"/t{number}")
    return asked(process, m.DestroyNode(node=node.id))


def a_node_whose_ends_all_match(world: Big) -> Callable[[], object]:
    process = world.process()
    node = process.node()
    for _ in range(int((many() // 2) ** 0.5)):
        node.publisher("/t")
        node.subscription("/t")
    return asked(process, m.DestroyNode(node=node.id))


def a_publisher_for_many(world: Big) -> Callable[[], object]:
    _listeners(world, many() // 4)
    talker = world.process()
    talker._own_node()
    return lambda: talker.publisher("/t")


def a_subscription_for_many(world: Big) -> Callable[[], object]:
    talker, listener = world.process(), world.process()
    for _ in range(many() // 4):
        talker.publisher("/t")
    listener._own_node()
    return lambda: listener.subscription("/t")


def a_late_joiner(world: Big) -> Callable[[], object]:
    world.process().publisher("/t", KEPT).publish_many("x" for _ in range(many()))
    listener = world.process()
    listener._own_node()
    return lambda: listener.subscription("/t", KEPT)


def a_late_joiner_when_all_has_expired(world: Big) -> Callable[[], object]:
    kept = QoSProfile(depth=100_000, durability="transient_local", lifespan=1.0)
    world.process().publisher("/t", kept).publish_many("x" for _ in range(many()))
    world.now_ns += 2 * SECOND
    listener = world.process()
    listener._own_node()
    return lambda: listener.subscription("/t", KEPT)


def one_comes_back_to_many(world: Big) -> Callable[[], object]:
    listener, again = world.process(), world.process()
    talker = world.process()
    for _ in range(many() // 4):
        talker.publisher("/t").publish("x")
    gone = listener.subscription("/t")
    listener.die()
    again._own_node()
    return lambda: again.subscription("/t", gid=gone.gid)


def an_endpoint_of_many_ends(world: Big) -> Callable[[], object]:
    _listeners(world, many() // 4)
    return world.process().publisher("/t").destroy


def a_deaf_subscription_ends(world: Big) -> Callable[[], object]:
    deaf = _deaf(world, 1)[0]
    world.process().publisher("/t").publish_many("x" for _ in range(many()))
    return deaf.destroy


def a_sign_of_life_to_many(world: Big) -> Callable[[], object]:
    qos = QoSProfile(liveliness="manual_by_topic", liveliness_lease_duration=1.0)
    _listeners(world, many() // 4, qos)
    publisher = world.process().publisher("/t", qos)
    world.advance(2)
    return asked(publisher.process, m.AssertLiveliness(publisher=publisher.id))


def an_ack_of_one_of_many(world: Big) -> Callable[[], object]:
    first, *_ = _listeners(world, many() // 4, KEEP_ALL)
    publisher = world.process().publisher("/t", KEEP_ALL)
    publisher.publish("x")
    return lambda: first.ack(publisher, 1)


def an_attach(world: Big) -> Callable[[], object]:
    publisher, subscriptions = _sharing(world, 1)
    return lambda: subscriptions[0].attach(publisher)


def a_refusal_with_history(world: Big) -> Callable[[], object]:
    publisher, subscriptions = _sharing(world, 1)
    return lambda: subscriptions[0].refuse(publisher)


def a_ring_is_left(world: Big) -> Callable[[], object]:
    publisher, (one,) = _sharing(world, 1)
    publisher.refuse(one)
    return asked(one.process, m.LeaveRing(subscription=one.id, source=publisher.id, seq=0))


def one_has_caught_up(world: Big) -> Callable[[], object]:
    publisher, (one,) = _sharing(world, 1)
    publisher.refuse(one)
    return lambda: publisher.catch_up(one)


def a_ring_of_many_is_replaced(world: Big) -> Callable[[], object]:
    publisher, _ = _sharing(world, many() // 4)
    return lambda: publisher.process.tell(m.ReplaceRing(publisher=publisher.id, descriptors=1), "ring new")


def a_ring_of_many_is_lost(world: Big) -> Callable[[], object]:
    publisher, _ = _sharing(world, many() // 4)
    return asked(publisher.process, m.ReplaceRing(publisher=publisher.id))


def a_report(world: Big) -> Callable[[], object]:
    publisher = world.process().publisher("/t")
    return asked(publisher.process, m.Report(endpoint=publisher.id, samples=1, bytes=1))


def the_graph(world: Big) -> Callable[[], object]:
    _graph_of_many(world)
    return asked(world.process(), m.GetGraph(request=1, statistics=True))


def the_graph_for_a_guest(world: Big) -> Callable[[], object]:
    _graph_of_many(world)
    return asked(world.process(uid=ALICE), m.GetGraph(request=1))


def a_type_for_a_guest(world: Big) -> Callable[[], object]:
    _graph_of_many(world)
    world.process().declare_type(("a/msg/Unused", "h"))
    return asked(world.process(uid=ALICE), m.GetType(request=1, type_name="a/msg/Unused", type_hash="h"))


def all_peers(world: Big) -> Callable[[], object]:
    _graph_of_many(world)
    for _ in range(200):
        world.process()
    return asked(world.process(), m.GetPeers(request=1))


def an_observer(world: Big) -> Callable[[], object]:
    _graph_of_many(world)
    return asked(world.process(uid=ALICE), m.Observe(request=1))


def busd_is_to_stop(world: Big) -> Callable[[], object]:
    return asked(world.process(), m.StopBroker(request=1))


def busd_is_to_reload(world: Big) -> Callable[[], object]:
    return asked(world.process(), m.Reload(request=1))


def other_rules(world: Big) -> Callable[[], object]:
    """For a guest that has much and sees much, and loses half of it."""
    own, guest = world.process(), world.process(uid=ALICE)
    for number in range(500 if is_nightly() else 125):
        own.publisher(f"/t{number}")
        own.subscription(f"/t{number}")
        guest.publisher(f"/guest{number}")
        guest.subscription(f"/t{number}")
    guest.request(m.Observe(request=1), m.GraphSnapshot)
    users, some = frozenset({ALICE}), frozenset(ACTIONS) - {"observe"}
    others = [AccessRule(topics=(f"/other{n}",), actions=some, uids=users) for n in range(300)]
    access = Access(UID, (*others, AccessRule(topics=("/guest*", "/t*"), actions=some, uids=users)))
    limits = world.broker.settings.limits
    return lambda: world.carry_out(world.broker.reconfigure(world.now_ns, limits, (), access))


HANDLERS: dict[type[m.Message], tuple[Scene, ...]] = {
    m.Ping: (a_ping,),
    m.Pong: (a_pong,),
    m.Share: (a_share,),
    m.DeclareType: (a_type_among_many,),
    m.CreateNode: (a_node_among_namesakes,),
    m.DestroyNode: (a_node_of_many_ends, a_node_whose_ends_all_match),
    m.CreatePublisher: (a_publisher_for_many,),
    m.CreateSubscription: (
        a_subscription_for_many,
        a_late_joiner,
        a_late_joiner_when_all_has_expired,
        one_comes_back_to_many,
    ),
    m.DestroyEndpoint: (an_endpoint_of_many_ends, a_deaf_subscription_ends),
    m.AssertLiveliness: (a_sign_of_life_to_many,),
    m.Ack: (an_ack_of_one_of_many,),
    m.Attach: (an_attach,),
    m.RefuseRoute: (a_refusal_with_history,),
    m.LeaveRing: (a_ring_is_left,),
    m.CaughtUp: (one_has_caught_up,),
    m.ReplaceRing: (a_ring_of_many_is_replaced, a_ring_of_many_is_lost),
    m.Report: (a_report,),
    m.GetGraph: (the_graph, the_graph_for_a_guest),
    m.GetType: (a_type_for_a_guest,),
    m.GetPeers: (all_peers,),
    m.Observe: (an_observer,),
    m.StopBroker: (busd_is_to_stop,),
    m.Reload: (busd_is_to_reload,),
}


# --- work without a control message


def a_run_for_many(world: Big) -> Callable[[], object]:
    _listeners(world, many() // 4)
    publisher = world.process().publisher("/t")
    return lambda: publisher.publish("a", "b")


def a_run_too_large_for_many(world: Big) -> Callable[[], object]:
    _listeners(world, many() // 4)
    publisher = world.process().publisher("/t")
    world.broker.graph.publishers[publisher.id].max_message_bytes = 1  # type: ignore[index]
    return lambda: publisher.publish("aa")


def a_run_for_deaf_ones(world: Big) -> Callable[[], object]:
    """The queues of all subscriptions are full."""
    _deaf(world, 60, QoSProfile(depth=many() // 4))
    publisher = world.process().publisher("/t")
    publisher.publish_many("x" for _ in range(many() // 4))
    return lambda: publisher.publish("x")


def a_long_run_for_deaf_ones_with_short_queues(world: Big) -> Callable[[], object]:
    """Each queue keeps the last sample of a run that all of them share."""
    _deaf(world, 60, QoSProfile(depth=1))
    publisher = world.process().publisher("/t", QoSProfile(1, durability="transient_local"))
    publisher.publish(*"x" * 1000)
    return lambda: publisher.publish(*"x" * 1000)


def a_long_run_for_deaf_ones_of_which_all_has_expired(world: Big) -> Callable[[], object]:
    _deaf(world, 60)
    publisher = world.process().publisher("/t", QoSProfile(lifespan=1.0))
    publisher.publish_many("x" for _ in range(many() // 4))
    world.now_ns += 2 * SECOND
    return lambda: publisher.publish(*"x" * 1000)


def a_deaf_process_reads_again_when_all_has_expired(world: Big) -> Callable[[], object]:
    deaf = _deaf(world, 60)
    publisher = world.process().publisher("/t", QoSProfile(lifespan=1.0))
    for _ in range(many() // 1000):
        publisher.publish(*"x" * 1000)
    world.now_ns += 2 * SECOND
    return lambda: world.broker.expire(world.now_ns, deaf[0].process.id)


def a_message_that_leaves_no_room_for_many_short_ones(world: Big) -> Callable[[], object]:
    (deaf,) = _deaf(world, 1)
    publisher = world.process().publisher("/t")
    publisher.publish_many("x" for _ in range(many()))
    account = deaf.process.world.broker._peers[deaf.process.id].queued
    account.limit = account.used
    return lambda: publisher.publish("x" * (account.used // 2))


def a_process_with_many_ends(world: Big) -> Callable[[], object]:
    _graph_of_many(world)
    return next(iter(world.processes.values())).die


def a_denial_that_many_are_told(world: Big) -> Callable[[], object]:
    _listeners(world, many() // 4)
    world.broker.settings.access.guard.access = Access(UID)
    guest = world.process(uid=ALICE)
    guest._own_node()
    guest.declare_type(TEXT)

    def ask() -> None:
        with pytest.raises(Exception, match="publish"):
            guest.publisher("/t")

    return ask


BESIDES: tuple[Scene, ...] = (
    a_run_for_many,
    a_run_too_large_for_many,
    a_run_for_deaf_ones,
    a_long_run_for_deaf_ones_with_short_queues,
    a_long_run_for_deaf_ones_of_which_all_has_expired,
    a_deaf_process_reads_again_when_all_has_expired,
    a_message_that_leaves_no_room_for_many_short_ones,
    a_process_with_many_ends,
    a_denial_that_many_are_told,
    other_rules,
)


# --- timers


def a_process_falls_silent(world: Big) -> Callable[[], object]:
    _listeners(world, many() // 4, KEEP_ALL)
    world.process().publisher("/t", KEEP_ALL)
    for one in world.processes.values():
        one.is_blocked = True
    return lambda: world.advance(11)


def leases_end(world: Big) -> Callable[[], object]:
    qos = QoSProfile(liveliness="automatic", liveliness_lease_duration=1.0)
    _listeners(world, many() // 40, qos)
    talker = world.process()
    for _ in range(10):
        talker.publisher("/t", qos)
    return lambda: world.advance(3)


def many_that_lapsed_are_heard_again(world: Big) -> Callable[[], object]:
    talker = world.process()
    for number in range(many() // 4):
        talker.publisher(f"/t{number}", QoSProfile(liveliness="automatic", liveliness_lease_duration=1.0))
    world.advance(3)

    def act() -> None:
        talker.tell(m.Ping(number=1))
        world.advance(0.1)

    return act


def drops_of_many_are_reported(world: Big) -> Callable[[], object]:
    _listeners(world, many() // 4)
    publisher = world.process().publisher("/t")
    publisher.publish("a")
    publisher.lose(1)
    publisher.publish("b")
    return lambda: world.advance(0.2)


def the_absent_are_given_up(world: Big) -> Callable[[], object]:
    talker, listener = world.process(), world.process()
    for number in range(many() // 4):
        talker.publisher(f"/t{number}").publish("x")
        listener.subscription(f"/t{number}")
    listener.die()
    world.now_ns += 599 * SECOND
    return lambda: world.advance(2)


def publishers_do_not_come_back(world: Big) -> Callable[[], object]:
    talker, listener, again = world.process(), world.process(), world.process()
    qos = QoSProfile(depth=5, durability="transient_local")
    gone = listener.subscription("/t", qos)
    for _ in range(1000):
        talker.publisher("/t", qos).publish("x")
    listener.die()
    talker.die()
    again.subscription("/t", qos, gid=gone.gid)
    return lambda: world.advance(11)


def the_killed_leave_many_places(world: Big) -> Callable[[], object]:
    listener, talker = world.process(), world.process(capabilities=(PLACES,))
    for _ in range(many() // 40):
        listener.subscription("/t", KEEP_ALL)
    for _ in range(10):
        talker.publisher("/t", KEEP_ALL)
    listener.die()
    return lambda: world.advance(0.2)


def publishers_do_not_come_back_to_repeat(world: Big) -> Callable[[], object]:
    listener, talker = world.process(), world.process(capabilities=(PLACES,))
    publishers = [talker.publisher("/t", KEEP_ALL) for _ in range(many() // 10)]
    for one in publishers:
        one.publish("x")
    listener.node().subscription("/t", KEEP_ALL, last_seqs={one.gid: 0 for one in publishers})
    talker.die()
    return lambda: world.advance(11)


TIMERS: dict[str, tuple[Scene, ...]] = {
    "report": (drops_of_many_are_reported,),
    "_check_publisher": (leases_end,),
    "_revive_some": (many_that_lapsed_are_heard_again,),
    "_go_on": (leases_end, a_process_falls_silent),
    "_settle_at_last": (publishers_do_not_come_back,),
    "_go_on_settling": (publishers_do_not_come_back,),
    "_check": (the_absent_are_given_up, a_process_falls_silent, the_killed_leave_many_places),
    "_miss": (publishers_do_not_come_back_to_repeat,),
}


def _listeners(world: World, number: int, qos: QoSProfile | None = None) -> list[Subscription]:
    listener = world.process()
    return [listener.subscription("/t", qos) for _ in range(number)]


def _deaf(world: World, number: int, qos: QoSProfile = DEEP) -> list[Subscription]:
    found = _listeners(world, number, qos)
    found[0].process.is_blocked = True
    return found


def _sharing(world: World, number: int) -> tuple[Publisher, list[Subscription]]:
    listener, talker = world.process(shares=True), world.process(shares=True)
    subscriptions = [listener.subscription("/t") for _ in range(number)]
    publisher = talker.publisher("/t")
    for slot, one in enumerate(subscriptions[1:]):
        one.attach(publisher, slot)
    return publisher, subscriptions


def _graph_of_many(world: World) -> None:
    process = world.process()
    for number in range(many() // 10):
        process.publisher(f"/t{number}")
        process.subscription(f"/t{number}")
        process.subscription("/all")
    process.publisher("/all")


def _scenes() -> Iterator[Scene]:
    for scenes in (*HANDLERS.values(), BESIDES, *TIMERS.values()):
        yield from scenes


@pytest.mark.parametrize("scene", dict.fromkeys(_scenes()), ids=lambda scene: scene.__name__)
def test_no_turn_does_too_much_and_all_is_charged(scene: Scene) -> None:
    world = Big()
    world.measure(scene(world))
    assert max(world.turns) <= LINES_OF_A_TURN, world.turns
    assert world.counter.lines <= LINES_PER_UNIT * (world.charged + BUDGET)


def test_every_message_has_an_entry() -> None:
    assert set(HANDLERS) == set(World().broker._handlers)


def test_every_timer_has_an_entry() -> None:
    assert set(_timers()) == set(TIMERS)


def _timers() -> Iterator[str]:
    """The names of the methods that the core gives to its timers."""
    for path in Path(busd.core.__path__[0]).glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            match node:
                case ast.Call(
                    func=ast.Attribute(value=ast.Attribute(attr="_timers"), attr="add"), args=[_, action]
                ):
                    if isinstance(action, ast.Lambda) and isinstance(action.body, ast.Call):
                        action = action.body.func
                    assert isinstance(action, ast.Attribute)
                    yield action.attr


def test_the_counter_sees_a_loop() -> None:
    """Otherwise all tests above would pass."""
    world = Big()
    process = world.process()
    for number in range(100):
        process.publisher(f"/t{number}")
    world.measure(lambda: [world.broker.graph.routed() for _ in range(10)])
    assert world.counter.lines > 1000
