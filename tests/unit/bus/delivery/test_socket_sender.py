"""bus.delivery.socket_sender, over a list: when samples leave, which subscriptions they wait for, and
replacement.
"""

import pytest

from bus import shm
from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.layout import DATA_HEAD_BYTES, RECORD_HEAD_BYTES, RUN_BYTES
from one_way import KEEP_ALL, OTHER, Way, numbers

LAST_3 = QoSProfile(3)
HISTORY = QoSProfile(3, durability="transient_local")
SECOND_NS = 1_000_000_000


class TestWhenItLeaves:
    def test_at_once_and_what_follows_soon_with_the_end_of_the_turn(self) -> None:
        way = Way(QoSProfile(10))
        way.put()
        assert way.left() == [[1]]
        way.put(3)
        assert way.left() == []
        way.port.settle()
        assert way.left() == [[2, 3, 4]]
        way.put_apart(1)
        assert way.left() == [[5]]

    def test_what_another_publisher_has_just_sent_counts(self) -> None:
        """Samples of a flood by many publishers are gathered like those of a single publisher."""
        way = Way(QoSProfile(10))
        way.port.last_sent_ns = way.port.now_ns()
        way.put()
        assert way.left() == []
        way.port.settle()
        assert way.left() == [[1]]

    def test_a_run_is_no_longer_than_the_depth(self) -> None:
        way = Way(LAST_3)
        way.port.last_sent_ns = way.port.now_ns()
        way.put(7)
        way.port.settle()
        assert way.left() == [[1, 2, 3], [4, 5, 6], [7]]

    def test_what_is_for_the_history_alone_waits_for_the_end_of_the_turn(self) -> None:
        way = Way(HISTORY)
        way.sender.set_use(is_read=False)
        way.put(5)
        assert way.left() == []
        way.port.settle()
        assert way.left() == [[1, 2, 3, 4, 5]]
        way.sender.set_use(is_read=True)
        way.put_apart(1)
        assert way.left() == [[6]]

    def test_what_is_for_the_history_alone_wakes_the_broker_rarely(self) -> None:
        way = Way(HISTORY)
        way.sender.set_use(is_read=False)
        way.put()
        way.port.settle()
        assert way.left() == [[1]]
        way.put_apart(5)
        assert way.left() == []
        way.port.advance(0.01)
        assert way.left() == [[2, 3, 4, 5, 6]]
        way.put_apart(2)
        way.port.advance(0.01)
        assert way.left() == [[7, 8]]
        way.port.advance(0.01)
        way.put()
        way.port.settle()
        assert way.left() == [[9]]

    def test_the_rest_of_a_history_goes_ahead_of_what_subscriptions_get(self) -> None:
        way = Way(HISTORY)
        way.sender.set_use(is_read=False)
        way.put()
        way.port.settle()
        way.put_apart(2)
        assert way.left() == [[1]]
        way.sender.set_use(is_read=True)
        assert way.left() == [[2, 3]]
        way.put_apart(1)
        assert way.left() == [[4]]
        way.port.advance(0.01)
        assert way.left() == []

    def test_an_end_leaves_no_timer(self) -> None:
        way = Way(HISTORY)
        way.sender.set_use(is_read=False)
        way.put()
        way.port.settle()
        way.put_apart(2)
        assert way.port.clock.next_ns() is not None
        way.sender.end()
        assert way.port.clock.next_ns() is None

    def test_the_counters_are_reported_once_until_they_were_told(self) -> None:
        way = Way(LAST_3)
        way.put_apart(3)
        assert way.port.reported == [way.owner]
        way.sender.is_report_due = False
        way.put_apart(1)
        assert way.port.reported == [way.owner] * 2


