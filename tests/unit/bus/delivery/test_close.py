"""bus.endpoint.core: the close that does not wait."""

from bus.errors import ConnectionClosed
from bus.qos import QoSProfile
from by_route import by_either
from sender_pair import Pair, heard


@by_either
def test_a_publisher_with_nothing_to_hand_over_closes_at_once(route: str) -> None:
    pair = Pair(route)
    pair.publish(3)
    core = pair.publisher._core
    assert core.close_at_once()
    assert isinstance(core.refusal, ConnectionClosed) and core.sender.ring is None
    pair.world.settle()
    assert not pair.subscription.matches
    assert pair.heard() == [1, 2, 3]
    assert core.close_at_once(), "a second call does nothing"


@by_either
def test_messages_of_another_thread_are_waited_for(route: str) -> None:
    pair = Pair(route)
    pair.talker.is_mine = False
    assert pair.talker.publish(pair.publisher) == 1
    pair.talker.is_mine = True
    assert not pair.publisher._core.close_at_once()
    pair.world.settle()
    assert pair.publisher._core.close_at_once()
    pair.world.settle()
    assert pair.heard() == [1]


def test_messages_that_wait_for_busd_are_waited_for() -> None:
    pair = Pair("socket", QoSProfile(10))
    pair.talker.hang_up()
    pair.talker.publish(pair.publisher, 2)
    assert not pair.publisher._core.close_at_once()
    pair.talker.connect()
    pair.world.settle()
    assert pair.publisher._core.close_at_once()
    assert heard(pair.listener, pair.subscription) == [1, 2]
