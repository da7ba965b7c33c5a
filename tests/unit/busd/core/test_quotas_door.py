"""busd.core.quotas: connections that may enter, and connections that wait at the door."""

from broker_world import SECOND, World
from busd.core.limits import Limits


def test_all_and_those_of_a_user() -> None:
    world = World(Limits(connections=5, connections_per_user=3))
    world.process(uid=7)
    broker = world.broker
    told = [
        broker.entrance.turn_away(0, uid, connections=connections, of_user=of_user)
        for uid, connections, of_user in ((7, 3, 3), (7, 4, 4), (7, 4, 4), (8, 5, 1), (8, 6, 2))
    ]
    one = "connections of user 7: 3 of 3 in use; busd's limit can be raised in busd.toml"
    all_of_them = "connections: 5 of 5 in use; busd's limit can be raised in busd.toml"
    assert told == [("", False), (one, False), (one, True), ("", False), (all_of_them, False)]
    assert broker._quotas.users[7].refused == 2


def test_who_comes_and_goes_waits() -> None:
    """The first connections, up to the limit of the user, enter at once, and then as many in each second.
    Other users do not wait.
    """
    broker = World(Limits(connections_per_user=4)).broker
    assert [broker.entrance.arrive(0, 7, 0) for _ in range(6)] == [0, 0, 0, 0, SECOND // 4, SECOND // 4]
    assert broker.entrance.arrive(0, 8, 0) == 0
    assert broker.entrance.arrive(SECOND // 4 - 1, 7, 0) == 1
    assert [broker.entrance.arrive(SECOND // 4, 7, 0) for _ in range(2)] == [0, SECOND // 4]


def test_nobody_waits_for_long() -> None:
    """The wait is bounded for any number of earlier connections: here half a second, a part of the time for
    the handshake.
    """
    broker = World(Limits(connections_per_user=1, handshake_s=2)).broker
    now_ns = 10 * SECOND
    for at in range(100):
        assert broker.entrance.arrive(now_ns, 7, now_ns - SECOND // 2) == 0, at
    assert broker.entrance.arrive(now_ns, 7, now_ns) == SECOND // 2
    assert broker.entrance.arrive(now_ns + SECOND // 2 - 1, 7, now_ns) == 1


def test_leaving_does_not_help() -> None:
    broker = World(Limits(connections_per_user=2)).broker
    for _ in range(2):
        broker.entrance.arrive(0, 7, 0)
    broker.entrance.arrive(0, 8, 0)  # at this moment, busd forgets users that have left
    assert broker.entrance.arrive(0, 7, 0) > 0
    broker.entrance.arrive(10 * SECOND, 9, 10 * SECOND)
    assert 7 not in broker._quotas.users


def test_the_log_hears_of_a_few_that_come_to_nothing_and_of_how_many_more() -> None:
    """For each user: ten at once, then one a second."""
    broker = World().broker
    told = [broker.entrance.count_failed_connection(0, 7, for_want_of_room=True) for _ in range(13)]
    assert told == [(True, 0)] * 10 + [(False, 0)] * 3
    assert broker.entrance.count_failed_connection(0, 8, for_want_of_room=False) == (True, 0)
    assert broker.entrance.count_failed_connection(SECOND - 1, 7, for_want_of_room=False) == (False, 0)
    assert broker.entrance.count_failed_connection(SECOND, 7, for_want_of_room=False) == (True, 4)
    assert broker.entrance.count_failed_connection(2 * SECOND, 7, for_want_of_room=False) == (True, 0)
    # Connections refused because of a limit.
    assert [broker._quotas.users[uid].refused for uid in (7, 8)] == [13, 0]