@pytest.mark.skipif(not shm.has_core(), reason="without the core, long samples are copied into runs")
class TestLongSample:
    """It leaves in a run for it alone, from where its parts lie."""

    TEXT = "x" * RUN_BYTES

    def put(self, way: Way, *parts: bytes | bytearray | str) -> None:
        way.number += 1
        stamp_ns = way.port.now_ns()
        record = way.sender.long_record([b"%d" % way.number, *parts], stamp_ns)
        assert record is not None
        way.sender.put_long(record, stamp_ns)

    def test_alone_after_the_samples_before_it(self) -> None:
        way = Way(QoSProfile(10))
        way.put(3)
        self.put(way, self.TEXT)
        assert way.left() == [[1], [2, 3]]
        way.port.settle()
        assert way.left() == [[4]]
        way.put()
        way.port.settle()
        assert way.left() == [[5]]
        assert way.sender.bytes == 5 + RUN_BYTES

    def test_at_once_and_a_few_that_follow_soon_together(self) -> None:
        way = Way(QoSProfile(10))
        way.port.advance(0.001)
        self.put(way, self.TEXT)
        assert way.left() == [[1]]
        for _ in range(5):
            self.put(way, self.TEXT)
        assert way.left() == [[2], [3], [4], [5]]
        way.port.settle()
        assert way.left() == [[6]]
        self.put(way, 4 * self.TEXT)
        assert way.left() == [[7]], "it is as long as a few"

    def test_none_waits_for_one_that_would_replace_it(self) -> None:
        way = Way(QoSProfile(2))
        for _ in range(7):
            self.put(way, self.TEXT)
        way.port.settle()
        assert way.left() == [[number] for number in range(1, 8)]
        assert way.sender.replaced == 0

    def test_it_is_not_copied(self) -> None:
        way = Way(QoSProfile(10))
        way.port.is_choked = True
        self.put(way, self.TEXT)
        buffers, _, _ = way.port.outbox.take()
        assert [len(buffer) for buffer in buffers] == [DATA_HEAD_BYTES, RECORD_HEAD_BYTES, 1, RUN_BYTES]
        joined = way.sender.long_record([self.TEXT], 1)
        assert joined is not None
        assert memoryview(buffers[-1]).obj.__class__ is joined.pieces[-1].obj.__class__, "a view of a str"

    def test_memory_that_may_change_is_copied(self) -> None:
        way, data = Way(QoSProfile(10)), bytearray(self.TEXT.encode())
        way.port.is_choked = True
        self.put(way, data)
        data[:] = bytes(len(data))
        way.port.is_choked = False
        way.port.flush()
        assert way.left() == [[1]]

    def test_of_a_long_queue_the_rest_is_copied(self) -> None:
        """So the memory of all of it exists when the free memory is checked."""
        way = Way(QoSProfile(10))
        way.port.is_choked = True
        for _ in range(6):
            self.put(way, "x" * (1 << 20))
        assert [bool(run.pieces) for run in way.sender.queue.runs] == [True] * 3 + [False] * 3
        way.port.is_choked = False
        way.port.flush()
        assert way.left() == [[number] for number in range(1, 7)]

    def test_a_socket_that_takes_nothing_replaces_it_as_any_other(self) -> None:
        way = Way(LAST_3)
        way.port.is_choked = True
        for _ in range(5):
            self.put(way, self.TEXT)
        assert way.sender.replaced == 2
        way.port.is_choked = False
        way.port.flush()
        assert way.left() == [[3], [4], [5]]

    @pytest.mark.parametrize("qos", [KEEP_ALL, HISTORY], ids=["lossless", "history"])
    def test_the_next_broker_gets_it_once_more(self, qos: QoSProfile) -> None:
        way = Way(qos)
        way.match()
        self.put(way, self.TEXT)
        way.port.settle()
        assert way.left() == [[1]]
        way.lose()
        way.declare(2)
        way.match()
        assert way.left() == [[1]]

    def test_a_short_one_and_one_for_the_history_alone_are_gathered(self) -> None:
        way = Way(HISTORY)
        assert way.sender.long_record([b"short"], 1) is None
        way.sender.set_use(is_read=False)
        assert way.sender.long_record([self.TEXT], 1) is None


class TestSocketThatTakesNothing:
    def test_the_newest_wait_and_the_others_are_replaced(self) -> None:
        way = Way(LAST_3)
        replaced: list[int] = []
        way.sender.on_replaced = replaced.append
        way.port.is_choked = True
        way.put_apart(5)
        assert (way.left(), way.sender.queue.count) == ([], 3)
        assert (way.sender.replaced, replaced) == (2, [1, 1])
        way.port.unchoke()
        assert way.left() == [[3], [4], [5]]

    def test_what_comes_then_does_not_overtake(self) -> None:
        way = Way(LAST_3)
        way.port.is_choked = True
        way.put_apart(1)
        way.port.is_choked = False
        way.put_apart(1)
        assert way.left() == [[1], [2]]

    def test_what_waits_is_given_up_and_counted(self) -> None:
        way = Way(LAST_3)
        way.port.is_choked = True
        way.put_apart(2)
        assert way.sender.drop_queued() == 2
        way.port.unchoke()
        assert (way.left(), way.sender.replaced) == ([], 2)


