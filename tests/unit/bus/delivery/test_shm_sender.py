"""bus.delivery.shm_sender, shm_receiver: after the broker has died, readers read on, and publishers wait for
them.

The world has no process, no socket and no clock (`tests/world/client_world.py`).
"""

import pytest

from bus import shm
from bus.delivery.port import RETURN_S
from bus.qos import QoSProfile
from bus.subscription import Subscription
from bus.wire import messages as m
from client_world import Client, ClientWorld, Numbered
from list_port import Task

pytestmark = pytest.mark.skipif(not shm.is_available(), reason=shm.why_not())

LAST_10, KEEP_ALL = QoSProfile(10), QoSProfile(history="keep_all")
LONG = "x" * 20_000


def heard(client: Client, subscription: Subscription[Numbered]) -> list[int]:
    return [number for _, number in client.take(subscription)]


def test_a_ring_keeps_the_largest_depth_of_its_matches() -> None:
    world = ClientWorld()
    talker, listener, other = (world.client(shares=True) for _ in range(3))
    publisher = talker.publisher(LAST_10)
    world.settle()
    ring = publisher._sender.ring
    assert ring is not None
    listener.subscription(QoSProfile(50))
    other.subscription(QoSProfile(20))
    world.settle()
    assert ring.gates.keep == 50
    listener.die()
    world.settle()
    assert ring.gates.keep == 20
    other.die()
    world.settle()
    assert ring.gates.keep == 10


def test_a_reader_that_lives_and_does_not_come_back_is_waited_for_so_long_and_no_longer() -> None:
    world = ClientWorld()
    talker, listener = world.client(shares=True), world.client(shares=True)
    listener.subscription(KEEP_ALL)
    world.settle()
    publisher = talker.publisher(KEEP_ALL)
    world.settle()
    talker.publish(publisher, 10_000, LONG)
    world.restart_broker()
    world.settle()
    talker.connect()
    world.settle()

    async def send() -> None:
        while not talker.publish(publisher, 1, LONG):
            await publisher.wait_for_room()

    task = Task(talker.soon, send())
    world.advance(RETURN_S - 1)
    assert not task.is_done
    world.advance(2)
    assert task.is_done and task.error is None


def test_a_ring_whose_publisher_does_not_come_back_is_read_to_its_end_and_left() -> None:
    world = ClientWorld()
    talker, listener = world.client(shares=True), world.client(shares=True)
    subscription = listener.subscription(LAST_10)
    world.settle()
    publisher = talker.publisher(LAST_10)
    world.settle()
    world.restart_broker()
    world.settle()
    talker.publish(publisher, 3)
    talker.die()
    listener.connect()
    world.advance(RETURN_S - 1)
    rings = subscription._core.rings
    assert rings is not None and len(rings._feeds) == 1
    assert heard(listener, subscription) == [1, 2, 3]
    world.advance(2)
    rings.sweep()
    assert not rings._feeds
    totals = subscription.statistics()
    assert (totals.expected, totals.delivered, totals.dropped) == (3, 3, {})


def test_a_ring_that_grows_while_the_new_broker_is_told_of_it() -> None:
    world = ClientWorld()
    talker, listener = world.client(shares=True), world.client(shares=True)
    subscription = listener.subscription(LAST_10)
    world.settle()
    publisher = talker.publisher(LAST_10)
    world.settle()
    talker.publish(publisher)
    world.restart_broker()
    world.settle()
    talker.connect()
    talker.serve()
    talker.step()  # the node and the publisher are declared, and the broker has not read it yet
    talker.publish(publisher, 1, 10 * LONG)
    listener.connect()
    world.settle()
    talker.publish(publisher)
    world.settle()
    assert heard(listener, subscription) == [1, 2, 3]
    assert subscription.statistics().dropped == {}


def test_one_by_socket_that_comes_back_later_has_missed_nothing() -> None:
    """Until the subscription returns, published samples also wait on the socket route."""
    world = ClientWorld()
    talker, near, far = world.client(shares=True), world.client(shares=True), world.client()
    subscriptions = {near: near.subscription(LAST_10), far: far.subscription(LAST_10)}
    world.settle()
    publisher = talker.publisher(LAST_10)
    world.settle()
    talker.publish(publisher, 2)
    world.settle()
    world.restart_broker()
    world.settle()
    talker.connect()
    near.connect()
    world.settle()
    talker.publish(publisher, 3)
    world.advance(0.5)
    far.connect()
    world.settle()
    for client, subscription in subscriptions.items():
        assert heard(client, subscription) == [1, 2, 3, 4, 5]
        assert subscription.statistics().dropped == {}


def test_a_subscription_counts_once_it_can_be_woken() -> None:
    """A program may publish to it then, and never again run its event loop: its message arrives at once."""
    world = ClientWorld()
    talker, listener = world.client(shares=True), world.client(shares=True)
    subscription = listener.subscription(LAST_10)
    world.settle()
    listener.is_held = True  # so it does not name its slot
    publisher = talker.publisher(LAST_10)
    world.settle()
    assert len(publisher.matches) == 1
    assert publisher._core.count_ready() == 0
    listener.is_held = False
    world.settle()
    assert publisher._core.count_ready() == 1
    talker.is_held = True
    talker.publish(publisher)
    world.settle()
    assert heard(listener, subscription) == [1]
    talker.is_held = False
    listener.close(subscription)
    world.settle()
    assert publisher._core.count_ready() == 0


def test_one_that_did_not_come_back_does_not_hide_one_that_did() -> None:
    """The former was not yet there when the broker died, and stays unsure for a while."""
    world = ClientWorld()
    talker, near, far = world.client(shares=True), world.client(shares=True), world.client(shares=True)
    near.subscription(LAST_10)
    far.subscription(LAST_10)
    world.settle()
    far.is_held = True
    publisher = talker.publisher(LAST_10)
    world.settle()
    assert (len(publisher.matches), publisher._core.count_ready()) == (2, 1)
    world.restart_broker()
    world.settle()
    assert (len(publisher.matches), publisher._core.count_ready()) == (0, 0)
    talker.connect()
    near.connect()
    world.settle()
    assert (len(publisher.matches), publisher._core.count_ready()) == (1, 1)


def test_of_two_matches_with_one_gid_the_newer_counts() -> None:
    """No broker checks whether a peer uses a foreign gid. Other subscriptions must not suffer from it."""
    world = ClientWorld()
    talker, listener = world.client(shares=True), world.client(shares=True)
    subscription = listener.subscription(LAST_10)
    publisher = talker.publisher(LAST_10)
    world.settle()
    twin = subscription._core.id + 100
    publisher._core.handle(
        m.Matched(
            endpoint=publisher._core.id, other=twin, node="/n", gid=subscription.gid, qos=LAST_10, route="shm"
        )
    )
    assert publisher._sender.expected == {twin}
    assert talker.publish(publisher, 2) == 2
    world.settle()
    assert heard(listener, subscription) == [1, 2]  # its process may read on
    publisher._core.handle(m.Unmatched(endpoint=publisher._core.id, other=subscription._core.id))
    assert publisher._sender.expected == {twin}
    publisher._core.handle(m.Unmatched(endpoint=publisher._core.id, other=twin))
    assert publisher._sender.expected == set()
