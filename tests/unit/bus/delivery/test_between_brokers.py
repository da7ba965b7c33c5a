"""Samples in flight while a match is made, a broker is away, or a route changes.

A subscription gets each sample once, by its number, and counts lost samples.

The world has no process, no socket and no clock (`tests/world/client_world.py`).
"""

from typing import Any

import pytest

from bus import shm
from bus.events import SubscriptionEvents
from bus.qos import QoSProfile
from bus.subscription import Subscription
from bus.wire import messages as m
from client_world import Client, ClientWorld, Connection

pytestmark = pytest.mark.skipif(not shm.is_available(), reason=shm.why_not())

LAST_3, LAST_10 = QoSProfile(3), QoSProfile(10)
KEPT_3, KEPT_20 = (QoSProfile(depth, durability="transient_local") for depth in (3, 20))
LARGE = "x" * (3 << 20)
"""A text longer than the first ring."""


def numbers(client: Client, subscription: Subscription[Any]) -> list[int]:
    return [number for _, number in client.take(subscription)]


def losses(subscription: Subscription[Any]) -> dict[str, int]:
    found = subscription.statistics()
    assert found.expected == found.delivered + found.queued + sum(found.dropped.values())
    return found.dropped


def test_a_match_by_socket_gets_what_was_published_behind_what_is_on_its_way() -> None:
    world = ClientWorld()
    talker, far = world.client(shares=True), world.client()
    before = far.subscription(LAST_10)
    publisher = talker.publisher(LAST_10)
    world.settle()
    talker.publish(publisher, 2)
    world.settle()
    assert numbers(far, before) == [1, 2]
    talker.publish(publisher, 3)
    talker.step()  # the samples leave, and the broker has not read them yet
    assert talker.connection is not None and talker.connection.sent_up
    far.close(before)
    far.step()
    while far.serve():
        pass
    talker.step()  # no subscription uses the socket route any more
    assert not publisher._sender.goes_by_socket
    talker.publish(publisher, 2)  # into the ring only
    after = far.subscription(LAST_10)
    far.step()
    while far.serve():
        pass
    world.settle()
    talker.publish(publisher)
    world.settle()
    assert numbers(far, after) == [3, 4, 5, 6, 7, 8]
    assert losses(after) == {}


def test_what_was_read_in_the_ring_is_not_sent_once_more() -> None:
    world = ClientWorld()
    talker, listener = world.client(shares=True), world.client(shares=True)
    publisher, subscription = talker.publisher(LAST_10), listener.subscription(LAST_10)
    world.settle()
    talker.publish(publisher, 5)
    world.settle()
    assert numbers(listener, subscription) == [1, 2, 3, 4, 5]
    refusal = m.RefuseRoute(endpoint=subscription._core.id, other=publisher._core.id, text="a test")
    listener.send_about(subscription._core, refusal)
    world.settle()
    assert [match.route for match in publisher.matches] == ["socket"]
    talker.publish(publisher)
    world.settle()
    assert numbers(listener, subscription) == [6]
    assert subscription._receiver.tracker.repeated == 0
    assert losses(subscription) == {}


def test_a_publisher_that_was_made_while_the_broker_was_away_is_heard_from_its_first_sample_on() -> None:
    world = ClientWorld()
    talker, listener = world.client(shares=True), world.client(shares=True)
    subscription = listener.subscription(LAST_10)
    world.settle()
    world.restart_broker()
    world.settle()
    publisher = talker.publisher(LAST_10)
    talker.publish(publisher, 3)
    world.connect_all()
    world.settle()
    assert numbers(listener, subscription) == [1, 2, 3]
    assert losses(subscription) == {}


def test_what_a_publisher_that_has_gone_wrote_into_another_ring_meanwhile_is_counted() -> None:
    world = ClientWorld()
    talker, listener = world.client(shares=True), world.client(shares=True)
    publisher, subscription = talker.publisher(LAST_10), listener.subscription(LAST_10)
    world.settle()
    talker.publish(publisher, 3)
    world.settle()
    listener.hang_up()
    talker.publish(publisher, 1, LARGE)  # the ring grows, and only connected subscriptions learn of it
    world.settle()
    talker.close(publisher)
    world.settle()
    listener.connect()
    world.settle()
    assert numbers(listener, subscription) == [1, 2, 3]
    world.advance(10)
    assert losses(subscription) == {"disconnected": 1}


def blocked(client: Client) -> Connection:
    """The connection of `client`, which takes nothing from now on."""
    assert client.connection is not None
    client.connection.is_blocked = True
    return client.connection


