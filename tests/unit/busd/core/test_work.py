"""The broker does long work in pieces. Each piece does at most one step too much, for every request.

The broker serves other processes between two pieces. Their view, and the effect of their requests, must be
the same as if all the work had been done at once.
"""

from collections.abc import Callable

import pytest

from broker_world import UID, Process, World, whole_graph
from bus.qos import QoSProfile
from bus.wire import messages as m
from busd.core.access import Access, AccessRule
from busd.core.limits import Limits
from busd.core.timers import NEVER_NS, Timers
from busd.core.work import MATCH, Meter, Rounds

MANY = 200
BUDGET = 100
STEP = 80
"""More than the most expensive single step, with the messages to the observers of the world."""
KEEP_ALL = QoSProfile(history="keep_all")
ALICE = 1001


@pytest.fixture
def world() -> World:
    """A world that did all its work at once before the test."""
    return World(Limits(matches_per_peer=1 << 20, matches_per_user=1 << 20))


def measure(world: World, action: Callable[[], object]) -> int:
    """Do `action` in pieces. Returns their number."""
    pieces = 0

    def count() -> None:
        nonlocal pieces
        pieces += 1

    world.budget, world.between, world.overdrawn = BUDGET, count, 0
    action()
    assert not world.broker.tasks.unfinished
    assert world.overdrawn <= STEP
    return pieces


