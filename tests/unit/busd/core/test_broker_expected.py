"""busd.core: the number of samples that a subscription expects, also if one end comes back."""

import pytest

from broker_line import Line
from broker_world import World
from bus.qos import QoSProfile

DURABLE = QoSProfile(depth=5, durability="transient_local")


def accounted(line: Line) -> tuple[int, int]:
    """The expected samples, and the sum that they must equal: received, queued and dropped."""
    found = line.subscription.statistics(line.talker)
    return found.expected, len(line.subscription.samples) + found.queued + sum(found.dropped.values())


def come_back(line: Line, *, next_seq: int) -> None:
    """The publisher's process loses its connection and gets another one."""
    gid = line.publisher.gid
    line.talker.die()
    line.talker = line.world.process("talker")
    line.publisher = line.talker.node().publisher("/topic", DURABLE, gid=gid, next_seq=next_seq)


def test_lost_by_the_publisher_and_waiting() -> None:
    line = Line(requested=QoSProfile(depth=2))
    line.publisher.publish("before")
    line.publisher.lose(3)
    line.publisher.publish("after")
    line.listener.is_blocked = True
    line.publisher.publish_many("abc")
    assert line.dropped == {"publisher_queue": 3, "replaced": 1}
    assert accounted(line) == (8, 8)


def test_history_counts_and_what_was_before_does_not() -> None:
    world = World()
    talker, listener = world.process(), world.process()
    publisher = talker.publisher("/topic", DURABLE)
    publisher.publish_many("abc")
    late = listener.subscription("/topic", QoSProfile(depth=2, durability="transient_local"))
    new = listener.subscription("/topic")
    publisher.publish("d")
    assert late.statistics().expected == 3
    assert new.statistics().expected == 1
    publisher.destroy()
    assert (late.statistics().expected, new.statistics().expected) == (3, 1), "they count on"


class TestComingBack:
    def test_a_history_that_is_sent_again_is_not_routed_again(self) -> None:
        line = Line(DURABLE, QoSProfile(depth=1, durability="transient_local"))
        line.publisher.publish_many("abc")
        come_back(line, next_seq=1)
        line.listener.is_blocked = True
        line.publisher.publish("a", "b", "c")
        assert accounted(line) == (3, 3)
        line.publisher.publish("d", "e")
        assert line.dropped == {"replaced": 1}
        assert accounted(line) == (5, 5)
        line.listener.unblock()
        line.publisher.publish("f")
        assert line.subscription.payloads == ["a", "b", "c", "e", "f"]

    def test_what_is_new_in_a_run_is_routed(self) -> None:
        line = Line(DURABLE, DURABLE)
        line.publisher.publish_many("abc")
        come_back(line, next_seq=2)
        line.publisher.publish("b", "c", "d", "e")
        assert [sample.seq for sample in line.subscription.samples] == [1, 2, 3, 4, 5]
        assert line.subscription.payloads == ["a", "b", "c", "d", "e"]
        assert accounted(line) == (5, 5)

    def test_what_the_publisher_lost_meanwhile(self) -> None:
        line = Line(DURABLE, DURABLE)
        line.publisher.publish_many("abc")
        come_back(line, next_seq=3)
        line.publisher.lose(3)
        line.publisher.publish("f")
        assert line.dropped == {"publisher_queue": 2}  # 4 and 5; it had received the third sample
        assert accounted(line) == (6, 6)

    def test_a_subscription_that_knows_more_than_the_new_publisher(self) -> None:
        world = World()
        talker, listener = world.process(), world.process()
        publisher = talker.publisher("/topic", DURABLE)
        back = listener.node().subscription("/topic", DURABLE, last_seqs={publisher.gid: 2})
        publisher.publish_many("abc")
        assert back.payloads == ["c"]
        assert back.statistics().expected == 1

    @pytest.mark.parametrize("how", ["endpoint", "process"])
    def test_a_subscription_that_knows_more_and_goes_first(self, how: str) -> None:
        """The new publisher passes that number, and all other subscriptions receive its samples."""
        world = World()
        talker, listener = world.process(), world.process()
        publisher = talker.publisher("/topic", DURABLE)
        back = listener.node().subscription("/topic", last_seqs={publisher.gid: 2})
        other = world.process().subscription("/topic")
        back.destroy() if how == "endpoint" else listener.die()
        publisher.publish_many("abcd")
        assert other.payloads == [*"abcd"]
        assert talker.graph().matches == other.process.graph().matches
        assert (talker.cut_reason, back.payloads) == (None, [])

    @pytest.mark.parametrize("is_back", [True, False])
    def test_what_went_to_others_by_their_rings_meanwhile(self, is_back: bool) -> None:
        """These samples are lost for a subscription that was matched before. For a new one, they are no
        loss.
        """
        world = World()
        talker, listener = world.process(shares=True), world.process()
        publisher = talker.publisher("/topic")
        known = {publisher.gid: 0} if is_back else {}
        subscription = listener.node().subscription("/topic", last_seqs=known)
        publisher.resume(8)
        publisher.publish("h")
        totals = subscription.statistics()
        assert totals.dropped == ({"disconnected": 7} if is_back else {})
        assert totals.expected == (8 if is_back else 1)
