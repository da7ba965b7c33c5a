"""bus.delivery.sender: messages of other threads, in the order of the calls.

Both routes are tested, and a route that changes meanwhile.
"""

from typing import Any

import pytest

from bus.errors import ConnectionClosed
from bus.publisher import Publisher
from bus.qos import QoSProfile
from busd.core.limits import Limits
from by_route import by_either, by_shared_memory
from client_world import Client, ClientWorld, Numbered
from rows import for_each
from sender_pair import KEEP_ALL, PADDING, Pair, heard


def from_thread(client: Client, publisher: Publisher[Numbered], payload: bytes) -> bool:
    """Publish as another thread does."""
    client.is_mine = False
    try:
        return publisher._put(payload)
    finally:
        client.is_mine = True


@by_either
def test_what_they_publish_waits_for_the_loop(route: str) -> None:
    pair = Pair(route)
    for number in (1, 2):
        assert from_thread(pair.talker, pair.publisher, pair.publisher._encode(Numbered(0, number)))
    assert pair.publisher.statistics().published == 0
    pair.world.settle()
    assert pair.heard() == [1, 2]


@by_either
def test_the_loop_does_not_overtake_them(route: str) -> None:
    pair = Pair(route)
    encoded = [pair.publisher._encode(Numbered(0, number)) for number in (1, 2, 3, 4)]
    assert from_thread(pair.talker, pair.publisher, encoded[0])
    assert pair.publisher._quick.write(encoded[1]) is False, "the quick ways do not look at the queue"
    assert pair.publisher._put(encoded[1])
    assert from_thread(pair.talker, pair.publisher, encoded[2])
    loan = pair.publisher._sender.lend(b"", len(encoded[3]), b"")
    assert loan is not None
    loan.buffer[:] = encoded[3]
    assert loan.publish()
    pair.world.settle()
    assert pair.heard() == [1, 2, 3, 4]


@by_either
def test_another_thread_publishes_while_the_quick_ways_open(route: str) -> None:
    """The routes are chosen when it comes: the loop must not open the quick ways over it."""
    pair = Pair(route)
    sender, publisher = pair.publisher._sender, pair.publisher
    payloads = [publisher._encode(Numbered(0, number)) for number in (1, 2)]
    closed = sender.quick.set
    opened = list[object]()

    def set_late(*ways: Any, **more: Any) -> None:
        if ways and ways[0] is not None and not opened:
            opened.append(ways)
            assert from_thread(pair.talker, publisher, payloads[0])
        closed(*ways, **more)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(sender.quick), "set", lambda _, *ways, **more: set_late(*ways, **more))
        sender.choose_routes()
    assert opened
    assert publisher._quick.write(payloads[1]) is False
    assert publisher._put(payloads[1])
    pair.world.settle()
    assert pair.heard() == [1, 2]


@by_shared_memory
@for_each("steps", range(12))
def test_the_loop_does_not_overtake_them_while_a_subscription_is_being_made(steps: int) -> None:
    """The route of a publisher changes at each step of a new match by socket."""
    pair = Pair("shm", QoSProfile(1000))
    late = pair.world.client().subscription(QoSProfile(1000))
    number = 0
    for _ in range(steps):
        for client in pair.world.clients:
            client.step()
            client.serve()
            number += 2
            encoded = [pair.publisher._encode(Numbered(0, number + at)) for at in (-1, 0)]
            assert from_thread(pair.talker, pair.publisher, encoded[0])
            assert pair.publisher._put(encoded[1])
    pair.world.settle()
    assert pair.heard() == list(range(1, number + 1))
    found = heard(pair.world.clients[-1], late)
    assert found == list(range(found[0], number + 1)) if found else steps < 4


@by_either
def test_of_keep_all_they_may_take_all_the_room_in_one_turn(route: str) -> None:
    world = ClientWorld(Limits(keep_all_window_messages=10))
    pair = Pair(route, KEEP_ALL, world=world)
    encode = pair.publisher._encode
    number = 0
    for _ in range(2):
        while from_thread(pair.talker, pair.publisher, encode(Numbered(0, number + 1))):
            number += 1
            assert number <= 20
        pair.world.settle()
        assert heard(pair.listener, pair.subscription)[-1] == number
        pair.world.advance(1)
    assert number == 20
    assert pair.publish() == 1
    assert pair.heard() == [21]


