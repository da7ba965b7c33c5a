"""bus.subscription: the number of alive publishers in the event."""

from bus.events import LivelinessChanged, SubscriptionEvents
from bus.qos import QoSProfile
from client_world import ClientWorld

LEASED = QoSProfile(1, liveliness="manual_by_topic", liveliness_lease_duration=1.0)


def test_each_change_is_told_once() -> None:
    world = ClientWorld()
    talker, listener = world.client(), world.client()
    subscription = listener.subscription(LEASED)
    told: list[LivelinessChanged] = []
    subscription._core.events = SubscriptionEvents(liveliness_changed=told.append)
    world.settle()
    first, second = talker.publisher(LEASED), talker.publisher(LEASED)
    world.settle()
    assert told == [], "no sign of life yet"
    talker.publish(first)
    talker.publish(second)
    world.settle()
    world.advance(0.5)
    talker.publish(second)
    world.settle()
    world.advance(0.8)  # the first publisher has been silent for its whole lease
    talker.close(first)
    world.settle()
    world.advance(1.0)
    talker.publish(second)
    world.settle()
    talker.close(second)
    world.settle()
    assert told == [
        LivelinessChanged(1, 0, 1, 0),
        LivelinessChanged(2, 0, 1, 0),
        LivelinessChanged(1, 1, -1, 1),
        LivelinessChanged(1, 0, 0, -1),
        LivelinessChanged(0, 1, -1, 1),
        LivelinessChanged(1, 0, 1, -1),
        LivelinessChanged(0, 0, -1, 0),
    ]


def test_those_that_were_not_alive_when_the_connection_was_lost_count_anew() -> None:
    world = ClientWorld()
    talker, listener = world.client(), world.client()
    subscription = listener.subscription(LEASED)
    publisher = talker.publisher(LEASED)
    world.settle()
    talker.publish(publisher)
    world.settle()
    world.advance(1.5)
    told: list[LivelinessChanged] = []
    subscription._core.events = SubscriptionEvents(liveliness_changed=told.append)
    listener.hang_up()
    listener.connect()
    world.settle()
    talker.publish(publisher)
    world.settle()
    assert told == [
        LivelinessChanged(0, 0, 0, -1),
        LivelinessChanged(1, 0, 1, 0),
    ], "it counts from its next sign of life"


def test_without_a_lease_nothing_is_told() -> None:
    world = ClientWorld()
    talker, listener = world.client(), world.client()
    subscription = listener.subscription(QoSProfile(1))
    told: list[LivelinessChanged] = []
    subscription._core.events = SubscriptionEvents(liveliness_changed=told.append)
    publisher = talker.publisher(LEASED)
    world.settle()
    talker.publish(publisher)
    world.settle()
    world.advance(1.5)
    talker.close(publisher)
    world.settle()
    assert told == []
