"""busd.core.absent: messages for a lost subscription when it is back."""

from absence import DEEP, LATCHED, Story, before, begun, kept, missed
from broker_world import SECOND
from bus.qos import QoSProfile
from bus.wire import messages as m
from busd.core.absent import RETURN_NS


class TestPublishers:
    def test_one_that_published_and_left_meanwhile(self) -> None:
        story = Story()
        story.publisher.publish_many("ab")
        story.lose()
        story.publisher.publish_many("cde")
        story.publisher.destroy()
        back = story.come_back()
        assert missed(back) == [{story.publisher.gid: (1, 5)}]
        told = [type(one) for one in story.listener.messages if isinstance(one, m.Created | m.Dropped)]
        assert told[-2:] == [m.Created, m.Dropped]
        assert kept(story.world) == m.AbsentRecord()

    def test_one_that_left_before_with_samples_on_their_way(self) -> None:
        story = Story()
        story.publisher.publish("a")
        story.listener.is_blocked = True
        story.publisher.publish_many("bc")
        story.publisher.destroy()
        story.lose()
        assert missed(story.come_back()) == [{story.publisher.gid: (1, 3)}]

    def test_one_of_which_all_has_come(self) -> None:
        story = Story()
        story.publisher.publish_many("ab")
        story.publisher.destroy()
        story.lose()
        assert missed(story.come_back()) == [{story.publisher.gid: (1, 2)}], "of which it knows"

    def test_one_that_is_still_there_is_told_by_its_match(self) -> None:
        story = Story()
        story.publisher.publish_many("ab")
        story.lose()
        story.publisher.publish_many("cde")
        back = story.come_back()
        assert missed(back) == []
        assert begun(back) == {story.publisher.gid: 1}
        assert [matched.next_seq for matched in back.got(m.Matched)] == [6]
        story.publisher.destroy()
        assert missed(back) == []
        assert [gone.last_seq for gone in back.got(m.Unmatched)] == [5]

    def test_one_that_it_never_heard_of_and_that_is_there(self) -> None:
        """Before the match, it learns the first number of the publisher's samples for it. The match has the
        number of the next one.
        """
        story = Story()
        story.listener.is_blocked = True
        late = story.talker.publisher("/topic", DEEP, next_seq=7)
        late.publish_many("abc")
        story.lose()
        back = story.come_back({})
        assert missed(back) == []
        assert begun(back) == {story.publisher.gid: 1, late.gid: 7}
        kinds = [type(one) for one in story.listener.messages]
        assert kinds.index(m.Dropped) < kinds.index(m.Matched)

    def test_one_that_it_never_heard_of_and_that_has_left(self) -> None:
        story = Story()
        story.listener.is_blocked = True
        late = story.talker.publisher("/topic", DEEP, next_seq=7)
        late.publish_many("abc")
        late.destroy()
        story.lose()
        assert missed(story.come_back({story.publisher.gid: 0})) == [{late.gid: (7, 9)}]

    def test_one_that_comes_and_goes_while_it_is_away_is_none_of_its(self) -> None:
        story = Story()
        story.lose()
        late = story.talker.publisher("/topic")
        late.publish("a")
        late.destroy()
        assert missed(story.come_back()) == []

    def test_one_that_was_lost_came_back_and_left(self) -> None:
        story = Story()
        story.publisher.publish("a")
        story.lose()
        story.talker.die()
        again = story.come_as_talker(next_seq=4)
        again.publish_many("def")
        again.destroy()
        assert missed(story.come_back({again.gid: 1})) == [{again.gid: (1, 6)}]

    def test_one_that_was_killed(self) -> None:
        story = Story()
        story.lose()
        story.publisher.publish_many("ab")
        story.talker.die()
        assert missed(story.come_back()) == [{story.publisher.gid: (1, 2)}]

    def test_one_whose_samples_went_to_others_by_its_ring(self) -> None:
        """The publisher's report has the number of samples. No later sample can show the loss."""
        story = Story(shares=True)
        story.publisher.publish("a")
        story.lose()
        story.talker.tell(m.Report(endpoint=story.publisher.id, samples=9, bytes=9))
        story.publisher.destroy()
        assert missed(story.come_back()) == [{story.publisher.gid: (1, 9)}]

    def test_one_by_shared_memory(self) -> None:
        """A subscription that has begun to read the ring knows its own first number. There may be another
        ring.
        """
        story = Story(by_ring=True)
        story.lose()
        story.talker.tell(m.Report(endpoint=story.publisher.id, samples=9, bytes=9))
        story.publisher.destroy()
        assert missed(story.come_back({story.publisher.gid: 4})) == [{story.publisher.gid: (0, 9)}]
        story.lose()
        assert missed(story.come_back({story.publisher.gid: 9})) == []

    def test_one_by_shared_memory_that_had_left_before(self) -> None:
        """The subscription may not have read the message about the end."""
        story = Story(by_ring=True)
        story.talker.tell(m.Report(endpoint=story.publisher.id, samples=9, bytes=9))
        story.publisher.destroy()
        story.lose()
        assert missed(story.come_back({story.publisher.gid: 4})) == [{story.publisher.gid: (0, 9)}]

    def test_one_by_shared_memory_that_is_there(self) -> None:
        story = Story(by_ring=True)
        story.lose()
        back = story.come_back({story.publisher.gid: 4})
        assert (missed(back), begun(back)) == ([], {})

    def test_one_by_shared_memory_that_was_killed(self) -> None:
        """No process has told busd what was in its ring."""
        story = Story(by_ring=True)
        story.lose()
        story.talker.die()
        back = story.come_back({story.publisher.gid: 4})
        assert (missed(back), begun(back)) == ([], {})

    def test_what_went_to_others_before_the_match_is_not_missed(self) -> None:
        story = Story(shares=True)
        story.publisher.resume(5)
        story.publisher.publish("a")
        story.lose()
        story.publisher.publish("b")
        story.publisher.destroy()
        assert missed(story.come_back({})) == [{story.publisher.gid: (5, 6)}]