class TestTheBudget:
    def test_a_publisher_with_many_subscriptions(self, world: World) -> None:
        listener, talker = world.process(), world.process()
        for _ in range(MANY):
            listener.subscription("/t")
        talker._own_node()
        assert measure(world, lambda: talker.publisher("/t")) >= MANY * MATCH // (BUDGET + STEP)

    def test_a_subscription_with_many_publishers(self, world: World) -> None:
        listener, talker = world.process(), world.process()
        for _ in range(MANY):
            talker.publisher("/t")
        assert measure(world, lambda: listener.subscription("/t")) >= MANY * MATCH // (BUDGET + STEP)

    def test_many_that_do_not_match(self, world: World) -> None:
        listener, talker = world.process(), world.process()
        for _ in range(MANY):
            talker.publisher("/t", QoSProfile(reliability="best_effort"))
        assert measure(world, lambda: listener.subscription("/t")) >= MANY * MATCH // (BUDGET + STEP)
        assert len(listener.got(m.Incompatible)) == MANY

    def test_one_of_many_is_destroyed(self, world: World) -> None:
        listener, talker = world.process(), world.process()
        for _ in range(MANY):
            listener.subscription("/t")
        publisher = talker.publisher("/t")
        assert measure(world, lambda: publisher.destroy()) > MANY // 20
        assert not world.whole_graph().matches

    @pytest.mark.parametrize("end", ["dies", "destroys its node", "is cut off"])
    def test_the_end_of_one_with_many(self, world: World, end: str) -> None:
        other, process = world.process(), world.process()
        for number in range(20):
            other.subscription("/t")
            process.publisher("/t")
            process.subscription(f"/alone_{number}")
        node = process._own_node()
        match end:
            case "dies":
                pieces = measure(world, process.die)
            case "destroys its node":
                pieces = measure(world, lambda: process.tell(m.DestroyNode(node=node.id)))
            case _:
                pieces = measure(world, lambda: process.tell(m.DestroyEndpoint(endpoint=9999)))
        assert pieces > 40
        graph = world.whole_graph()
        assert len(graph.endpoints) == 20 and not graph.matches
        assert len(other.got(m.Unmatched)) == 400

    @pytest.mark.parametrize("statistics", [True, False])
    def test_a_question_for_the_graph(self, world: World, statistics: bool) -> None:
        process, asker = world.process(), world.process()
        for number in range(MANY):
            process.subscription(f"/t{number}")
        world.budget = BUDGET
        answers: list[m.GraphSnapshot] = []
        pieces = measure(world, lambda: answers.append(asker.graph(statistics=statistics)))
        assert pieces >= 2 * MANY // (BUDGET + STEP)
        assert answers == [
            whole_graph_like(world, answers[0], statistics=statistics),
        ]

    def test_a_question_of_one_who_may_not_see_everything(self) -> None:
        see = AccessRule(topics=("/t1*",), actions=frozenset({"observe"}), is_for_all=True)
        world = World(access=(see,))
        process, alice = world.process(), world.process(uid=ALICE)
        for number in range(MANY):
            process.subscription(f"/t{number}")
        answers: list[m.GraphSnapshot] = []
        assert measure(world, lambda: answers.append(alice.graph())) > 5
        assert len(answers[0].endpoints) == 111  # 1, 10 to 19 and 100 to 199

    def test_a_run_for_many(self, world: World) -> None:
        listener, talker = world.process(), world.process()
        subscriptions = [listener.subscription("/t") for _ in range(10 * MANY)]
        publisher = talker.publisher("/t")
        assert measure(world, lambda: publisher.publish("x")) > 5
        assert all(one.payloads == ["x"] for one in subscriptions)

    def test_a_gap_for_many(self, world: World) -> None:
        listener, talker = world.process(), world.process()
        subscriptions = [listener.subscription("/t") for _ in range(10 * MANY)]
        publisher = talker.publisher("/t")
        publisher.publish("x")
        publisher.next_seq += 3
        assert measure(world, lambda: publisher.publish("y")) > 5
        for one in subscriptions[:: MANY // 4]:
            assert one.statistics(talker).dropped == {"publisher_queue": 3}

    def test_a_gap_and_one_too_large_for_many(self) -> None:
        world = World(Limits(message_bytes=1024, matches_per_peer=1 << 20, matches_per_user=1 << 20))
        listener, talker = world.process(), world.process()
        subscriptions = [listener.subscription("/t") for _ in range(10 * MANY)]
        publisher = talker.publisher("/t")
        publisher.publish("x")
        publisher.next_seq += 3
        assert measure(world, lambda: publisher.publish("y" * 2000)) > 10
        for one in subscriptions[:: MANY // 4]:
            assert one.statistics(talker).dropped == {"publisher_queue": 3, "too_large": 1}

    def test_many_publishers_that_lose_their_liveliness_and_come_back(self, world: World) -> None:
        listener, talker = world.process(), world.process()
        for _ in range(MANY):
            listener.subscription("/t")
        for _ in range(10):
            talker.publisher("/t", QoSProfile(liveliness_lease_duration=1.0))
        listener.tell(m.Ping())

        def lose_and_revive() -> None:
            for _ in range(4):
                world.advance(0.5)
                listener.tell(m.Ping())
            talker.tell(m.Ping())
            world.advance(0.001)

        measure(world, lose_and_revive)
        news = listener.got(m.LivelinessChanged)
        assert [one.alive for one in news] == [False] * 10 * MANY + [True] * 10 * MANY

    def test_many_timers(self, world: World) -> None:
        listener, talker = world.process(), world.process()
        for number in range(MANY):
            listener.subscription(f"/t{number}", QoSProfile(1))
        publishers = [talker.publisher(f"/t{number}", QoSProfile(1)) for number in range(MANY)]
        listener.is_blocked = True
        for publisher in publishers:
            publisher.publish("one", "two")
        measure(world, lambda: world.advance(1))
        listener.unblock()
        listener.read()
        assert len(listener.got(m.Dropped)) == MANY


def whole_graph_like(world: World, answer: m.GraphSnapshot, *, statistics: bool) -> m.GraphSnapshot:
    """The graph now. The answer must equal it."""
    whole = whole_graph(world.broker.graph, statistics=statistics)
    assert (whole.nodes, whole.endpoints, whole.matches) == (answer.nodes, answer.endpoints, answer.matches)
    return answer


class TestMeanwhile:
    """Events between two pieces."""

    @pytest.fixture
    def listener(self, world: World) -> Process:
        return world.process("listener")

    def test_others_are_told_first(self, world: World, listener: Process) -> None:
        """The endpoint's own process learns of it after all others, and then in order."""
        talker = world.process("talker")
        publishers = [talker.publisher("/t") for _ in range(20)]
        listener._own_node()
        before, seen = len(listener.sent), list[tuple[int, int]]()
        world.between = lambda: seen.append((len(talker.got(m.Matched)), len(listener.sent) - before))
        world.budget = 1
        subscription = listener.subscription("/t")
        assert seen[5][0] > 0
        assert all(own == 0 or others == 20 for others, own in seen)
        news = listener.sent[before:]
        kinds = [
            type(one) for one in news if getattr(one, "endpoint", 0) == subscription.id or one is news[0]
        ]
        assert kinds == [m.Created] + [m.Matched] * 20
        assert {one.other for one in listener.got(m.Matched)} == {one.id for one in publishers}

    def test_samples_wait_until_the_process_knows_the_subscription(
        self, world: World, listener: Process
    ) -> None:
        """All samples published while it was made arrive in order, after Created."""
        talker = world.process("talker")
        publishers = [talker.publisher("/t") for _ in range(20)]
        listener._own_node()

        def publish() -> None:
            world.between = lambda: None
            if listener.got(m.Created)[-1].id == listener._own_node().id:
                publishers[0].publish("meanwhile")
                world.between = publish

        world.budget, world.between = 1, publish
        subscription = listener.subscription("/t", QoSProfile(100))
        world.between = lambda: None
        publishers[0].publish("after")
        assert set(subscription.payloads[:-1]) == {"meanwhile"}
        assert subscription.payloads[-1] == "after"
        numbers = [one.seq for one in listener.samples[subscription.id]]
        assert numbers == sorted(set(numbers))

    def test_one_that_is_to_be_matched_goes(self, world: World, listener: Process) -> None:
        talker = world.process("talker")
        publishers = [talker.publisher("/t") for _ in range(20)]
        listener._own_node()

        def destroy() -> None:
            world.between = lambda: None
            publishers[0].destroy()  # matched already
            publishers[-1].destroy()  # not matched yet

        world.budget, world.between = 60, destroy
        subscription = listener.subscription("/t")
        graph = world.whole_graph()
        assert len(graph.matches) == 18
        matched = {one.other for one in listener.got(m.Matched) if one.endpoint == subscription.id}
        unmatched = {one.other for one in listener.got(m.Unmatched)}
        assert matched - unmatched == {one.publisher for one in graph.matches}

    def test_one_comes_that_matches_too(self, world: World, listener: Process) -> None:
        talker, other = world.process("talker"), world.process("other")
        for _ in range(20):
            talker.publisher("/t")
        listener._own_node()
        other._own_node()

        def create() -> None:
            world.between = lambda: None
            other.publisher("/t")

        world.budget, world.between = 60, create
        subscription = listener.subscription("/t")
        matched = [one.other for one in listener.got(m.Matched) if one.endpoint == subscription.id]
        assert len(matched) == len(set(matched)) == 21

    def test_its_process_dies(self, world: World, listener: Process) -> None:
        talker = world.process("talker")
        for _ in range(20):
            talker.publisher("/t")
        listener._own_node()
        before = world.whole_graph()

        def die() -> None:
            world.between = lambda: None
            listener.die()

        world.budget, world.between = 60, die
        with pytest.raises(ValueError):  # no answer comes
            listener.subscription("/t")
        assert not world.broker.tasks.unfinished
        graph = world.whole_graph()
        assert not graph.matches and len(graph.endpoints) == len(before.endpoints)
        assert len(talker.got(m.Unmatched)) == len(talker.got(m.Matched)) > 0

    def test_two_that_are_made_at_the_same_time_match_once(self, world: World) -> None:
        listener, talker = world.process(), world.process()
        listener._own_node()
        talker._own_node()

        def subscribe() -> None:
            world.between = lambda: None
            listener.subscription("/t")

        world.budget, world.between = 1, subscribe
        talker.publisher("/t")
        assert len(talker.got(m.Matched)) == len(listener.got(m.Matched)) == 1
        listener.die()
        assert not world.broker.graph._matches

    @pytest.mark.parametrize("asks", [False, True])
    def test_the_rules_change_meanwhile(self, world: World, asks: bool) -> None:
        """The broker finishes all messages that it has begun."""
        listener, talker = world.process(), world.process()
        for _ in range(20):
            talker.publisher("/t")
        listener._own_node()

        def renew() -> None:
            world.between = lambda: None
            world.broker.reconfigure(world.now_ns, world.broker.settings.limits, (), Access(UID))

        world.budget, world.between = 5 if asks else 60, renew
        if asks:
            listener.tell(m.GetGraph(request=77))
            assert len(listener.got(m.GraphSnapshot)) == 1
        else:
            listener.subscription("/t")
            assert len(listener.got(m.Matched)) == 20

    def test_an_observer_misses_nothing_and_hears_nothing_twice(self, world: World) -> None:
        process, observer = world.process(), world.process()
        for number in range(50):
            process.subscription(f"/t{number}")
        made = []

        def change() -> None:
            world.between = lambda: None
            made.append(process.subscription("/new"))
            world.between = change if len(made) < 3 else lambda: None

        world.budget, world.between = 10, change
        answer = observer.request(m.Observe(request=0), m.GraphSnapshot)
        kinds = [type(one) for one in observer.messages if isinstance(one, m.GraphSnapshot | m.GraphChanged)]
        assert kinds[0] is m.GraphSnapshot and len(made) > 1
        news = [one for one in observer.got(m.GraphChanged) if one.revision <= answer.revision]
        assert not news
        known = {one.id for one in answer.endpoints}
        for one in observer.got(m.GraphChanged):
            fresh = {endpoint.id for endpoint in one.endpoints_added}
            assert not fresh & known
            known |= fresh
        assert known == {one.id for one in world.whole_graph().endpoints}

    def test_the_process_of_a_run_for_many_dies(self, world: World) -> None:
        """The run that it had sent still goes to all."""
        listener, talker = world.process(), world.process()
        subscriptions = [listener.subscription("/t") for _ in range(MANY)]
        publisher = talker.publisher("/t")

        def die() -> None:
            world.between = lambda: None
            talker.die()

        world.budget, world.between = 10, die
        publisher.publish("x")
        assert all(one.payloads == ["x"] for one in subscriptions)


def test_rounds_go_on_between_other_work_one_after_the_other() -> None:
    timers, meter, seen = Timers(), Meter(100), list[tuple[int, str, int]]()
    rounds = Rounds[str, int](timers, meter, lambda *visit: seen.append(visit), few=2, price=3)
    rounds.begin(10, "a", iter(range(4)))
    rounds.begin(10, "b", iter(range(1)))
    assert (seen, meter.left) == ([(10, "a", 0), (10, "a", 1)], 94)
    for now_ns in (20, 30, 40):
        for action in [*timers.due(now_ns)]:
            action(now_ns)
    assert seen[2:] == [(20, "a", 2), (20, "a", 3), (40, "b", 0)]
    assert (meter.left, timers.earliest_ns) == (85, NEVER_NS)
    rounds.begin(50, "c", iter(range(1)))
    assert seen[-1] == (50, "c", 0)
