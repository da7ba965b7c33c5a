"""bus.delivery.recipients: samples kept for a lost lossless subscription, and the time limit."""

from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.bounds import MOST_PLACES
from bus.wire.runs import Run
from one_way import GID, KEEP_ALL, OTHER, Way, numbers

BACK = OTHER + 1


def repeated(way: Way, last_seq: int, other: int = BACK, gid: bytes = GID) -> list[list[int] | str]:
    """Runs that the sender sends again when the subscription returns and has all samples up to `last_seq`."""
    way.port.sent()
    way.sender.recipients.matched(other, gid, KEEP_ALL, by_socket=True, last_seq=last_seq)
    way.port.flush()
    found = list[list[int] | str]()
    for one in way.port.sent():
        if isinstance(one, Run):
            assert one.only_for == other
            found.append(numbers(one))
        else:
            assert one == m.CaughtUp(publisher=1, subscription=other)
            found.append("caught up")
    return found


def lost(published: int = 5, credit: int = 1, window: int = 10) -> Way:
    """A sender whose subscription was lost; it keeps the place for ten seconds."""
    way = Way(KEEP_ALL, window=window)
    way.match()
    way.put_apart(published)
    way.sender.recipients.credit(credit)
    way.sender.recipients.keep_place(OTHER, 10)
    way.sender.recipients.credit(published)
    return way


class TestItIsBack:
    def test_it_gets_what_it_has_missed_alone(self) -> None:
        assert repeated(lost(), 2) == [[3], [4], [5], "caught up"]

    def test_also_what_was_published_meanwhile(self) -> None:
        way = lost()
        way.put_apart(2)
        assert way.left() == [[1], [2], [3], [4], [5], [6], [7]], "others get it"
        assert repeated(way, 4) == [[5], [6], [7], "caught up"]

    def test_of_a_run_the_rest(self) -> None:
        way = Way(KEEP_ALL, window=10)
        way.match()
        way.put(5)
        way.port.settle()
        assert way.left() == [[1], [2, 3, 4, 5]]
        way.sender.recipients.keep_place(OTHER, 10)
        assert repeated(way, 3) == [[4, 5], "caught up"]

    def test_what_still_waits_here_goes_to_all(self) -> None:
        way = lost(3)
        way.port.is_choked = True
        way.put_apart(2)
        assert repeated(way, 2) == []
        way.port.unchoke()
        found = [(numbers(one), one.only_for) for one in way.port.runs()]
        assert found == [([3], BACK), ([4], 0), ([5], 0)]

    def test_it_may_be_lost_again(self) -> None:
        """The repeated samples may be lost with the second connection."""
        way = lost()
        repeated(way, 2)
        way.sender.recipients.keep_place(BACK, 10)
        assert repeated(way, 2, BACK + 1) == [[3], [4], [5], "caught up"]

    def test_it_may_be_back_before_its_last_connection_is_seen_to_end(self) -> None:
        way = Way(KEEP_ALL, window=10)
        way.match()
        way.put_apart(3)
        assert repeated(way, 1) == [[2], [3], "caught up"]
        way.sender.recipients.keep_place(OTHER, 10)
        assert not way.sender.recipients.places, "it is there"

    def test_one_that_was_never_there_gets_nothing(self) -> None:
        """Otherwise, any process could make a publisher send a full window again and again."""
        assert repeated(lost(), 0, gid=b"x" * 16) == ["caught up"]


class TestWindow:
    def test_it_is_filled_by_what_is_kept(self) -> None:
        way = lost(5, credit=2, window=5)
        way.put_apart(2)
        assert not way.sender.can_take(1)
        repeated(way, 2)
        assert not way.sender.can_take(1)
        way.sender.recipients.credit(3)
        assert way.sender.can_take(1)

    def test_credit_goes_on_where_the_subscription_does(self) -> None:
        way = lost(5, credit=0, window=5)
        repeated(way, 3)
        assert way.sender.can_take(1), "three of five were received"
        way.put_apart(3)
        assert not way.sender.can_take(1)

    def test_where_it_has_missed_nothing_all_credit_counts(self) -> None:
        way = lost(5, credit=0, window=5)
        assert not way.sender.can_take(1)
        way.match(other=BACK)
        assert way.sender.can_take(1)