class TestHistory:
    """Transient local: missed samples may come once more, as long as the publisher exists."""

    def test_what_was_to_come_of_it_is_missed_where_the_publisher_has_left(self) -> None:
        story = Story(LATCHED, LATCHED)
        story.publisher.publish_many("abcd")
        story.gid = next(story.world.gids).to_bytes(16, "big")
        # A late joiner, which does not read the last three samples.
        late = story.come_back({}, is_blocked=True)
        assert missed(late) == []
        story.lose()
        story.publisher.destroy()
        assert missed(story.come_back({})) == [{story.publisher.gid: (2, 4)}]

    def test_of_one_that_was_lost_it_is_waited_for(self) -> None:
        story = Story(LATCHED, LATCHED)
        story.publisher.publish("a")
        story.lose()
        story.publisher.publish_many("bc")
        story.talker.die()
        back = story.come_back()
        story.world.advance(RETURN_NS / SECOND - 1)
        assert missed(back) == []
        story.world.advance(1)
        assert missed(back) == [{story.publisher.gid: (1, 3)}]
        story.world.advance(2 * RETURN_NS / SECOND)
        assert len(missed(back)) == 1

    def test_of_one_that_comes_back_in_time_it_comes(self) -> None:
        story = Story(LATCHED, LATCHED)
        story.publisher.publish("a")
        story.lose()
        story.publisher.publish_many("bc")
        story.talker.die()
        back = story.come_back()
        again = story.come_as_talker(next_seq=1)
        again.publish_many("abc")
        story.world.advance(2 * RETURN_NS / SECOND)
        assert missed(back) == []
        assert back.payloads == ["b", "c"]

    def test_of_one_that_comes_back_too_late_it_does_not_come_twice(self) -> None:
        story = Story(LATCHED, LATCHED)
        story.publisher.publish("a")
        story.lose()
        story.publisher.publish_many("bc")
        story.talker.die()
        back = story.come_back()
        story.world.advance(RETURN_NS / SECOND)
        again = story.come_as_talker(next_seq=1)
        again.publish_many("abcd")
        assert missed(back) == [{again.gid: (1, 3)}]
        assert back.payloads == ["d"]

    def test_it_is_not_waited_for_where_the_subscription_goes_again(self) -> None:
        story = Story(LATCHED, LATCHED)
        story.publisher.publish("a")
        story.lose()
        story.talker.die()
        story.come_back({}).destroy()
        story.world.advance(RETURN_NS / SECOND)
        assert story.subscription.got(m.Dropped)[1:] == []


