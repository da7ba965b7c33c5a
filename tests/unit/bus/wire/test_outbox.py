"""bus.wire.outbox: the order of sending; no queue waits for a flooded neighbour."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager

from bus.base.descriptor import Descriptor
from bus.wire.layout import DATA_HEAD, DATA_HEAD_BYTES
from bus.wire.outbox import TAKE_BYTES, Outbox
from bus.wire.runs import Account, Buffer, Run, RunQueue
from feeding import frame_record


def queue(endpoint: int) -> RunQueue:
    return RunQueue(0, Account(1 << 40), endpoint)


def fill(waiting: RunQueue, runs: int, size: int = 10) -> None:
    for at in range(runs):
        waiting.append(Run(0, 1, at + 1, 1, frame_record(bytes(size), 0)))


def order(buffers: list[Buffer]) -> list[int]:
    """The endpoint of each data frame, and 0 for a control frame."""
    found: list[int] = []
    at = 0
    while at < len(buffers):
        head = buffers[at]
        is_data = len(head) == DATA_HEAD_BYTES
        found.append(DATA_HEAD.unpack(head)[4] if is_data else 0)
        at += 2 if is_data else 1
    return found


def drain(outbox: Outbox) -> list[int]:
    found: list[int] = []
    while True:
        buffers, size, _ = outbox.take()
        assert size == sum(map(len, buffers))
        if not size:
            return found
        found += order(buffers)


def test_nothing_waits() -> None:
    assert Outbox().take() == ([], 0, ())


def test_control_frames_keep_their_order_and_go_first() -> None:
    outbox, waiting = Outbox(), queue(1)
    fill(waiting, 2)
    outbox.make_ready(waiting)
    outbox.put(b"first")
    outbox.put(b"second")
    buffers, *_ = outbox.take()
    assert buffers[:2] == [b"first", b"second"]
    assert order(buffers) == [0, 0, 1, 1]


def test_control_bytes_count_what_waits() -> None:
    outbox = Outbox()
    outbox.put(b"12345")
    outbox.put(b"678")
    assert outbox.account.used == 8
    outbox.take()
    assert outbox.account.used == 0


def test_a_flood_of_control_frames_is_taken_in_parts() -> None:
    outbox = Outbox()
    for _ in range(10):
        outbox.put(bytes(TAKE_BYTES // 3))
    sizes = []
    while size := outbox.take()[1]:
        sizes.append(size)
    assert sum(sizes) == 10 * (TAKE_BYTES // 3)
    assert max(sizes) < 2 * TAKE_BYTES


def test_runs_of_a_queue_keep_their_order() -> None:
    outbox, waiting = Outbox(), queue(1)
    fill(waiting, 2000)
    outbox.make_ready(waiting)
    numbers = []
    while True:
        buffers, size, _ = outbox.take()
        if not size:
            break
        numbers += [DATA_HEAD.unpack(head)[6] for head in buffers[::2]]
    assert numbers == list(range(1, 2001))


def test_queues_take_turns() -> None:
    outbox, flooded, quiet = Outbox(), queue(1), queue(2)
    fill(flooded, 100, size=32 << 10)
    fill(quiet, 1)
    outbox.make_ready(flooded)
    outbox.make_ready(quiet)
    first = order(outbox.take()[0])
    assert 2 in first, "the quiet queue has its turn in the first write"
    assert len(first) < 12
    assert drain(outbox) == [1] * (100 - first.count(1))


def test_a_turn_ends_also_for_many_small_runs() -> None:
    """One write takes a bounded number of buffers. The next write begins with queues that had no turn."""
    outbox = Outbox()
    queues = [queue(number) for number in (1, 2, 3)]
    for waiting in queues:
        fill(waiting, 1000)
        outbox.make_ready(waiting)
    seen: set[int] = set()
    for _ in queues:
        buffers, *_ = outbox.take()
        assert len(buffers) <= 1024, "sendmsg takes no more"
        seen |= set(order(buffers))
    assert seen == {1, 2, 3}


def test_a_run_larger_than_a_write_goes_whole() -> None:
    outbox, waiting = Outbox(), queue(1)
    fill(waiting, 2, size=2 * TAKE_BYTES)
    outbox.make_ready(waiting)
    assert outbox.take()[1] > 2 * TAKE_BYTES
    assert outbox.take()[1] > 2 * TAKE_BYTES
    assert outbox.take()[1] == 0


def test_readiness() -> None:
    outbox, waiting = Outbox(), queue(1)
    fill(waiting, 1)
    outbox.make_ready(waiting)
    outbox.make_ready(waiting)
    assert waiting.is_ready
    assert drain(outbox) == [1], "said twice, sent once"
    assert not waiting.is_ready
    fill(waiting, 1)
    outbox.make_ready(waiting)
    assert drain(outbox) == [1]


def test_a_queue_that_was_emptied_meanwhile() -> None:
    outbox, gone, other = Outbox(), queue(1), queue(2)
    fill(gone, 1)
    fill(other, 1)
    outbox.make_ready(gone)
    outbox.make_ready(other)
    gone.clear()
    assert drain(outbox) == [2]
    assert not gone.is_ready


@contextmanager
def without_gc() -> Iterator[None]:
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


class TestDescriptors:
    """The outbox does not look into descriptors, so the tests use placeholders."""

    def test_a_frame_with_descriptors_keeps_its_place_and_leaves_alone(self) -> None:
        outbox, waiting, batch = Outbox(), queue(1), (Descriptor(-1), Descriptor(-1))
        fill(waiting, 1)
        outbox.make_ready(waiting)
        outbox.put(b"one")
        outbox.put(b"two")
        outbox.put(b"three", batch)
        outbox.put(b"four", batch[:1])
        outbox.put(b"five")
        assert outbox.take() == ([b"one", b"two"], 6, ())
        assert outbox.take() == ([b"three"], 5, batch)
        assert outbox.take() == ([b"four"], 4, batch[:1])
        buffers, _, descriptors = outbox.take()
        assert (order(buffers), descriptors) == ([0, 1], ())
        assert not outbox

    def test_control_bytes_count_them_too(self) -> None:
        outbox = Outbox()
        outbox.put(b"12345", (Descriptor(-1),))
        outbox.put(b"678")
        assert outbox.account.used == 8
        outbox.take()
        assert outbox.account.used == 3

    def test_what_was_taken_is_not_held(self) -> None:
        outbox, closed = Outbox(), []

        class Watched(Descriptor):
            def close(self) -> None:
                closed.append(self.number)

        with without_gc():
            outbox.put(b"one", (Watched(-1),))
            outbox.take()
            assert closed == [-1]
            outbox.put(b"two", (Watched(-2),))
            outbox.put(b"three")
            outbox.clear_control()
            assert closed == [-1, -2]
        assert (outbox.account.used, outbox.take()) == (0, ([], 0, ()))
