import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.qos import QoSProfile
from bus_bridge.batch import Batch, Loose, Sample
from bus_bridge.core import export
from bus_bridge.core.export import Export
from bus_bridge.engine import RouteRule

_GID = bytes(16)


class Writer:
    def __init__(self) -> None:
        self.is_wanted = True
        self.room = 1 << 30
        self.lost: dict[str, int] = {}
        self.numbers: list[int] = []
        self.is_closed = False

    def write(self, batch: Batch) -> int:
        taken = list(batch)[: self.room]
        self.numbers += [one.number for one in taken]
        self.room -= len(taken)
        return len(taken)

    def close(self) -> None:
        self.is_closed = True


class Way:
    """An export with everything that it needs."""

    def __init__(self, qos: QoSProfile | int = 10, rule: RouteRule | None = None, depth: int = 100) -> None:
        self.is_matched = True
        self.frees = 0
        self.writer = Writer()
        self.export = Export(_GID, depth, lambda gid: self.is_matched, self._free)
        self.qos = QoSProfile(qos) if isinstance(qos, int) else qos
        self.rule = rule or RouteRule()

    def attach(self) -> "Way":
        self.export.attach(self.writer, self.qos, self.rule)
        return self

    def put(self, *numbers: int) -> None:
        self.export.put(Loose([Sample(b"1234", number, number) for number in numbers]))

    def _free(self, gid: bytes) -> None:
        self.frees += 1

    @property
    def closes(self) -> bool:
        account = self.export.account
        return account.waiting == self.export.waiting and account.sent == len(self.writer.numbers)


def test_what_is_wanted_goes_at_once() -> None:
    way = Way().attach()
    way.put(1, 2, 3)
    assert way.writer.numbers == [1, 2, 3]
    assert (way.export.account.bytes, way.export.account.dropped) == (12, {})
    assert way.closes


def test_what_comes_before_the_way_is_made_waits_up_to_the_depth_of_its_publisher() -> None:
    way = Way(3)
    way.put(*range(1, 6))
    way.writer.is_wanted = False
    way.attach()
    way.put(6)
    assert way.export.waiting == 3
    assert way.export.account.dropped == {"replaced": 3}
    way.writer.is_wanted = True
    way.export.flush()
    assert way.writer.numbers == [4, 5, 6]
    assert way.closes


def test_what_nobody_wants_is_passed_over() -> None:
    way = Way().attach()
    way.writer.is_wanted = way.is_matched = False
    way.put(1, 2)
    assert way.export.account.dropped == {"not_wanted": 2}
    way.is_matched = True
    way.put(3)
    way.is_matched = False
    way.export.flush()
    assert way.export.account.dropped == {"not_wanted": 3}
    assert way.closes


def test_order_is_kept_where_the_engine_takes_little() -> None:
    way = Way().attach()
    way.writer.room = 1
    way.put(1, 2, 3)
    way.put(4)
    way.writer.room = 2
    way.export.flush()
    way.put(5)
    way.writer.room = 100
    way.export.flush()
    assert way.writer.numbers == [1, 2, 3, 4, 5]


def test_a_lossless_publisher_waits_once_there_is_no_room_and_loses_nothing() -> None:
    way = Way(QoSProfile(history="keep_all"), depth=10).attach()
    way.writer.room = 0
    way.put(*range(1, 10))
    assert not way.export.is_full, "others of its topic go on"
    way.put(*range(10, 50))
    assert way.export.is_full
    way.writer.room = 30
    way.export.flush()
    assert (way.export.is_full, way.frees) == (True, 0)
    way.writer.room = 10
    way.export.flush()
    assert (way.export.is_full, way.frees, way.export.waiting) == (False, 1, 9)
    way.writer.room = 100
    way.export.flush()
    assert way.writer.numbers == list(range(1, 50))
    assert (way.frees, way.closes) == (1, True)


@pytest.mark.parametrize(
    ("qos", "rule"),
    [
        (QoSProfile(history="keep_all"), RouteRule(depth=100)),
        (QoSProfile(5, reliability="best_effort"), RouteRule()),
    ],
)
def test_a_publisher_that_was_full_goes_on_if_its_new_rule_has_room(qos: QoSProfile, rule: RouteRule) -> None:
    """After a reload, or if it published more than a queue before its rule was known."""
    way = Way(QoSProfile(history="keep_all"), depth=10).attach()
    way.writer.room = 0
    way.put(*range(1, 11))
    assert (way.export.is_full, way.frees) == (True, 0)
    way.qos, way.rule = qos, rule
    way.attach()
    assert (way.export.is_full, way.frees) == (False, 1)


def test_a_lossless_publisher_waits_for_bytes_too() -> None:
    way = Way(QoSProfile(history="keep_all")).attach()
    way.writer.room = 0
    way.export.put(Loose([Sample(bytes(1 << 19), 1, 1)]))
    assert not way.export.is_full
    way.export.put(Loose([Sample(bytes(1 << 19), 2, 2)]))
    assert way.export.is_full