class TestReasons:
    def test_what_was_dropped_before_it_was_lost(self) -> None:
        story = Story(requested=QoSProfile(depth=2))
        story.listener.is_blocked = True
        story.publisher.publish_many("abcde")
        story.lose()
        back = story.come_back(is_blocked=True)
        story.publisher.publish_many("fghi")
        story.lose()
        again = story.come_back()
        assert before(back) == []  # the message is unread
        assert before(again) == [{"replaced": 5}], "all that was, and it knows what it was told of that"

    def test_not_where_what_was_dropped_may_come_once_more(self) -> None:
        story = Story(LATCHED, LATCHED)
        story.listener.is_blocked = True
        story.publisher.publish_many("abcde")
        story.lose()
        assert before(story.come_back()) == []


class TestTwice:
    def test_what_it_may_not_have_read_it_is_told_again(self) -> None:
        story = Story()
        story.lose()
        story.publisher.publish_many("ab")
        story.publisher.destroy()
        for _ in range(2):
            story.come_back({}, is_blocked=True)
            story.lose()
        assert missed(story.come_back({})) == [{story.publisher.gid: (1, 2)}]

    def test_what_it_knows_it_is_not(self) -> None:
        story = Story()
        story.lose()
        story.publisher.publish_many("ab")
        story.publisher.destroy()
        story.come_back({})
        story.lose()
        assert missed(story.come_back({story.publisher.gid: 2})) == [{story.publisher.gid: (1, 2)}]

    def test_what_waits_for_a_publisher_to_return_waits_on(self) -> None:
        story = Story(LATCHED, LATCHED)
        story.publisher.publish("a")
        story.lose()
        story.publisher.publish("b")
        story.talker.die()
        story.come_back({story.publisher.gid: 1})
        story.lose()
        back = story.come_back({story.publisher.gid: 1})
        story.world.advance(RETURN_NS / SECOND)
        assert missed(back) == [{story.publisher.gid: (1, 2)}]

    def test_two_subscriptions_have_an_account_each(self) -> None:
        story = Story()
        other = story.listener.subscription("/topic")
        story.publisher.publish("a")
        story.lose()
        story.publisher.publish("b")
        story.publisher.destroy()
        first = story.come_back({story.publisher.gid: 1})
        second = story.listener.node("two").subscription("/topic", gid=other.gid, last_seqs={})
        assert missed(first) == missed(second) == [{story.publisher.gid: (1, 2)}]


def test_a_publisher_that_leaves_says_what_went_by_its_ring() -> None:
    """A subscription that was away and is back would have got these samples."""
    story = Story(shares=True)
    other = story.world.process().subscription("/topic", DEEP)
    story.publisher.publish("a")
    story.lose()
    back = story.come_back()
    story.talker.tell(m.Report(endpoint=story.publisher.id, samples=5, bytes=5))
    story.publisher.destroy()
    assert [gone.last_seq for gone in back.got(m.Unmatched)] == [5]
    assert back.statistics().dropped == {"disconnected": 4}
    assert back.statistics().expected == 4
    assert other.statistics().dropped == {}
    assert other.statistics().expected == 1