def test_of_keep_all_they_take_no_more_room_beside_an_open_run() -> None:
    """A callback has published by socket, and blocks the event loop now."""
    pair = Pair("socket", KEEP_ALL, world=ClientWorld(Limits(keep_all_window_messages=10)))
    assert pair.talker.publish(pair.publisher, 2) == 2
    assert pair.publisher._sender.socket.run.samples
    number = 2
    while from_thread(pair.talker, pair.publisher, pair.publisher._encode(Numbered(0, number + 1))):
        number += 1
        assert number <= 10
    assert number == 10
    pair.world.settle()
    assert pair.heard() == list(range(1, 11))


@by_either
@pytest.mark.parametrize("ends", [False, True])
def test_at_the_end_those_without_room_are_counted_and_logged(
    route: str, ends: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    """`ends`: they come while the publisher ends already."""
    pair = Pair(route, KEEP_ALL)
    if not ends:
        while pair.talker.publish(pair.publisher, 1, PADDING):
            pass
        if route == "socket":
            pair.talker.hang_up()
    core = pair.publisher._core
    from_threads = core.sender._from_threads
    with from_threads.lock:
        from_threads.put(pair.publisher._encode(Numbered(0, 1000, PADDING)), 1, 100)
    before = pair.publisher.statistics()
    if ends:
        core.end(ConnectionClosed("closed"))
        core.sender._collect_from_threads()
        expected = 1
    else:
        core.sender._collect_from_threads()
        expected = pair.publisher.statistics().queued
        assert core.sender.drop_queued() == expected > 0
    found = pair.publisher.statistics()
    assert (found.queued, found.replaced) == (0, before.replaced + expected)
    assert "could not be handed over" in capsys.readouterr().err


@by_either
def test_of_keep_all_they_take_no_more_room_than_there_is(route: str) -> None:
    pair = Pair(route, KEEP_ALL)
    number = 0
    payload = b""
    while number < 10_000:
        payload = pair.publisher._encode(Numbered(0, number + 1, PADDING))
        if not from_thread(pair.talker, pair.publisher, payload):
            break
        number += 1
        pair.world.settle()
        if pair.publisher.statistics().queued:
            break
    assert 10 < number < 10_000
    for _ in range(3):
        pair.heard()
        pair.world.advance(0.1)
    assert pair.publisher.statistics().queued == 0
    assert pair.dropped == {}


@by_either
def test_what_they_publish_while_a_loan_is_open_comes_after_it(route: str) -> None:
    pair = Pair(route)
    encoded = [pair.publisher._encode(Numbered(0, number)) for number in (1, 2)]
    loan = pair.publisher._sender.lend(b"", len(encoded[0]), b"")
    assert loan is not None
    from_thread(pair.talker, pair.publisher, encoded[1])
    pair.world.settle()
    loan.buffer[:] = encoded[0]
    assert loan.publish()
    pair.world.settle()
    assert pair.heard() == [1, 2]


@pytest.mark.parametrize("is_first", [False, True])
@by_either
async def test_a_message_that_is_taken_during_the_close_is_handed_over(route: str, is_first: bool) -> None:
    """A later one is refused, although the publisher is not closed yet: it could not be handed over."""
    pair = Pair(route)
    core = pair.publisher._core
    encoded = [pair.publisher._encode(Numbered(0, number)) for number in (1, 2)]
    if is_first:
        assert from_thread(pair.talker, pair.publisher, encoded[0])
    drained: list[int] = []

    async def drain() -> None:
        with pytest.raises(ConnectionClosed, match=r"this publisher on '/topic' is closed"):
            from_thread(pair.talker, pair.publisher, encoded[1])
        core.sender._collect_from_threads()
        drained.append(core.sender.drop_queued())

    core.drain = drain  # type: ignore[method-assign]
    await core.close()
    pair.world.settle()
    assert (drained, pair.heard()) == ([0], [1] if is_first else [])
