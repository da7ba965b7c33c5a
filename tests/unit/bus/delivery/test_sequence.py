"""bus.delivery.sequence: the numbers of samples, received by any route, and the losses that they show."""

from bus.delivery.sequence import PublisherProxy, SequenceTracker
from bus.qos import QoSProfile
from bus.wire.bounds import MOST_REMEMBERED
from bus.wire.layout import RECORD_HEAD
from bus.wire.messages import Matched
from bus.wire.runs import Run
from rows import for_each

GID = bytes(16)
SECOND = 1_000_000_000


class Heard:
    """A subscription of one publisher, which had published nothing before the match."""

    def __init__(self) -> None:
        self.lost: list[tuple[str, int]] = []
        self.tracker = SequenceTracker(lambda reason, count: self.lost.append((reason, count)))
        self.source = self.tracker[7] = PublisherProxy(7, GID, 0, 0, needs_ack=False)

    def get(self, first_seq: int, count: int = 1, *, number: int = 7, is_replay: bool = False) -> list[int]:
        """A run arrives. Returns the numbers that remain of it."""
        body = b"".join(
            RECORD_HEAD.pack(1, 0) + b"%d" % (seq % 10) for seq in range(first_seq, first_seq + count)
        )
        run = Run(0, number, first_seq, count, body, is_replay)
        if not self.tracker.check_run(self.source, run):
            return []
        self.source.last_seq = max(self.source.last_seq, run.first_seq + run.count - 1)
        left = list(range(run.first_seq, run.first_seq + run.count))
        assert [bytes(payload) for payload, _ in run.records()] == [b"%d" % (seq % 10) for seq in left]
        return left

    def return_as(self, number: int, next_seq: int, *, routed_seq: int = 0) -> None:
        self.tracker.forget(self.source.number, routed_seq)
        matched = Matched(endpoint=1, other=number, node="/n", gid=GID, qos=QoSProfile(), next_seq=next_seq)
        source = self.tracker.take_back(matched)
        assert source is self.source
        self.tracker[number] = source


def test_repeated_samples_are_cut_off() -> None:
    heard = Heard()
    assert heard.get(1, 3) == [1, 2, 3]
    assert heard.get(2, 4) == [4, 5]
    assert heard.get(4, 2) == []
    assert heard.tracker.repeated == 4
    assert heard.tracker.missing == 0


@for_each(
    ("lifespan", "clock_ns", "expected"),
    [
        (None, 5, 0),
        (7.0, 0, 7 * SECOND),
        (7.0, 5 * SECOND, 2 * SECOND),
        (7.0, -5 * SECOND, 12 * SECOND),
        (7.0, 9 * SECOND, -2 * SECOND),
        (7.0, 7 * SECOND, 1),
    ],
)
def test_a_lifespan_is_for_stamps_of_its_clock(lifespan: float | None, clock_ns: int, expected: int) -> None:
    source, qos = Heard().source, QoSProfile(lifespan=lifespan)
    source.renew(Matched(endpoint=1, other=7, node="/n", gid=GID, qos=qos, next_seq=1, clock_ns=clock_ns))
    assert (source.lifespan_ns, source.clock_ns) == (expected, clock_ns)


def test_a_replay_is_old_and_yet_new() -> None:
    heard = Heard()
    heard.source.last_seq = 9  # the match begins with 10
    assert heard.get(8, 2, is_replay=True) == [8, 9]
    assert heard.get(10) == [10]
    assert heard.tracker.missing == 0


def test_numbers_that_are_missing() -> None:
    heard = Heard()
    heard.get(5)
    assert heard.tracker.missing == 0, "before its first they may have gone to others by their rings"
    heard.get(8)
    assert heard.tracker.missing == 2
    assert heard.lost == []


class TestBrokerThatDies:
    def test_what_it_had_no_time_to_tell(self) -> None:
        heard = Heard()
        heard.get(1)
        heard.get(6)
        heard.tracker.disconnected(3, "replaced")
        assert heard.lost == [("disconnected", 1)]
        assert heard.tracker.lost_between == 1
        assert not heard.tracker

    def test_what_it_had_told_is_not_counted_again(self) -> None:
        heard = Heard()
        heard.get(1)
        heard.tracker.disconnected(4, "replaced")  # the broker reports that it dropped 2 to 5
        heard.tracker.disconnected(0, "replaced")  # the next broker dies before anything arrives
        heard.tracker.lose_while_away(7)
        assert heard.lost == [("disconnected", 3)]

    def test_what_it_had_told_of_one_that_had_gone_is_not_missing_with_another(self) -> None:
        heard = Heard()
        heard.get(1)
        other = heard.tracker[8] = PublisherProxy(8, b"other", 5, 0, needs_ack=False)
        heard.tracker.forget(8, 9)
        # The reports are about 6 to 9 of the other publisher, and then about 2 and 3.
        heard.tracker.disconnected(6, "replaced")
        heard.tracker.lose_while_away(5, GID)
        assert heard.lost == [("disconnected", 3)]
        heard.tracker.miss({other.gid: (0, 12)})
        assert heard.lost == [("disconnected", 3), ("disconnected", 3)]

    def test_what_it_had_told_of_one_that_had_gone_does_not_hide_what_it_had_no_time_to_tell(self) -> None:
        heard = Heard()
        heard.get(1)
        heard.get(6)  # 2 to 5 were dropped, and the broker has reported none of them
        heard.tracker[8] = PublisherProxy(8, b"other", 5, 0, needs_ack=False)
        heard.tracker.forget(8, 9)
        heard.tracker.disconnected(4, "replaced")
        assert heard.lost == [("disconnected", 4)]

    def test_what_one_that_had_gone_may_repeat_may_also_be_missing_with_it(self) -> None:
        heard = Heard()
        heard.tracker[8] = PublisherProxy(8, b"other", 5, 0, needs_ack=True)
        heard.tracker.forget(8, 9)
        heard.tracker.disconnected(4, "replaced")
        heard.tracker.lose_while_away(5, GID)
        assert heard.lost == [("disconnected", 1)]

    def test_the_replay_of_the_next_one_fills_a_part(self) -> None:
        heard = Heard()
        heard.source.last_seq = 4
        heard.source.comes_back(4, 11)
        assert heard.get(9, 2, is_replay=True) == [9, 10]
        assert heard.lost == [("disconnected", 4)]
        assert heard.get(12) == [12]
        assert heard.tracker.missing == 1


