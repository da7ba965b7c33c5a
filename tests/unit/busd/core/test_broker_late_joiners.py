"""Late joiners: durability transient local, reference 1.4."""

import pytest

from broker_endpoints import Publisher
from broker_world import Process, Refusal, World
from bus.qos import QoSProfile
from bus.wire import messages as m
from busd.core.limits import Limits
from rows import for_each

KIB = 1024
KEPT = QoSProfile(durability="transient_local")
VOLATILE = QoSProfile()


def kept(depth: int, **more: object) -> QoSProfile:
    return QoSProfile(depth=depth, durability="transient_local", **more)  # type: ignore[arg-type]


def publishers(world: World, offered: QoSProfile, *histories: str) -> list[Publisher]:
    made = [world.process().publisher("/topic", offered) for _ in histories]
    for publisher, letters in zip(made, histories, strict=True):
        publisher.publish_many(letters)
    return made


class TestTable:
    def test_volatile_to_volatile(self) -> None:
        world = World()
        (publisher,) = publishers(world, VOLATILE, "abc")
        late = world.process().subscription("/topic")
        publisher.publish("new")
        assert late.payloads == ["new"]

    def test_transient_local_to_volatile(self) -> None:
        world = World()
        (publisher,) = publishers(world, KEPT, "abc")
        late = world.process().subscription("/topic")
        publisher.publish("new")
        assert late.payloads == ["new"]

    def test_volatile_to_transient_local(self) -> None:
        world = World()
        (publisher,) = publishers(world, VOLATILE, "abc")
        late = world.process().subscription("/topic", KEPT)
        publisher.publish("new")
        assert late.payloads == []
        assert late.got(m.Incompatible)

    @for_each("published", [0, 1, 2, 3, 5, 9])
    @for_each("wanted", [1, 2, 4, 7])
    @for_each("offered", [1, 3, 7])
    def test_transient_local_to_transient_local(self, offered: int, wanted: int, published: int) -> None:
        """A late joiner gets the last min(N, M, available) samples in order, before new ones."""
        world = World()
        (publisher,) = publishers(world, kept(offered), "abcdefghi"[:published])
        late = world.process().subscription("/topic", kept(wanted))
        publisher.publish("new")
        number = min(offered, wanted, published)
        assert late.payloads == [*"abcdefghi"[published - number : published], "new"]
        assert [sample.seq for sample in late.samples] == list(range(published - number + 1, published + 2))
        assert [sample.is_replay for sample in late.samples] == [True] * number + [False]
        assert late.statistics().dropped == {}

    @for_each(("offered", "got"), [(KEPT, [*"abc", "new"]), (VOLATILE, ["new"])])
    def test_one_that_takes_any_history(self, offered: QoSProfile, got: list[str]) -> None:
        """It matches transient-local publishers like a transient-local subscription. It matches all others,
        too.
        """
        world = World()
        (publisher,) = publishers(world, offered, "abc")
        late = world.process().subscription("/topic", takes_history=True)
        publisher.publish("new")
        assert late.payloads == got
        assert late.got(m.Matched)[0].qos.durability == offered.durability
        assert publisher.got(m.Matched)[0].qos.durability == offered.durability

    @for_each("takes_history", [False, True])
    def test_best_available_is_not_for_the_wire(self, takes_history: bool) -> None:
        world = World()
        with pytest.raises(Refusal, match="best_available is for subscriptions"):
            world.process().subscription(
                "/topic", QoSProfile(durability="best_available"), takes_history=takes_history
            )
        with pytest.raises(Refusal, match="best_available is for subscriptions"):
            world.process().publisher("/topic", QoSProfile(durability="best_available"))

    def test_keep_all(self) -> None:
        world = World()
        everything = QoSProfile(history="keep_all", durability="transient_local")
        publishers(world, everything, "abcdefghijklmnop")
        assert world.process().subscription("/topic", everything).payloads == [*"abcdefghijklmnop"]
        assert world.process().subscription("/topic", kept(2)).payloads == [*"op"]


class TestSeveralPublishers:
    def test_of_each_separately(self) -> None:
        world = World()
        first, second, _ = publishers(world, kept(3), "abcde", "x", "")
        late = world.process().subscription("/topic", kept(2))
        by_source = [
            [one.payload for one in late.samples if one.source == each.id] for each in (first, second)
        ]
        assert by_source == [["d", "e"], ["x"]]

    def test_all_fits_also_while_the_process_does_not_read(self) -> None:
        """The histories have room beside the depth, and new samples within it."""
        world = World()
        first, second = publishers(world, kept(3), "abc", "xyz")
        listener = world.process()
        listener.is_blocked = True
        late = listener.subscription("/topic", kept(3))
        first.publish_many("1234")
        listener.unblock()
        assert [one.payload for one in late.samples if one.source == second.id] == [*"xyz"]
        assert [one.payload for one in late.samples if one.source == first.id] == [*"bc1234"]
        assert late.statistics().dropped == {"replaced": 1}

    def test_history_dies_with_its_publisher(self) -> None:
        world = World()
        one, other = publishers(world, KEPT, "abc", "xyz")
        one.destroy()
        assert world.process().subscription("/topic", KEPT).payloads == [*"xyz"]
        other.process.die()
        assert world.process().subscription("/topic", KEPT).payloads == []