class TestWithoutBroker:
    def test_what_is_published_waits_and_goes_to_the_next_one(self) -> None:
        way = Way(LAST_3)
        way.lose()
        way.put_apart(2)
        assert way.sender.first_seq_to_send() == 1
        way.declare(number=5)
        (first, second) = way.port.runs()
        assert (first.endpoint, numbers(first), numbers(second)) == (5, [1], [2])

    def test_the_first_that_the_next_one_gets_is_not_the_first_that_was_published(self) -> None:
        way = Way(LAST_3)
        way.lose()
        way.put_apart(5)
        assert way.sender.first_seq_to_send() == 3
        way.declare()
        assert way.left() == [[3], [4], [5]]

    def test_of_a_history_it_gets_all_once_more(self) -> None:
        way = Way(HISTORY)
        way.put_apart(5)
        assert way.left() == [[1], [2], [3], [4], [5]]
        way.lose()
        way.put_apart(1)
        assert way.sender.first_seq_to_send() == 4
        way.declare()
        runs = way.port.runs()
        assert [numbers(run) for run in runs] == [[4], [5], [6]]
        assert not any(run.is_replay for run in runs), "to the new broker they are new"


class TestWhoIsWaitedFor:
    """After a broker has died, a matched subscription misses nothing if it returns soon."""

    @pytest.mark.parametrize(("qos", "wait_s"), [(QoSProfile(10), 1), (KEEP_ALL, 10)], ids=["depth", "all"])
    def test_so_long_and_no_longer(self, qos: QoSProfile, wait_s: float) -> None:
        way = Way(qos)
        way.match()
        way.lose()
        way.declare()
        way.put_apart(1)
        way.port.advance(wait_s - 0.1)
        assert way.left() == []
        way.port.advance(0.2)
        assert way.left() == [[1]]

    def test_until_all_are_back(self) -> None:
        way = Way(QoSProfile(10))
        others = {bytes([number]) * 16: number for number in (3, 4)}
        for gid, other in others.items():
            way.match(gid=gid, other=other)
        way.lose()
        way.declare()
        way.put_apart(1)
        for gid, other in others.items():
            assert way.left() == []
            way.match(gid=gid, other=other + 10)
        assert way.left() == [[1]]

    @pytest.mark.parametrize("is_back", [True, False])
    def test_for_one_with_a_depth_a_lossless_publisher_waits_too_but_not_as_long(
        self, *, is_back: bool
    ) -> None:
        way, lossless, with_depth = Way(KEEP_ALL), b"l" * 16, b"d" * 16
        way.match(KEEP_ALL, lossless, 1)
        way.match(QoSProfile(10), with_depth, 2)
        way.put_apart(1)
        way.lose()
        way.declare()
        way.put_apart(1)
        way.port.runs()
        way.match(KEEP_ALL, lossless, 11)
        assert [(numbers(run), run.only_for) for run in way.port.runs()] == [([1], 11)]
        if is_back:
            way.match(QoSProfile(10), with_depth, 12)
        else:
            way.port.advance(0.9)
            assert way.left() == []
            way.port.advance(0.2)
        assert [(numbers(run), run.only_for) for run in way.port.runs()] == [([2], 0)]

    def test_not_for_one_that_had_left(self) -> None:
        way = Way(QoSProfile(10))
        way.match()
        way.sender.recipients.unmatched(OTHER)
        way.lose()
        way.declare()
        way.put_apart(1)
        assert way.left() == [[1]]

    def test_not_for_one_that_does_not_ask_for_it(self) -> None:
        way = Way(QoSProfile(10))
        way.match(QoSProfile(10, reliability="best_effort"))
        way.lose()
        way.declare()
        way.put_apart(1)
        assert way.left() == [[1]]

    def test_not_where_that_would_cost_what_it_is_to_save(self) -> None:
        way = Way(LAST_3)
        way.match()
        way.lose()
        way.declare()
        way.put_apart(3)
        assert way.left() == []
        way.put_apart(1)
        assert (way.left(), way.sender.replaced) == ([[1], [2], [3], [4]], 0)

    def test_a_second_broker_that_dies_meanwhile_changes_nothing(self) -> None:
        way = Way(KEEP_ALL)
        way.match()
        way.lose()
        way.declare()
        way.lose()
        way.declare()
        way.put_apart(1)
        assert way.left() == []
        way.match()
        assert way.left() == [[1]]