class TestReasons:
    """Later reports of the broker about samples that it dropped before the connection was lost."""

    def test_what_was_dropped_has_its_reason(self) -> None:
        heard = Heard()
        heard.get(1)
        heard.tracker.disconnected(0, "replaced")
        heard.tracker.explain({"replaced": 3, "expired": 1})
        heard.tracker.lose_while_away(2)
        heard.tracker.lose_while_away(5)
        assert heard.lost == [("replaced", 2), ("replaced", 1), ("expired", 1), ("disconnected", 3)]
        assert heard.tracker.lost_between == 7

    def test_what_was_found_lost_without_one_keeps_it(self) -> None:
        heard = Heard()
        heard.get(1)
        heard.get(4)
        # 2 and 3 are missing, and the broker has not given a reason.
        heard.tracker.disconnected(0, "replaced")
        heard.tracker.explain({"replaced": 5})
        heard.tracker.lose_while_away(4)
        assert heard.lost == [("disconnected", 2), ("replaced", 3), ("disconnected", 1)]

    def test_what_was_told_is_not_counted_again(self) -> None:
        heard = Heard()
        heard.get(1)
        heard.tracker.disconnected(3, "replaced")
        heard.tracker.explain({"replaced": 1})
        heard.tracker.lose_while_away(5)
        assert heard.lost == [("replaced", 1), ("disconnected", 1)]

    def test_reasons_end_with_the_connection(self) -> None:
        heard = Heard()
        heard.tracker.explain({"replaced": 5})
        heard.tracker.disconnected(0, "replaced")
        heard.tracker.lose_while_away(2)
        assert heard.lost == [("disconnected", 2)]


class TestLastSeqs:
    """The numbers that a subscription reports when it returns."""

    def test_the_last_number_of_each_those_that_are_there_at_the_end(self) -> None:
        heard = Heard()
        heard.get(1, 3)
        heard.tracker[8] = PublisherProxy(8, b"other", 5, 0, needs_ack=False)
        heard.tracker.forget(8)
        heard.tracker.disconnected(0, "replaced")
        assert [*heard.tracker.last_seqs.items()] == [(b"other", 5), (GID, 3)]

    def test_of_many_that_have_gone(self) -> None:
        """The broker remembers 128 publishers, and asks about those."""
        heard = Heard()
        gids = [number.to_bytes(16, "big") for number in range(100, 100 + MOST_REMEMBERED + 200)]
        for number, gid in enumerate(gids, 100):
            heard.tracker[number] = PublisherProxy(number, gid, number, 0, needs_ack=False)
            heard.tracker.forget(number)
        heard.tracker.disconnected(0, "replaced")
        known = heard.tracker.last_seqs
        assert [*known] == [*gids, GID][-MOST_REMEMBERED:]
        assert all(int.from_bytes(gid, "big") == last_seq for gid, last_seq in known.items())

    def test_a_history_that_has_not_come_whole(self) -> None:
        """The rest of the history arrives after the reconnection."""
        for first_seq, count, last_seq in ((6, 0, None), (6, 2, 7), (6, 4, 9), (6, 5, 10)):
            heard = Heard()
            heard.source.last_seq, heard.source.replayed_seq = 9, 0
            if count:
                heard.get(first_seq, min(count, 4), is_replay=True)
            if count > 4:
                heard.get(10)
            heard.tracker.disconnected(0, "replaced")
            assert heard.tracker.last_seqs.get(GID) == last_seq