@pytest.mark.parametrize("later", [0, 4])
def test_what_a_queue_dropped_just_before_a_cut_may_come_again_with_the_history(later: int) -> None:
    """The report of the drops came, and the samples behind them did not. `later`: published meanwhile."""
    world = ClientWorld()
    talkers, listener = [world.client(), world.client()], world.client()
    lost: list[int] = []
    subscription = listener.subscription(KEPT_3)
    subscription._core.events = SubscriptionEvents(message_lost=lambda event: lost.append(event.total_count))
    publishers = [one.publisher(KEPT_20) for one in talkers]
    world.settle()
    for talker, publisher in zip(talkers, publishers, strict=True):
        talker.publish(publisher)
    world.settle()
    assert listener.take(subscription) == [(2, 1), (3, 1)]
    connection = blocked(listener)  # the queue of three has to last for six
    for talker, publisher in zip(talkers, publishers, strict=True):
        talker.publish(publisher, 3)
        world.settle()
    world.advance(0.2)
    connection.trickle()
    world.settle()
    assert losses(subscription) == {"replaced": 3}
    listener.hang_up()
    talkers[0].publish(publishers[0], later)
    world.settle()
    listener.connect()
    world.settle()
    first = later + 2
    found = [(2, number) for number in range(first, first + 3)], [(3, number) for number in (2, 3, 4)]
    assert listener.take(subscription) == [*found[0], *found[1]]
    assert sum(losses(subscription).values()) == later
    assert subscription.statistics().expected == 8 + later
    assert lost[-1] == (later or 3)


def test_a_history_that_comes_after_a_cut_and_is_dropped_by_a_queue_counts_once() -> None:
    """The numbers are missing, as if the history lacked them, and busd reports them as dropped, too."""
    world = ClientWorld()
    listener, talker = world.client(), world.client()
    subscription = listener.subscription(KEPT_3)
    publisher = talker.publisher(KEPT_3)
    world.settle()
    talker.publish(publisher, 3)
    listener.hang_up()
    world.settle()
    listener.connect()
    talker.publish(publisher, 3)
    talker.publish(publisher, 2)
    listener.serve()
    connection = blocked(listener)
    world.settle()
    connection.unblock()
    world.advance(1)
    assert numbers(listener, subscription) == [5, 6, 7, 8]
    assert losses(subscription) == {"replaced": 4}
    assert subscription.statistics().expected == 8


@pytest.mark.parametrize("qos", [LAST_3, KEPT_3], ids=["volatile", "transient local"])
def test_what_a_busd_dropped_before_it_was_killed_may_come_again(qos: QoSProfile) -> None:
    """The publisher gives its history to the new busd, which has it for every subscription of before."""
    world = ClientWorld()
    talker, listener = world.client(), world.client()
    subscription, publisher = listener.subscription(qos), talker.publisher(KEPT_20)
    world.settle()
    connection = blocked(listener)
    talker.publish(publisher, 6)
    world.advance(1)
    connection.trickle()
    world.settle()
    assert losses(subscription) == {"replaced": 3}
    world.restart_broker()
    world.connect_all()
    world.advance(1)
    assert numbers(listener, subscription) == [4, 5, 6]
    assert losses(subscription) == {"replaced": 3}
    assert subscription.statistics().expected == 6


def test_what_a_queue_dropped_may_come_again_if_both_ends_were_cut_off() -> None:
    world = ClientWorld()
    client = world.client()
    subscription, publisher = client.subscription(KEPT_3), client.publisher(KEPT_20)
    world.settle()
    connection = blocked(client)
    client.publish(publisher, 6)
    world.advance(1)
    connection.trickle()
    world.settle()
    assert losses(subscription) == {"replaced": 3}
    client.hang_up()
    client.connect()
    world.advance(1)
    assert numbers(client, subscription) == [4, 5, 6]
    assert losses(subscription) == {"replaced": 3}
    assert subscription.statistics().expected == 6


@pytest.mark.parametrize(
    ("qos", "found", "lost"),
    [(LAST_3, [], {"disconnected": 2}), (KEPT_3, [1, 2], {})],
    ids=["volatile", "kept"],
)
def test_the_end_of_a_publisher_that_returns_counts_once(
    qos: QoSProfile, found: list[int], lost: dict[str, int]
) -> None:
    """Its end (Unmatched) arrives, and the samples before it do not: the listener is cut off, too."""
    world = ClientWorld()
    talker, listener = world.client(), world.client()
    subscription, publisher = listener.subscription(LAST_3), talker.publisher(qos)
    world.settle()
    connection = blocked(listener)
    talker.publish(publisher, 2)
    world.settle()
    talker.hang_up()
    connection.trickle()
    world.settle()
    listener.hang_up()
    world.connect_all()
    assert numbers(listener, subscription) == found
    assert losses(subscription) == lost
    assert subscription.statistics().expected == 2


def test_the_second_end_of_a_publisher_loses_nothing_that_is_in_its_ring() -> None:
    """It returned by its ring after its first end; busd has routed none of its samples."""
    world = ClientWorld()
    talker, listener = world.client(shares=True), world.client(shares=True)
    subscription, publisher = listener.subscription(QoSProfile(1)), talker.publisher(LAST_3)
    world.settle()
    talker.hang_up()
    talker.connect()
    talker.publish(publisher, 2)
    world.advance(1)
    talker.hang_up()
    world.settle()
    listener.hang_up()
    world.connect_all()
    world.advance(1)
    assert numbers(listener, subscription) == [2]
    assert losses(subscription) == {"replaced": 1}
