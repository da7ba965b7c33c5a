"""A publisher with many subscriptions: each process hands its runs over in its own turns, and none is
lost.
"""

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from broker_endpoints import Publisher, Subscription
from broker_world import Process, World
from bus.qos import QoSProfile
from bus.wire.runs import Run
from busd.core.effects import Flush, Later
from busd.core.limits import Limits
from effort import examples
from feeding import frame_record

MANY = 200
KEEP_ALL = QoSProfile(history="keep_all")
TENTH = 30
"""A budget with which a run for MANY takes several turns."""


class Stage:
    """A publisher, a process with many subscriptions, and a process with a single one."""

    def __init__(
        self, qos: QoSProfile | None = None, *, many: int = MANY, limits: Limits | None = None
    ) -> None:
        self.world = World(limits)
        self.crowd, self.other, self.talker = (self.world.process() for _ in range(3))
        self.many = [self.crowd.subscription("/t", qos) for _ in range(many)]
        self.single = self.other.subscription("/t", qos)
        self.publisher = self.talker.publisher("/t", qos)
        self.world.budget = TENTH

    def core(self) -> Any:
        return self.world.broker.graph.publishers[self.publisher.id]  # type: ignore[index]

    def once_between(self, action: Callable[[], object]) -> None:
        """Do `action` once, after the first of the next turns."""

        def act() -> None:
            self.world.between = lambda: None
            action()

        self.world.between = act


def accounts(subscription: Subscription) -> tuple[int, int, dict[str, int]]:
    """The expected samples, the received samples, and busd's drops."""
    found = subscription.statistics()
    return found.expected, len(subscription.samples), found.dropped


class TestThePrice:
    def test_the_publisher_pays_for_processes(self) -> None:
        stage = Stage()
        broker = stage.world.broker
        broker.meter.left = 1000
        run = Run(stage.publisher.id, 0, 1, 1, frame_record(b"a", 0))
        effects = broker.route(stage.world.now_ns, stage.talker.id, run)
        assert broker.meter.left > 1000 - 20 - MANY // 16
        assert [one.peer for one in effects if isinstance(one, Flush)] == [stage.other.id]
        assert [one.peer for one in effects if isinstance(one, Later)] == [stage.crowd.id]

    def test_the_process_of_many_pays_for_them_in_turns(self) -> None:
        stage, turns = Stage(), 0

        def count() -> None:
            nonlocal turns
            turns += 1
            assert stage.world.broker.meter.left > -64

        stage.world.between = count
        stage.publisher.publish("a")
        assert turns > 2
        assert all(one.payloads == ["a"] for one in stage.many)

    def test_what_waits_is_gathered(self) -> None:
        stage = Stage(QoSProfile(depth=100))
        stage.once_between(lambda: stage.publisher.publish_many(map(str, range(50))))
        stage.publisher.publish("first")
        texts = ["first", *map(str, range(50))]
        assert all(one.payloads == texts for one in [*stage.many, stage.single])


