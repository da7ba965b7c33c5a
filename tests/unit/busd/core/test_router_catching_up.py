"""busd.core.router: samples for one subscription alone, and subscriptions that know more than this busd."""

from typing import Any

from broker_endpoints import Publisher, Subscription
from broker_line import Line, Pair
from broker_world import World
from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.layout import MAX_RUN_SAMPLES
from bus.wire.runs import Run
from busd.core.effects import Flush
from busd.core.limits import Limits
from feeding import frame_record
from rows import for_each

ALL = QoSProfile(history="keep_all")
GID = bytes(15) + b"g"


def rerouted(offered: QoSProfile | None = None, requested: QoSProfile | None = None) -> Pair:
    """A pair whose match has left the ring. The subscription had read nothing."""
    pair = Pair(offered, requested)
    pair.subscription.refuse(pair.publisher)
    return pair


class TestAlone:
    """Samples for one subscription alone, because the others have got them."""

    def test_after_the_last_that_went_to_all_comes_the_next(self) -> None:
        pair = rerouted()
        plain = pair.world.process().subscription("/topic")
        pair.publisher.publish(*"abc")
        pair.publisher.catch_up(pair.subscription, *"abc")
        pair.publisher.publish("d")
        assert pair.subscription.payloads == plain.payloads == [*"abcd"]
        totals = pair.subscription.statistics()
        assert (totals.expected, totals.dropped) == (4, {})

    def test_it_is_within_the_depth(self) -> None:
        pair = rerouted(requested=QoSProfile(depth=2))
        pair.listener.is_blocked = True
        pair.publisher.catch_up(pair.subscription, *"abcde")
        assert pair.subscription.statistics(pair.talker).dropped == {"replaced": 3}
        pair.listener.unblock()
        assert pair.subscription.payloads == [*"de"]

    def test_it_expires(self) -> None:
        pair = rerouted(QoSProfile(lifespan=1.0))
        pair.listener.is_blocked = True
        pair.publisher.catch_up(pair.subscription, *"ab")
        pair.world.advance(2.0)
        pair.listener.unblock()
        assert pair.subscription.payloads == []
        assert pair.subscription.statistics().dropped == {"expired": 2}

    def test_what_waits_for_a_process_is_within_its_memory(self) -> None:
        world = World(Limits(queued_bytes_per_peer=2048, message_bytes=1024, keep_all_window_bytes=1024))
        talker, listener = world.process(shares=True), world.process(shares=True)
        kept = QoSProfile(depth=100, durability="transient_local", reliability="best_effort")
        publisher = talker.publisher("/topic", kept)
        subscription = listener.subscription("/topic", QoSProfile(depth=100, reliability="best_effort"))
        subscription.refuse(publisher)
        listener.is_blocked = True
        for _ in range(9):
            publisher.catch_up(subscription, "x" * 500)
        (record,) = (one for one in talker.request(m.GetPeers(request=0), m.Peers).peers if one.queued_bytes)
        assert record.queued_bytes <= 2048
        found = subscription.statistics(talker)
        assert found.queued + found.dropped["memory_limit"] == 9

    def test_subscriptions_are_not_told_how_it_came(self) -> None:
        pair = rerouted()
        run = Run(pair.publisher.id, 0, 1, 1, frame_record(b"x", 0), is_resumed=True)
        run.only_for = pair.subscription.id
        (effect,) = pair.world.broker.route(pair.world.now_ns, pair.talker.id, run)
        assert isinstance(effect, Flush)
        assert not effect.queue.runs[0].is_resumed

    def test_history_that_it_had_read_is_not_forgotten_by_what_is_older(self) -> None:
        pair = Pair(QoSProfile(depth=9, durability="transient_local"))
        pair.listener.has_read = 5
        pair.subscription.refuse(pair.publisher)
        run = Run(pair.publisher.id, 0, 2, 1, frame_record(b"2", 0), is_replay=True)
        run.only_for = pair.subscription.id
        pair.world.carry_out(pair.world.broker.route(pair.world.now_ns, pair.talker.id, run))
        pair.publisher.catch_up(pair.subscription)
        pair.publisher.publish(*"123456")
        assert [one.seq for one in pair.subscription.samples] == [2, 6]


