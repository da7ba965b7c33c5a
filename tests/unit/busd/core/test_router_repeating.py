"""busd.core.router: a lossless subscription that was lost and is back gets the missed samples again."""

import pytest

from broker_endpoints import Publisher, Subscription
from broker_world import World
from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.layout import PLACES

ALL = QoSProfile(history="keep_all")


class Story:
    """Five samples were published. A subscription has received two of them and was lost."""

    def __init__(
        self,
        offered: QoSProfile = ALL,
        requested: QoSProfile = ALL,
        *,
        keeps: bool = True,
        shares: bool = False,
    ) -> None:
        self.world = World()
        capabilities = (PLACES,) if keeps else ()
        talker = self.world.process("talker", shares=shares, capabilities=capabilities)
        self.publisher: Publisher = talker.publisher("/topic", offered)
        self.requested = requested
        self.shares = shares
        listener = self.world.process("listener", shares=shares)
        self.lost = listener.subscription("/topic", requested)
        if shares:
            self.lost.refuse(self.publisher)
            self.publisher.catch_up(self.lost)
        self.publisher.publish(*"abcde")
        listener.lose()

    def come_back(self, last_seq: int = 2) -> Subscription:
        again = self.world.process("listener", shares=self.shares).node()
        known = {self.publisher.gid: last_seq}
        return again.subscription("/topic", self.requested, gid=self.lost.gid, last_seqs=known)

    def asked(self) -> list[int | None]:
        """The numbers after which the publisher was asked to repeat, by its matches."""
        return [one.last_seq for one in self.publisher.got(m.Matched)]

    def credits(self) -> list[int]:
        return [one.seq for one in self.publisher.got(m.Credit)]


class TestWhatIsMissed:
    def test_comes_before_what_is_new(self) -> None:
        story = Story()
        back = story.come_back()
        assert story.asked() == [None, 2]
        assert [one.next_seq for one in back.got(m.Matched)] == [3]
        story.publisher.publish("f")
        assert back.payloads == []
        story.publisher.catch_up(back, *"cdef", first_seq=3)
        story.publisher.publish("g")
        assert [sample.seq for sample in back.samples] == [3, 4, 5, 6, 7]
        found = back.statistics()
        assert (found.expected, found.dropped) == (5, {})

    @pytest.mark.parametrize(
        ("repeated", "first_seq", "lost"),
        [("", 3, 3), ("e", 5, 2), ("cd", 3, 1)],
        ids=["nothing", "the end", "the beginning"],
    )
    def test_what_the_publisher_does_not_keep_any_more_is_counted(
        self, repeated: str, first_seq: int, lost: int
    ) -> None:
        story = Story()
        back = story.come_back()
        story.publisher.catch_up(back, *repeated, first_seq=first_seq)
        story.publisher.publish("f")
        assert back.payloads == [*repeated, "f"]
        found = back.statistics()
        assert (found.expected, found.dropped) == (4, {"disconnected": lost})

    def test_a_publisher_that_leaves_before_it_has_repeated_it_costs_it(self) -> None:
        story = Story()
        back = story.come_back()
        story.publisher.destroy()
        assert [one.last_seq for one in back.got(m.Unmatched)] == [5]
        found = back.statistics()
        assert (found.expected, found.dropped) == (3, {"disconnected": 3})

    def test_one_that_is_lost_again_says_itself_what_it_had(self) -> None:
        story = Story()
        back = story.come_back()
        story.publisher.catch_up(back, *"cde", first_seq=3)
        back.process.lose()
        last = story.come_back(4)
        assert story.asked() == [None, 2, 4]
        story.publisher.catch_up(last, "e", first_seq=5)
        assert [sample.seq for sample in last.samples] == [5]

    def test_one_lost_before_it_was_repeated_still_is_told_of_it(self) -> None:
        """If the publisher has left meanwhile, the account of the subscription has the loss."""
        story = Story()
        story.come_back().process.lose()
        story.publisher.destroy()
        last = story.come_back()
        assert [one.missed for one in last.got(m.Dropped) if one.missed] == [{story.publisher.gid: (1, 5)}]


class TestWhoIsNotAsked:
    @pytest.mark.parametrize(
        ("offered", "requested", "keeps", "last_seq"),
        [
            (ALL, ALL, False, 2),
            (ALL, QoSProfile(10), True, 2),
            (QoSProfile(10), ALL, True, 2),
            (ALL, ALL, True, 5),
            (ALL, ALL, True, 9),
        ],
        ids=["an older publisher", "lossy", "a lossy publisher", "nothing is missed", "it had more"],
    )
    def test_then_it_gets_what_all_get(
        self, offered: QoSProfile, requested: QoSProfile, keeps: bool, last_seq: int
    ) -> None:
        story = Story(offered, requested, keeps=keeps)
        back = story.come_back(last_seq)
        assert story.asked() == [None, None]
        assert [one.next_seq for one in back.got(m.Matched)] == [6]
        story.publisher.publish("f")
        assert back.payloads == (["f"] if last_seq < 6 else [])

    def test_where_all_went_by_the_ring_it_is_there(self) -> None:
        world = World()
        talker, listener = (world.process(shares=True, capabilities=(PLACES,)) for _ in range(2))
        publisher = talker.publisher("/topic", ALL)
        lost = listener.subscription("/topic", ALL)
        lost.attach(publisher)
        world.process().subscription("/topic", ALL)
        publisher.publish(*"abc")
        listener.lose()
        again = world.process(shares=True).node()
        back = again.subscription("/topic", ALL, gid=lost.gid, last_seqs={publisher.gid: 1})
        assert [one.last_seq for one in publisher.got(m.Matched)] == [None, None, None]
        assert [one.route for one in back.got(m.Matched)] == ["shm"]

    def test_what_went_by_socket_beside_a_ring_is_repeated_by_socket(self) -> None:
        story = Story(shares=True)
        back = story.come_back()
        assert story.asked() == [None, 2]
        assert [one.route for one in back.got(m.Matched)] == ["socket"]


class TestCredit:
    def test_goes_on_where_the_subscription_does(self) -> None:
        story = Story()
        assert story.credits() == [5], "the publisher holds it back by itself"
        back = story.come_back()
        story.publisher.catch_up(back, *"cde", first_seq=3)
        back.ack(story.publisher, 3)
        back.ack(story.publisher, 5)
        assert story.credits() == [5, 3, 5]

    def test_for_another_one_too(self) -> None:
        story = Story()
        other = story.world.process().subscription("/topic", ALL)
        story.publisher.publish("f")
        other.ack(story.publisher, 6)
        back = story.come_back()
        story.publisher.catch_up(back, *"cdef", first_seq=3)
        back.ack(story.publisher, 4)
        assert story.credits() == [5, 6, 4]

    def test_of_what_is_lost_needs_no_acknowledgement(self) -> None:
        story = Story()
        back = story.come_back()
        story.publisher.catch_up(back)
        assert story.credits() == [5, 5]