def test_a_lossless_publisher_that_had_room_for_more_loses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """The publisher's own window may be larger than the number of messages that may wait in an export."""
    monkeypatch.setattr(export, "_MOST_BYTES", 8)
    for qos, waiting in ((QoSProfile(history="keep_all"), 5), (QoSProfile(10), 2)):
        way = Way(qos).attach()
        way.writer.room = 0
        way.put(*range(1, 6))
        assert (way.export.waiting, way.closes) == (waiting, True)


def test_numbers_that_are_missing_were_lost_in_the_tap() -> None:
    way = Way().attach()
    way.put(5, 6)  # the first number may be any
    way.put(9)
    assert way.export.account.dropped == {"replaced": 2}
    way.export.begin(is_back=False)  # another tap
    way.put(20)
    assert way.export.account.dropped == {"replaced": 2}
    assert way.closes


def test_what_a_far_subscription_missed_while_it_was_cut_off_was_not_wanted() -> None:
    way = Way().attach()
    way.export.begin(is_back=True)
    way.put(5)  # from a publisher that it did not know before
    way.export.begin(is_back=True)
    way.put(9)
    way.put(11)
    assert way.export.account.dropped == {"not_wanted": 3, "replaced": 1}
    assert way.closes


def test_a_history_that_comes_again_does_not_go_again() -> None:
    way = Way(QoSProfile(10, durability="transient_local")).attach()
    way.put(1, 2, 3)
    way.export.begin(is_back=False)
    way.put(1, 2, 3, 4)
    assert way.writer.numbers == [1, 2, 3, 4]
    assert way.export.account.dropped == {"repeated": 3}
    assert way.closes


def test_rules_bound_the_rate() -> None:
    way = Way(rule=RouteRule(max_rate_hz=1e9 / 10)).attach()  # sample n has a time of n ns
    way.put(*range(1, 101))
    assert way.writer.numbers == list(range(1, 101, 10))
    assert way.export.account.dropped == {"rate_limit": 90}
    assert way.closes


def test_at_its_end_what_waits_is_counted_as_lost() -> None:
    way = Way().attach()
    way.writer.room = 0
    way.put(1, 2)
    way.export.close()
    assert way.export.account.dropped == {"disconnected": 2}
    assert way.writer.is_closed
    assert way.closes


def test_what_the_engine_has_lost_was_not_sent() -> None:
    way = Way().attach()
    way.put(1, 2, 3)
    way.writer.lost = {"link_congested": 1}
    assert (way.export.sent, way.export.losses) == (2, {"link_congested": 1})


_acts = st.one_of(
    st.tuples(st.just("put"), st.integers(1, 9)),
    st.tuples(st.just("room"), st.integers(0, 20)),
    st.tuples(st.just("wanted"), st.booleans()),
    st.tuples(st.just("matched"), st.booleans()),
    st.tuples(st.just("skip"), st.integers(1, 3)),
    st.tuples(st.just("flush"), st.none()),
)


@given(st.lists(_acts, max_size=60), st.booleans())
def test_accounts_close_and_order_is_kept_whatever_happens(
    acts: list[tuple[str, int]], lossless: bool
) -> None:
    way = Way(QoSProfile(history="keep_all") if lossless else QoSProfile(4), depth=8).attach()
    number = 0
    for act, value in acts:
        match act:
            case "put":
                way.put(*range(number + 1, number + value + 1))
                number += value
            case "room":
                way.writer.room = value
            case "wanted":
                way.writer.is_wanted = bool(value)
            case "matched":
                way.is_matched = bool(value)
            case "skip":
                number += value
            case _:
                way.export.flush()
        assert way.closes
    assert way.writer.numbers == sorted(set(way.writer.numbers))


def test_a_lossless_publisher_that_nobody_reads_is_held_up_for_a_while_only() -> None:
    way = Way(QoSProfile(history="keep_all"), depth=3).attach()
    way.writer.is_wanted = False
    way.put(1, 2)
    assert not way.export.has_timed_out(1000.0)  # there is room
    way.put(3)
    assert [way.export.has_timed_out(now_s) for now_s in (2000.0, 2001.0, 2029.9)] == [False] * 3
    assert way.export.is_full and way.frees == 0
    assert way.export.has_timed_out(2030.0)
    assert not way.export.has_timed_out(9999.0)
    way.put(4, 5, 6)
    assert (way.export.waiting, way.frees, way.export.losses) == (0, 1, {"not_wanted": 6})
    way.writer.is_wanted = True
    way.export.flush()
    way.put(7)
    way.writer.is_wanted = False
    way.put(8, 9, 10)  # it was wanted meanwhile, so it is expected again
    assert way.writer.numbers == [7] and way.export.is_full and way.closes
    assert [way.export.has_timed_out(now_s) for now_s in (9999.0, 9999.9)] == [False] * 2


def test_one_that_is_read_however_slowly_is_held_up_without_an_end() -> None:
    way = Way(QoSProfile(history="keep_all"), depth=3).attach()
    way.writer.room = 0
    way.put(1, 2, 3)
    assert way.export.is_full
    assert not any(way.export.has_timed_out(float(now_s)) for now_s in range(100))
    way.writer.is_wanted = False
    assert not way.export.has_timed_out(100.0)
    way.writer.is_wanted = True
    assert not way.export.has_timed_out(129.0)
    way.writer.is_wanted = False
    assert not way.export.has_timed_out(131.0)