class TestAhead:
    """The subscription knows numbers that its publisher sends again. Both were at an earlier busd."""

    def back(self, known: int, **more: Any) -> tuple[Publisher, Subscription]:
        world = World()
        back = world.process().subscription("/topic", last_seqs={GID: known})
        return world.process().publisher("/topic", gid=GID, **more), back

    @for_each("next_seq", [1, 2, 3, 4, 5])
    def test_nothing_comes_twice_wherever_its_publisher_begins(self, next_seq: int) -> None:
        publisher, back = self.back(3, next_seq=next_seq)
        publisher.publish(*"123456"[next_seq - 1 :])
        assert back.payloads == [*"456"[max(0, next_seq - 4) :]]

    def test_one_run_after_the_other(self) -> None:
        publisher, back = self.back(3)
        publisher.publish_many("12345")
        assert [(one.seq, one.payload) for one in back.samples] == [(4, "4"), (5, "5")]

    def test_from_then_on_it_is_there_like_all_others(self) -> None:
        """Samples by another route are for the subscriptions of that route. The subscription did not miss
        them.
        """
        publisher, back = self.back(2)
        publisher.publish(*"abc")
        publisher.resume(8)
        publisher.publish("h")
        totals = back.statistics()
        assert (back.payloads, totals.expected, totals.dropped) == (["c", "h"], 2, {})


@for_each("durability", ["volatile", "transient_local"])
@for_each(
    ("offered", "requested"), [("keep_all", "keep_all"), ("keep_all", "keep_last"), ("keep_last", "keep_all")]
)
def test_a_volatile_one_that_was_there_before(offered: str, requested: str, durability: str) -> None:
    """It gets the missed samples if both ends keep all and the publisher has a history. It continues in any
    case.
    """
    world = World()
    publisher = world.process().publisher("/topic", QoSProfile(history=offered, durability=durability))
    publisher.publish(*"abc")
    wanted = QoSProfile(history=requested)
    back = world.process().subscription("/topic", wanted, last_seqs={publisher.gid: 1})
    publisher.publish("d")
    is_repeated = offered == requested and durability == "transient_local"
    assert back.payloads == ["b", "c", "d"][0 if is_repeated else 2 :]


class TestTrimming:
    def test_is_asked_for_where_a_queue_has_too_much_and_no_more(self) -> None:
        """Otherwise each run would cost more, the more samples had overflowed before."""
        line = Line(requested=QoSProfile(depth=1))
        line.listener.is_blocked = True
        broker, talker, now_ns = line.world.broker, line.talker.id, line.world.now_ns
        asked = list[bool]()
        for seq in range(1, 5):
            if seq == 3:
                line.listener.unblock()
            effects = broker.route(now_ns, talker, Run(line.publisher.id, 0, seq, 1, frame_record(b"x", 0)))
            line.world.carry_out(effects)
            asked.append(broker.is_overfull)
            line.world.carry_out(broker.trim(now_ns))
        assert asked == [False, True, False, False]


def test_a_run_has_no_more_samples_than_a_run_can_have() -> None:
    line = Line()
    line.publisher.publish_body(MAX_RUN_SAMPLES, frame_record(b"", 0) * MAX_RUN_SAMPLES)
    assert len(line.subscription.samples) == MAX_RUN_SAMPLES
    line.publisher.publish_body(MAX_RUN_SAMPLES + 1, frame_record(b"", 0) * (MAX_RUN_SAMPLES + 1))
    assert line.talker.cut_reason == (
        f"data frame of {MAX_RUN_SAMPLES + 1} samples, a run has {MAX_RUN_SAMPLES} at most"
    )


def test_who_keeps_the_newest_only_gets_no_credit() -> None:
    publisher = World(Limits(keep_all_window_messages=8)).process().publisher("/topic", QoSProfile(depth=100))
    publisher.publish_many("x" * 100)
    assert publisher.got(m.Credit) == []