class TestPublisherThatReturns:
    def test_nothing_comes_twice(self) -> None:
        heard = Heard()
        heard.get(1, 3)
        heard.return_as(9, 1)
        assert heard.get(1, 5, number=9) == [4, 5]
        assert heard.lost == []

    def test_what_it_sent_before_may_come_later(self) -> None:
        heard = Heard()
        heard.get(1)
        heard.return_as(9, 6)
        assert heard.get(2, 2) == [2, 3]
        assert heard.get(6, number=9) == [6]
        assert heard.lost == [("disconnected", 2)]

    def test_what_the_broker_dropped_of_it_is_not_lost_once_more(self) -> None:
        heard = Heard()
        heard.get(1)
        heard.return_as(9, 9, routed_seq=6)  # 2 to 6 were routed and dropped; 7 and 8 were never sent
        heard.get(9, number=9)
        assert heard.lost == [("disconnected", 2)]
        assert heard.tracker.missing == 5

    def test_what_was_dropped_between_two_returns(self) -> None:
        heard = Heard()
        heard.get(1)
        heard.return_as(9, 5, routed_seq=2)  # 3 and 4 were never sent
        heard.return_as(11, 9, routed_seq=7)  # 5 to 7 were routed, 8 was never sent
        assert heard.get(6, 1, number=9) == [6]  # the only one of them that was still queued
        assert heard.lost == [("disconnected", 2)]
        assert heard.get(9, 1, number=11) == [9]
        assert heard.lost == [("disconnected", 2), ("disconnected", 1)]
        assert heard.tracker.missing == 3  # 2, 5 and 7

    def test_it_returns_and_goes_without_a_word(self) -> None:
        heard = Heard()
        heard.get(1)
        for number in range(100, 300):
            heard.return_as(number, 4, routed_seq=2)
        assert len(heard.source.gaps) == 1
        heard.get(4, number=299)
        assert heard.lost == [("disconnected", 1)]

    def test_of_many_returns_without_a_sample_the_latest_are_known(self) -> None:
        heard = Heard()
        heard.get(1)
        for turn in range(1, 71):  # each time one sample was never sent, and the next one was routed
            heard.return_as(100 + turn, 2 * turn + 1, routed_seq=2 * turn - 1)
        heard.get(13, number=170)
        assert heard.lost == []  # the gaps before 13 are the six oldest
        heard.get(15, number=170)
        assert heard.lost == [("disconnected", 1)]
        heard.get(141, number=170)
        assert heard.lost == [("disconnected", 1), ("disconnected", 63)]

    def test_one_that_has_long_gone_is_forgotten(self) -> None:
        heard = Heard()
        heard.tracker.forget(7)
        for number in range(100, 200):
            heard.tracker.forget(number)
        matched = Matched(endpoint=1, other=9, node="/n", gid=GID, qos=QoSProfile())
        assert heard.tracker.take_back(matched) is None
        assert 7 not in heard.tracker


@for_each(("told", "lapped"), [(0, 5), (2, 3), (9, 0)])
def test_a_ring_that_gave_up_some_before_the_match_went_by_socket(told: int, lapped: int) -> None:
    """The ring did not lose the missing samples that the broker reports as dropped."""
    heard = Heard()
    heard.source.is_rerouted = True
    heard.get(6)
    assert heard.tracker.missing == 5
    assert heard.tracker.lapped(told) == lapped
    heard.tracker.disconnected(told, "replaced")
    assert heard.lost == ([("replaced", lapped)] if lapped else [])


class TestBeginnings:
    """Missing numbers before the first sample: the broker had skipped them, or they went to other
    subscriptions by a ring.
    """

    @staticmethod
    def heard(first_seq: int, told: int) -> Heard:
        """A subscription that got one run, and then lost a broker that had reported `told` dropped
        samples.
        """
        heard = Heard()
        heard.get(first_seq)
        heard.tracker.disconnected(told, "replaced")
        assert heard.lost == []
        return heard

    def test_what_was_told_is_what_comes_next(self) -> None:
        heard = self.heard(5, told=3)
        heard.tracker.learn({GID: (4, 9)})  # so two of the three come after 5
        heard.tracker.miss({GID: (4, 9)})
        assert heard.lost == [("disconnected", 2)]

    def test_what_was_told_is_what_came_before(self) -> None:
        heard = self.heard(5, told=3)
        heard.tracker.learn({GID: (2, 9)})
        heard.tracker.miss({GID: (2, 9)})
        assert heard.lost == [("disconnected", 4)]

    def test_what_was_skipped_and_not_told(self) -> None:
        heard = self.heard(5, told=1)
        heard.tracker.learn({GID: (2, 0)})
        assert heard.lost == [("disconnected", 2)]
        heard.tracker.learn({GID: (2, 0)})
        assert heard.lost == [("disconnected", 2)], "told twice, counted once"

    def test_nobody_says(self) -> None:
        heard = self.heard(5, told=3)
        heard.tracker.learn({})
        heard.tracker.note_received(GID, 9)
        heard.tracker.miss({GID: (0, 9)})
        assert heard.lost == [], "it reads the ring, and knows where it is"
        assert heard.tracker.last_seqs == {GID: 9}

    def test_nobody_says_and_it_does_not_read_the_ring(self) -> None:
        """The subscription lost the match before it had learned of the ring."""
        heard = self.heard(5, told=0)
        heard.tracker.miss({GID: (0, 9), b"of whom nothing was heard": (0, 9)})
        assert heard.lost == [("disconnected", 4)]