class TestKeepAll:
    def test_it_takes_what_the_window_has_room_for(self) -> None:
        way = Way(KEEP_ALL, window=4)
        for _ in range(4):
            assert way.sender.can_take(1)
            way.put_apart(1)
        assert not way.sender.can_take(1)
        way.sender.recipients.credit(1)
        assert way.sender.can_take(1)
        way.put_apart(1)
        assert not way.sender.can_take(1)

    def test_in_bytes_too(self) -> None:
        way = Way(KEEP_ALL, window=100)
        way.put(1, size=900)
        assert way.sender.can_take(50) and not way.sender.can_take(200)
        way.sender.recipients.credit(1)
        assert way.sender.can_take(200)

    def test_one_alone_is_taken_however_long_it_is(self) -> None:
        way = Way(KEEP_ALL)
        assert way.sender.can_take(100_000)
        way.put(1, size=100_000)
        assert not way.sender.can_take(1)
        way.sender.recipients.credit(1)
        assert way.sender.can_take(100_000)

    def test_a_credit_that_is_older_takes_nothing_back(self) -> None:
        way = Way(KEEP_ALL, window=2)
        way.put_apart(2)
        way.sender.recipients.credit(2)
        way.sender.recipients.credit(1)
        way.put_apart(1)
        assert way.sender.can_take(1)

    def test_a_run_that_is_gathered_has_room_in_the_window(self) -> None:
        way = Way(KEEP_ALL, window=4)
        way.port.last_sent_ns = way.port.now_ns()
        for at in range(10):
            if not way.sender.can_take(1):
                assert at == 4
                break
            way.put()
        way.port.settle()
        assert way.left() == [[1, 2, 3, 4]]

    def test_what_the_dead_broker_may_not_have_passed_on_comes_once_more_and_first(self) -> None:
        """These samples go only to that subscription. Newer ones go to all."""
        way = Way(KEEP_ALL, window=10)
        way.match()
        way.put_apart(4)
        way.sender.recipients.credit(2)
        assert way.left() == [[1], [2], [3], [4]]
        way.lose()
        way.put_apart(1)
        way.declare()
        assert way.left() == []
        way.match(other=OTHER + 1)
        runs = way.port.runs()
        assert [numbers(run) for run in runs] == [[3], [4], [5]]
        assert [run.only_for for run in runs] == [OTHER + 1, OTHER + 1, 0]

    def test_the_window_is_not_filled_by_what_the_dead_broker_took_with_it(self) -> None:
        way = Way(KEEP_ALL, window=2)
        way.match()
        way.put_apart(2)
        assert not way.sender.can_take(1)
        way.lose()
        way.declare()
        assert way.sender.can_take(1)


class TestCatchingUp:
    def test_one_subscription_alone_gets_what_it_has_missed(self) -> None:
        way = Way(HISTORY)
        way.sender.catch_up(OTHER, [(3, 10, b"3"), (4, 20, b"4"), (5, 30, b"5")], since_ns=20)
        old, new, end = way.port.sent()
        assert (numbers(old), old.is_replay, old.only_for) == ([3], True, OTHER)
        assert (numbers(new), new.is_replay, new.only_for) == ([4, 5], False, OTHER)
        assert end == m.CaughtUp(publisher=1, subscription=OTHER)

    def test_one_that_has_missed_nothing_hears_that_too(self) -> None:
        way = Way(LAST_3)
        way.sender.catch_up(OTHER, [], since_ns=20)
        assert way.port.sent() == [m.CaughtUp(publisher=1, subscription=OTHER)]

    def test_numbers_go_on_where_the_ring_was(self) -> None:
        """Earlier samples went another way, so they are no loss. The broker learns this once."""
        way = Way(LAST_3)
        way.number = 9
        way.sender.resume(10)
        way.put_apart(2)
        runs = way.port.runs()
        assert [(numbers(run), run.is_resumed) for run in runs] == [([10], True), ([11], False)]

    def test_what_went_by_the_ring_does_not_fill_the_window(self) -> None:
        way = Way(KEEP_ALL, window=4)
        way.number = 9
        way.sender.resume(10)
        for _ in range(4):
            assert way.sender.can_take(1)
            way.put_apart(1)
        assert not way.sender.can_take(1)

    def test_they_never_go_back(self) -> None:
        way = Way(LAST_3)
        way.put_apart(2)
        way.sender.resume(1)
        way.put_apart(1)
        assert way.left() == [[1], [2], [3]]


class TestEnd:
    def test_nothing_more_is_sent(self) -> None:
        way = Way(KEEP_ALL)
        way.match()
        way.lose()
        way.put_apart(1)
        way.declare()
        way.put(2)
        way.sender.end()
        way.sender.hand_over()
        way.port.advance(20)
        assert (way.left(), way.sender.open_samples) == ([], 0)

    def test_in_the_child_of_a_fork_the_port_is_left_alone(self) -> None:
        way = Way(LAST_3)
        way.port.last_sent_ns = way.port.now_ns()
        way.put(2)
        asked = len(way.port.calls)
        way.sender.forget_open()
        assert (len(way.port.calls), way.port.written, way.sender.open_samples) == (asked, [], 0)