class TestHowLong:
    def test_until_time_is_up(self) -> None:
        way, gone = lost(5, credit=0, window=5), list[bool]()
        way.sender.recipients.on_fewer = lambda: gone.append(way.sender.can_take(1))
        way.port.advance(9.9)
        assert way.sender.recipients.places and not gone
        way.port.advance(0.3)
        assert not way.sender.recipients.places and gone == [True]
        assert repeated(way, 2) == ["caught up"]

    def test_until_the_broker_says_that_the_process_has_ended(self) -> None:
        way = lost(5, credit=0, window=5)
        way.sender.recipients.keep_place(OTHER + 5, 0)
        assert way.sender.recipients.places
        way.sender.recipients.keep_place(OTHER, 0)
        assert way.sender.can_take(1) and not way.sender.recipients.places

    def test_after_a_lost_connection_time_begins_when_it_is_back(self) -> None:
        way = lost()
        way.lose()
        way.port.advance(60)
        way.declare()
        way.port.advance(9.9)
        assert repeated(way, 2) == [[3], [4], [5], "caught up"]

    def test_the_next_broker_has_other_numbers(self) -> None:
        way = lost()
        way.lose()
        way.declare()
        way.sender.recipients.keep_place(OTHER, 0)
        assert repeated(way, 2) == [[3], [4], [5], "caught up"]

    def test_a_next_broker_that_does_not_ask_is_given_what_was_missed(self) -> None:
        """The new broker does not know whether the subscription had a ring. The publisher sends nothing new
        until the subscription has returned.
        """
        way = lost(3, credit=1)
        way.lose()
        way.declare()
        way.put_apart(1)
        assert way.left()[3:] == []
        way.match(other=BACK)
        found = [(numbers(one), one.only_for) for one in way.port.runs()]
        assert found == [([2], BACK), ([3], BACK), ([4], 0)]
        way.lose()
        way.declare()
        assert repeated(way, 1, BACK + 1) == [[2], [3], [4], "caught up"], "it may not have come"

    def test_who_was_matched_when_the_connection_was_lost_has_a_place_too(self) -> None:
        way = Way(KEEP_ALL, window=10)
        way.match()
        way.match(gid=b"o" * 16, other=8)
        way.put_apart(3)
        way.lose()
        way.declare()
        assert repeated(way, 1) == [[2], [3], "caught up"]
        way.sender.recipients.credit(3)
        assert repeated(way, 0, 12, b"o" * 16) == [[1], [2], [3], "caught up"], "credit was for the other one"

    def test_how_many_is_bounded(self) -> None:
        way = Way(KEEP_ALL, window=10)
        gids = [number.to_bytes(16, "big") for number in range(MOST_PLACES + 1)]
        for number, gid in enumerate(gids, 100):
            way.match(gid=gid, other=number)
        way.put_apart(1)
        for number, _ in enumerate(gids, 100):
            way.sender.recipients.keep_place(number, 10)
        assert repeated(way, 0, gid=gids[0]) == ["caught up"]
        assert repeated(way, 0, gid=gids[1]) == [[1], "caught up"]

    def test_a_lossy_one_has_none(self) -> None:
        way = Way(KEEP_ALL)
        way.match(QoSProfile(10))
        way.sender.recipients.keep_place(OTHER, 10)
        assert not way.sender.recipients.places

    def test_nothing_is_kept_after_the_end(self) -> None:
        way = lost()
        way.sender.end()
        assert not way.sender.recipients.places
        way.port.advance(11)
