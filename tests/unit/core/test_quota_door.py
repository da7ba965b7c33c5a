"""busd.core.quotas: who may come in, and who waits at the door."""

from broker_world import SECOND, World
from busd.core.limits import Limits


def test_all_and_those_of_a_user() -> None:
    world = World(Limits(connections=5, connections_per_user=3))
    world.process(uid=7)
    broker = world.broker
    told = [
        broker.turn_away(0, uid, connections=connections, of_user=of_user)
        for uid, connections, of_user in ((7, 3, 3), (7, 4, 4), (7, 4, 4), (8, 5, 1), (8, 6, 2))
    ]
    one = "connections of user 7: 3 of 3 in use; busd's limit can be raised in busd.toml"
    all_of_them = "connections: 5 of 5 in use; busd's limit can be raised in busd.toml"
    assert told == [("", False), (one, False), (one, True), ("", False), (all_of_them, False)]
    assert broker._quotas.users[7].refused == 2


def test_who_comes_and_goes_waits() -> None:
    """As many as may be there come at once, then as many a second; nobody else waits."""
    broker = World(Limits(connections_per_user=4)).broker
    assert [broker.arrive(0, 7) for _ in range(7)] == [0, 0, 0, 0] + [
        SECOND * waits // 4 for waits in (1, 2, 3)
    ]
    assert broker.arrive(0, 8) == 0
    assert broker.arrive(SECOND, 7) == 0
    assert broker.arrive(SECOND, 7) == SECOND // 4


def test_nobody_waits_for_long() -> None:
    broker = World(Limits(connections_per_user=1, handshake_s=2)).broker
    assert max(broker.arrive(0, 7) for _ in range(100)) == SECOND // 2


def test_leaving_does_not_help() -> None:
    broker = World(Limits(connections_per_user=2)).broker
    for _ in range(3):
        broker.arrive(0, 7)
    broker.arrive(0, 8)  # at which moment users that have left are forgotten
    assert broker.arrive(0, 7) > 0
    broker.arrive(10 * SECOND, 9)
    assert 7 not in broker._quotas.users
