"""bus.delivery.window: room by number and by bytes, and the samples that take room."""

from bus.delivery.open_run import OpenRun, open_run
from bus.delivery.thread_queue import ThreadQueue
from bus.delivery.window import CreditWindow
from bus.wire.layout import RECORD_HEAD_BYTES

PAYLOAD = bytes(100 - RECORD_HEAD_BYTES)
RECORD_BYTES = 100


class Filled:
    """A window of so many samples and bytes, over its own run."""

    def __init__(self, samples: int, size: int = 1 << 20) -> None:
        self.run: OpenRun = open_run()
        self.threads = ThreadQueue(1 << 20)
        self.window = CreditWindow(self.run, self.threads)
        self.window.resize(samples, size)

    def send(self, count: int) -> None:
        for _ in range(count):
            self.window.hand_over(self.window.last_seq + 1, RECORD_BYTES)

    @property
    def has_room(self) -> bool:
        return self.window.can_take(len(PAYLOAD))


def test_before_a_broker_has_said_how_large_it_is_there_is_room_for_one() -> None:
    filled = Filled(0, 0)
    assert filled.has_room
    filled.send(1)
    assert not filled.has_room


def test_a_window_of_samples_is_full_until_the_oldest_was_credited() -> None:
    filled = Filled(3)
    filled.send(3)
    assert not filled.has_room
    filled.window.credit(1)
    assert filled.has_room
    filled.send(1)
    assert not filled.has_room


def test_a_window_of_bytes_is_full_until_a_whole_run_was_credited() -> None:
    filled = Filled(100, 3 * RECORD_BYTES)
    filled.window.hand_over(2, 2 * RECORD_BYTES)
    assert filled.has_room
    filled.window.hand_over(3, RECORD_BYTES)
    assert not filled.has_room
    filled.window.credit(1)
    assert not filled.has_room, "half of the first run"
    filled.window.credit(2)
    assert filled.has_room


def test_credit_does_not_go_back() -> None:
    filled = Filled(2)
    filled.send(2)
    filled.window.credit(2)
    filled.window.credit(0)
    filled.send(1)
    assert filled.has_room


def test_the_open_run_takes_room() -> None:
    filled = Filled(2, 2 * RECORD_BYTES)
    filled.send(1)
    filled.run.begin(PAYLOAD, 1)
    assert not filled.has_room


def test_samples_of_other_threads_take_room_beside_an_open_run() -> None:
    filled = Filled(4)
    filled.run.begin(PAYLOAD, 1)
    filled.run.budget = filled.window.bound(1 << 16)
    taken = 0
    while filled.has_room:
        filled.threads.put(PAYLOAD, 1, depth=100)
        taken += 1
        assert taken < 100
    assert taken == 3


def test_samples_of_other_threads_take_room_by_number_and_by_bytes() -> None:
    for samples, size in ((2, 1 << 20), (100, 2 * RECORD_BYTES)):
        filled = Filled(samples, size)
        filled.send(1)
        filled.threads.put(PAYLOAD, 1, depth=100)
        assert not filled.has_room
        filled.threads.collect()
        assert not filled.has_room, "collected and not yet handed over"
        filled.threads.hand_on(lambda payload, stamp_ns: True)
        assert filled.has_room


def test_a_single_sample_may_be_larger_than_the_window_unless_one_of_another_thread_waits() -> None:
    filled = Filled(10, 10)
    assert filled.has_room
    filled.threads.put(b"", 1, depth=100)
    assert not filled.has_room


def test_an_open_run_may_go_on_for_what_is_left() -> None:
    filled = Filled(5, 10 * RECORD_BYTES)
    filled.send(2)
    filled.run.begin(PAYLOAD, 1)
    assert filled.window.bound(1 << 16) == 8 * RECORD_BYTES - len(PAYLOAD)
    assert filled.run.most == 3
    assert filled.window.bound(50) == 50
    filled.send(9)
    assert filled.window.bound(50) == 0
    assert filled.run.most == 1, "the sample that it has"