class TestNothingIsLost:
    def test_one_that_joins_meanwhile_gets_what_comes_after(self) -> None:
        stage, late = Stage(), list[Subscription]()

        def join() -> None:
            stage.publisher.publish("before")
            late.append(stage.crowd.subscription("/t"))
            stage.publisher.publish("after")

        stage.once_between(join)
        stage.publisher.publish("first")
        assert late[0].payloads == ["after"]
        assert all(one.payloads == ["first", "before", "after"] for one in stage.many)
        assert accounts(late[0]) == (1, 1, {})

    @pytest.mark.parametrize("at", [0, MANY - 1])
    def test_one_leaves_meanwhile(self, at: int) -> None:
        stage = Stage()
        leaving = stage.many[at]

        def leave() -> None:
            stage.publisher.publish("second")
            leaving.destroy()
            stage.publisher.publish("third")

        stage.once_between(leave)
        stage.publisher.publish("first")
        assert leaving.payloads in ([], ["first"])  # the first one, or nothing: it is leaving
        assert all(one.payloads == ["first", "second", "third"] for one in stage.many if one is not leaving)

    def test_the_publisher_ends_meanwhile(self) -> None:
        stage = Stage()
        stage.once_between(stage.publisher.destroy)
        stage.publisher.publish("a", "b")
        assert all(one.payloads == ["a", "b"] for one in stage.many)

    def test_their_process_dies_meanwhile(self) -> None:
        stage = Stage()

        def die() -> None:
            stage.publisher.publish("second")
            stage.crowd.die()

        stage.once_between(die)
        stage.publisher.publish("first")
        stage.publisher.publish("third")
        assert stage.single.payloads == ["first", "second", "third"]
        assert stage.core().crowds == {}
        assert not stage.world.broker.tasks.has_work(stage.crowd.id)

    def test_few_are_left(self) -> None:
        """From then on, a run goes to each subscription at once again, but not before queued runs."""
        stage = Stage()

        def leave() -> None:
            for one in stage.many[5:]:
                one.destroy()
            stage.publisher.publish("second")

        stage.once_between(leave)
        stage.publisher.publish("first")
        stage.publisher.publish("third")
        assert all(one.payloads == ["first", "second", "third"] for one in stage.many[:5])
        assert stage.core().crowds == {}

    def test_another_process_of_many_dies_and_few_are_left(self) -> None:
        """Most of the few have not got the first run yet, and the next run must not overtake it."""
        stage = Stage(many=MANY // 4)
        dying = stage.world.process()
        for _ in range(MANY):
            dying.subscription("/t")

        def die() -> None:
            dying.die()
            assert any(crowd.has_news for crowd in stage.core().crowds.values())
            stage.publisher.publish("second")

        stage.once_between(die)
        stage.publisher.publish("first")
        assert all(one.payloads == ["first", "second"] for one in [*stage.many, stage.single])

    def test_busd_ends_meanwhile(self) -> None:
        stage = Stage()
        world = stage.world
        stage.once_between(lambda: world.carry_out(world.broker.farewell(world.now_ns)))
        stage.publisher.publish("a")
        assert all(one.payloads == ["a"] for one in stage.many)


class TestLosses:
    def test_no_more_waits_than_the_deepest_has_room_for(self) -> None:
        stage = Stage(QoSProfile(depth=3))
        deep = stage.crowd.subscription("/t", QoSProfile(depth=5))
        stage.once_between(lambda: [stage.publisher.publish(f"{at:40000}") for at in range(20)])
        stage.publisher.publish("first")
        # It had not received the first one.
        assert [int(text) for text in deep.payloads] == list(range(15, 20))
        assert accounts(deep) == (21, 5, {"replaced": 16})
        for one in stage.many:
            expected, came, dropped = accounts(one)
            assert (expected, came + dropped["replaced"], list(dropped)) == (21, 21, ["replaced"])

    def test_a_gap_counts_for_each(self) -> None:
        stage = Stage()

        def publish() -> None:
            stage.publisher.lose(7)
            stage.publisher.publish("after")

        stage.once_between(publish)
        stage.publisher.publish("before")
        for one in (*stage.many, stage.single):
            assert one.payloads == ["before", "after"]
            assert accounts(one) == (9, 2, {"publisher_queue": 7})

    def test_what_went_by_another_route_is_not_lost(self) -> None:
        stage = Stage()

        def publish() -> None:
            stage.publisher.resume(8)
            stage.publisher.publish("after")

        stage.once_between(publish)
        stage.publisher.publish("before")
        assert all(accounts(one) == (2, 2, {}) for one in (*stage.many, stage.single))

    def test_a_message_that_is_too_large(self) -> None:
        stage = Stage(limits=Limits(message_bytes=1024, keep_all_window_bytes=1024))
        stage.publisher.publish("a", "x" * 1025)
        stage.publisher.publish("b")
        assert all(accounts(one) == (3, 1, {"too_large": 2}) for one in stage.many)

    def test_their_process_holds_too_much(self) -> None:
        small = Limits(message_bytes=1024, keep_all_window_bytes=1024, queued_bytes_per_peer=20_000)
        stage = Stage(QoSProfile(history="keep_all", reliability="best_effort"), limits=small)
        stage.crowd.is_blocked = True
        stage.once_between(lambda: stage.publisher.publish_many(f"{at:900}" for at in range(40)))
        stage.publisher.publish("first")
        assert stage.world.broker._peers[stage.crowd.id].queued.used <= 20_000 + 1024
        stage.crowd.unblock()
        stage.world.carry_out([])
        for one in stage.many:
            expected, came, dropped = accounts(one)
            assert (expected, came + dropped["memory_limit"]) == (41, 41)

    def test_a_lossless_publisher_waits_for_all_and_loses_nothing(self) -> None:
        stage = Stage(KEEP_ALL)
        stage.once_between(lambda: stage.publisher.publish_many("bcd"))
        stage.publisher.publish("a")
        assert all("".join(one.payloads) == "abcd" for one in stage.many)
        for one in (*stage.many, stage.single):
            assert len(stage.core().awaited) == MANY + 1
            one.ack(stage.publisher, 4)
        assert stage.core().credited == 4


@st.composite
def _stories(draw: st.DrawFn) -> list[tuple[str, int]]:
    deeds = st.sampled_from(
        ["publish", "publish", "publish", "large", "lose", "join", "leave", "block", "unblock"]
    )
    return draw(st.lists(st.tuples(deeds, st.integers(0, 80)), min_size=3, max_size=25))


@settings(max_examples=examples(200))
@given(story=_stories(), depth=st.sampled_from([0, 1, 4, 50]), budget=st.sampled_from([10, TENTH, 1000]))
def test_every_sample_comes_once_and_in_order_or_is_counted(
    story: list[tuple[str, int]], depth: int, budget: int
) -> None:
    qos = QoSProfile(depth=depth) if depth else QoSProfile(history="keep_all", reliability="best_effort")
    stage = Stage(qos, many=66)
    world, publisher, crowd = stage.world, stage.publisher, stage.crowd
    world.budget = budget
    there = [*stage.many]
    left = list(reversed(story))

    def act() -> None:
        if left:
            _act(*left.pop(), there, publisher, crowd, qos)

    world.between = act
    publisher.publish("1")
    while left:
        act()
    world.between = lambda: None
    crowd.unblock()
    world.carry_out([])
    for one in there:
        expected, came, dropped = accounts(one)
        assert expected == came + sum(dropped.values())
        assert expected == publisher.next_seq - 1 or one not in stage.many
        seqs = [sample.seq for sample in one.samples]
        assert seqs == sorted(set(seqs))
        assert all(int(sample.payload) == sample.seq for sample in one.samples)


def _act(
    deed: str,
    number: int,
    there: list[Subscription],
    publisher: Publisher,
    crowd: Process,
    qos: QoSProfile,
) -> None:
    seq = publisher.next_seq
    match deed:
        case "publish":
            publisher.publish(*(str(seq + at) for at in range(1 + number % 3)))
        case "large":
            publisher.publish(f"{seq:40000}")
        case "lose":
            publisher.lose(number)
            publisher.publish(str(publisher.next_seq))
        case "join":
            there.append(crowd.subscription("/t", qos))
        case "leave" if len(there) > 1:
            there.pop(number % len(there)).destroy()
        case "block":
            crowd.is_blocked = True
        case "unblock":
            crowd.unblock()
