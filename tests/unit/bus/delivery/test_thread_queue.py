"""bus.delivery.thread_queue: held and replaced messages, and the wake-up of the event loop."""

import pytest

from bus.delivery.thread_queue import ThreadQueue
from bus.qos import QoSProfile
from bus.wire.layout import RECORD_HEAD_BYTES
from by_route import by_shared_memory
from client_world import ClientWorld, Numbered

MANY = 1 << 30


def taken(queue: ThreadQueue) -> list[tuple[bytes, int]]:
    found = list[tuple[bytes, int]]()

    def take(payload: bytes, stamp_ns: int) -> bool:
        found.append((payload, stamp_ns))
        return True

    queue.hand_on(take)
    return found


def test_the_loop_is_woken_once_until_it_collects() -> None:
    queue = ThreadQueue(1000)
    assert [queue.put(b"a", stamp, MANY) for stamp in (1, 2, 3)] == [True, False, False]
    queue.collect()
    assert [queue.put(b"b", stamp, MANY) for stamp in (4, 5)] == [True, False]


def test_samples_come_in_their_order_with_their_stamps() -> None:
    queue = ThreadQueue(1000)
    queue.put(b"a", 1, MANY)
    queue.put(b"b", 2, MANY)
    assert queue.collect() == 0
    queue.put(b"c", 3, MANY)
    queue.collect()
    assert taken(queue) == [(b"a", 1), (b"b", 2), (b"c", 3)]
    assert not queue.late


def test_beyond_the_depth_the_oldest_is_replaced_and_counted_once() -> None:
    queue = ThreadQueue(1000)
    for stamp in range(5):
        queue.put(b"x", stamp, 3)
    assert (queue.count, queue.collect(), queue.collect()) == (3, 2, 0)
    assert [stamp for _, stamp in taken(queue)] == [2, 3, 4]


def test_beyond_its_bytes_the_oldest_is_replaced_and_counted() -> None:
    record_bytes = 100 + RECORD_HEAD_BYTES
    queue = ThreadQueue(3 * record_bytes)
    for stamp in range(5):
        queue.put(bytes(100), stamp, MANY)
    assert (queue.count, queue.held_bytes) == (3, 3 * record_bytes)
    assert queue.collect() == 2
    assert [stamp for _, stamp in taken(queue)] == [2, 3, 4]


def test_a_single_sample_may_be_larger_than_all_its_bytes() -> None:
    queue = ThreadQueue(10)
    queue.put(bytes(100), 1, MANY)
    assert queue.collect() == 0
    assert taken(queue) == [(bytes(100), 1)]


def test_samples_are_held_until_they_are_taken() -> None:
    queue = ThreadQueue(1000)
    queue.put(b"four", 1, MANY)
    queue.put(b"four", 2, MANY)
    queue.collect()
    queue.hand_on(lambda payload, stamp_ns: stamp_ns == 1)
    assert (queue.count, queue.held_bytes) == (1, 4 + RECORD_HEAD_BYTES)
    assert list(queue.late) == [(b"four", 2)]
    taken(queue)
    assert (queue.count, queue.held_bytes) == (0, 0)


def test_dropped_samples_are_counted_with_those_replaced_before() -> None:
    queue = ThreadQueue(1000)
    queue.put(b"a", 1, MANY)
    queue.collect()
    for stamp_ns in (2, 3, 4):
        queue.put(b"b", stamp_ns, 2)
    assert queue.drop() == 4
    assert (queue.count, queue.held_bytes, queue.drop()) == (0, 0, 0)


def test_a_sample_whose_taking_fails_stays() -> None:
    queue = ThreadQueue(1000)
    queue.put(b"a", 1, MANY)
    queue.collect()

    def fail(payload: bytes, stamp_ns: int) -> bool:
        raise MemoryError

    with pytest.raises(MemoryError):
        queue.hand_on(fail)
    assert queue.count == 1
    assert taken(queue) == [(b"a", 1)]


@by_shared_memory
def test_samples_for_which_a_ring_has_room_just_before_the_sleep_are_tried_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = ClientWorld()
    talker, listener = world.client(shares=True), world.client(shares=True)
    qos, padding = QoSProfile(history="keep_all"), "x" * 20_000
    subscription = listener.subscription(qos)
    world.settle()
    publisher = talker.publisher(qos)
    world.settle()
    number = talker.publish(publisher, 10_000, padding) + 1
    talker.is_mine = False
    assert publisher._put(publisher._encode(Numbered(0, number, padding)))
    talker.is_mine = True
    with monkeypatch.context() as patch:
        patch.setattr(publisher._sender.ring, "wait_for_room", lambda on_room: False)
        talker.run_once()
    assert publisher.statistics().queued == 1
    found = list[int]()
    for _ in range(3):  # the ring has grown
        found += [taken for _, taken in listener.take(subscription)]
        world.settle()
    assert found == [*range(1, number + 1)]
    assert publisher.statistics().queued == 0


def test_the_first_sample_is_told_before_it_can_be_collected() -> None:
    told = list[int]()
    queue = ThreadQueue(1000, lambda: told.append(queue.count))
    for stamp in range(3):
        queue.put(b"a", stamp, MANY)
    queue.collect()
    queue.put(b"b", 3, MANY)
    assert told == [1, 4]