class TestReconnection:
    """A subscription that reports its last numbers gets only newer samples."""

    def late(self, world: World, last_seqs: dict[bytes, int]) -> list[str]:
        return world.process().subscription("/topic", kept(10), last_seqs=last_seqs).payloads

    @for_each(("last_seq", "expected"), [(0, "abc"), (1, "bc"), (2, "c"), (3, ""), (99, "")])
    def test_after_what_was_received(self, last_seq: int, expected: str) -> None:
        world = World()
        (publisher,) = publishers(world, KEPT, "abc")
        assert self.late(world, {publisher.gid: last_seq}) == [*expected]

    @pytest.mark.parametrize("history", ["keep_all", "keep_last"])
    def test_a_volatile_one_gets_what_it_missed_where_nothing_is_to_be_lost(self, history: str) -> None:
        world = World()
        offered = QoSProfile(history=history, durability="transient_local")
        (publisher,) = publishers(world, offered, "abc")
        requested = QoSProfile(history=history)
        back = world.process().subscription("/topic", requested, last_seqs={publisher.gid: 1})
        assert back.payloads == (["b", "c"] if history == "keep_all" else [])
        assert world.process().subscription("/topic", requested).payloads == [], "it is new"

    def test_of_each_publisher_its_own(self) -> None:
        world = World()
        one, other = publishers(world, KEPT, "abc", "xyz")
        assert sorted(self.late(world, {one.gid: 2, other.gid: 1})) == [*"cyz"]

    def test_an_unknown_publisher_does_not_matter(self) -> None:
        world = World()
        publishers(world, KEPT, "abc")
        assert self.late(world, {b"unknown": 2}) == [*"abc"]

    def test_of_how_many_it_is_kept(self) -> None:
        world = World()
        known = {number.to_bytes(16, "big"): 1 for number in range(1000)}
        back = world.process().subscription("/topic", KEPT, last_seqs=known)
        assert len(world.broker.graph.subscriptions[back.id].last_seqs) == 128

    def test_of_a_publisher_that_comes_later(self) -> None:
        """Repeated history of the publisher is not queued, and is no loss if there is no room."""
        world = World()
        listener = world.process()
        back = listener.subscription("/topic", kept(1), last_seqs={bytes(15) + b"g": 3})
        publisher = world.process().publisher("/topic", KEPT, gid=bytes(15) + b"g")
        listener.is_blocked = True
        publisher.publish("a", "b", "c")
        assert back.statistics().queued == 0
        publisher.publish("d")
        listener.unblock()
        assert back.payloads == ["d"]
        assert back.statistics().dropped == {}


class TestLifespan:
    def test_a_late_joiner_gets_nothing_expired(self) -> None:
        """The late joiner does not learn of a loss either: these samples were never for it."""
        world = World()
        (publisher,) = publishers(world, kept(10, lifespan=5.0), "ab")
        world.advance(4)
        publisher.publish("c")
        world.advance(2)
        late = world.process().subscription("/topic", kept(10))
        assert late.payloads == ["c"]
        assert late.statistics().dropped == {}


class TestMemory:
    LIMITS = Limits(
        history_bytes_per_peer=10 * KIB,
        queued_bytes_per_peer=15 * KIB,
        message_bytes=2 * KIB,
        keep_all_window_bytes=KIB,
    )

    def account(self, process: Process, kind: str) -> int:
        used: int = getattr(process.world.broker._peers[process.id], kind).used
        return used

    def test_history_is_bounded(self) -> None:
        world = World(self.LIMITS)
        (publisher,) = publishers(world, kept(1000), "")
        for at in range(50):
            publisher.publish(f"{at:1000}")
            assert self.account(publisher.process, "history") <= 10 * KIB
        late = world.process().subscription("/topic", kept(1000))
        assert [int(payload) for payload in late.payloads] == list(range(42, 50))

    def test_history_is_given_back(self) -> None:
        world = World(self.LIMITS)
        (publisher,) = publishers(world, KEPT, "abc")
        publisher.destroy()
        assert self.account(publisher.process, "history") == 0

    def test_replays_count_as_bytes_that_wait(self) -> None:
        """A process that subscribes again and again and never reads does not make busd hold more."""
        world = World(self.LIMITS)
        for publisher in publishers(world, kept(8), "", "", ""):
            for _ in range(8):
                publisher.publish("x" * 1000)
        listener = world.process()
        listener.is_blocked = True
        subscriptions = []
        for _ in range(5):
            subscriptions.append(listener.subscription("/topic", kept(8)))
            assert self.account(listener, "queued") <= 15 * KIB
        listener.unblock()
        for subscription in subscriptions:
            lost = subscription.statistics().dropped.get("memory_limit", 0)
            assert len(subscription.payloads) + lost == 24
        assert sum(subscription.statistics().dropped.get("memory_limit", 0) for subscription in subscriptions)
