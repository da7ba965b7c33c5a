"""busd.core: runs that the shell may pass on as they are. They count as if busd had routed them."""

from broker_line import Line
from broker_world import World
from bus.base.ids import EndpointId
from bus.qos import QoSProfile
from bus.wire.layout import MAX_RUN_SAMPLES
from busd.core.limits import TopicRule
from rows import for_each

KEEP_ALL = QoSProfile(history="keep_all")


def ways(world: World) -> int:
    """The number of runs passed on since the last call."""
    count, world.passed_on = world.passed_on, 0
    return count


def test_one_for_one_that_has_nothing_waiting() -> None:
    line = Line()
    line.publisher.publish("a", "b")
    line.publisher.publish("c")
    assert [payload for _, _, payload, *_ in line.subscription.samples] == ["a", "b", "c"]
    assert ways(line.world) == 2
    assert line.publisher.statistics().samples == 3
    assert line.publisher.statistics().bytes == 3
    assert line.subscription.statistics().expected == 3


def test_order_is_kept_where_something_waits() -> None:
    line = Line()
    line.listener.is_blocked = True
    line.publisher.publish("a")
    line.publisher.publish("b")
    assert ways(line.world) == 0
    line.listener.unblock()
    line.publisher.publish("c")
    assert ways(line.world) == 1
    assert line.subscription.payloads == ["a", "b", "c"]


@for_each(
    "qos",
    [
        QoSProfile(durability="transient_local"),
        QoSProfile(liveliness="manual_by_topic", liveliness_lease_duration=5.0),
        QoSProfile(liveliness_lease_duration=5.0),
    ],
)
def test_not_where_more_is_to_be_done(qos: QoSProfile) -> None:
    line = Line(offered=qos)
    line.publisher.publish("a")
    assert ways(line.world) == 0
    assert line.subscription.payloads == ["a"]


def test_lossless_ones_are_where_somebody_acknowledges() -> None:
    line = Line(offered=KEEP_ALL, requested=KEEP_ALL)
    line.publisher.publish("a")
    assert ways(line.world) == 1
    line = Line(offered=KEEP_ALL)
    line.publisher.publish("a")
    assert ways(line.world) == 0, "credit is given by what has come"


def test_to_several_processes_but_not_twice_to_one() -> None:
    line = Line()
    process = line.world.process()
    other = process.subscription("/topic")
    line.publisher.publish("a")
    assert ways(line.world) == 1
    second = process.subscription("/topic")
    line.publisher.publish("b")
    assert ways(line.world) == 0
    second.destroy()
    line.publisher.publish("c")
    assert ways(line.world) == 1
    assert line.subscription.payloads == other.payloads == ["a", "b", "c"]
    assert second.payloads == ["b"]


def test_not_with_a_gap() -> None:
    line = Line()
    line.publisher.publish("a")
    line.publisher.next_seq += 2
    line.publisher.publish("d")
    assert ways(line.world) == 1
    line.world.advance(1)
    assert line.subscription.statistics().dropped == {"publisher_queue": 2}


def test_what_breaks_the_rules_is_told_as_ever() -> None:
    line = Line(rules=(TopicRule(pattern="/topic", max_message_bytes=1024),))
    line.publisher.publish("a" * 2000)
    assert ways(line.world) == 0
    assert line.subscription.statistics().dropped == {"too_large": 1}
    broker = line.world.broker
    publisher = broker.graph.publishers[EndpointId(line.publisher.id)]
    for first_seq, count, size in ((2, 1, 11), (2, 1, 1037), (3, 1, 1036), (2, MAX_RUN_SAMPLES + 1, 1 << 20)):
        assert not broker.passed_on(publisher, first_seq, count, size)
    assert broker.passed_on(publisher, 2, 1, 1036)
