"""busd.core.absent: the subscriptions for which busd keeps records, for how long, and how many."""

import pytest

from absence import Story, begun, kept, missed
from broker_world import SECOND, UID
from bus.base.ids import EndpointId
from bus.wire import messages as m
from bus.wire.codec import encode_frame
from bus.wire.layout import FRAME_HEAD_BYTES, MAX_COUNT
from busd.core import absent
from busd.core.absent import KEEP_NS, LOG_AGAIN_NS


class TestOthers:
    """busd gives the records only to the same user, on the same topic."""

    @pytest.mark.parametrize("uid", [0, UID + 1])
    def test_another_user(self, uid: int) -> None:
        story = Story()
        story.lose()
        story.publisher.publish("a")
        story.publisher.destroy()
        thief = story.come_back({}, uid=uid)
        assert missed(thief) == []
        assert missed(story.come_back({})) == [{story.publisher.gid: (1, 1)}], "and takes nothing away"

    def test_of_two_guests_with_the_same_gid_each_has_its_own(self) -> None:
        story = Story(uid=UID + 1)
        other = story.world.process(uid=UID + 2)
        other.subscription("/topic")
        story.lose()
        story.publisher.publish("a")
        story.publisher.destroy()
        gid = story.gid
        assert missed(other.node("n").subscription("/topic", gid=gid)) == []
        assert len(missed(story.come_back({}, uid=UID + 1))) == 1

    def test_another_topic(self) -> None:
        story = Story()
        story.lose()
        story.publisher.publish("a")
        story.publisher.destroy()
        assert missed(story.come_back({}, topic="/other")) == []
        assert len(missed(story.come_back({}))) == 1

    def test_one_that_says_it_is_the_same_while_that_lives(self) -> None:
        story = Story()
        story.listener.node("twin").subscription("/topic", gid=story.gid)
        story.lose()
        assert kept(story.world).subscriptions == 1
        story.publisher.publish("a")
        story.publisher.destroy()
        assert len(missed(story.come_back({}))) == 1

    def test_one_that_is_back_before_busd_hears_that_it_was_lost(self) -> None:
        story = Story()
        lost, other = story.listener, story.talker.publisher("/topic")
        lost.is_blocked = True
        story.publisher.publish("a")
        other.publish("b")
        story.publisher.destroy()
        back = story.come_back({other.gid: 0})
        assert missed(back) == [{story.publisher.gid: (1, 1)}]
        lost.die()
        assert len(missed(back)) == 1
        assert kept(story.world) == m.AbsentRecord()
        story.lose()
        assert len(missed(story.come_back({}))) == 1, "what it may not have read"


class TestBounds:
    def test_what_was_closed_in_order_is_not_kept(self) -> None:
        story = Story()
        story.publisher.publish("a")
        story.subscription.destroy()
        story.lose()
        assert kept(story.world) == m.AbsentRecord()

    def test_what_does_not_come_back_in_time(self) -> None:
        story = Story()
        story.listener.is_blocked = True
        story.publisher.publish_many("abc")
        story.lose()
        story.world.advance(KEEP_NS / SECOND - 1)
        assert kept(story.world) == m.AbsentRecord(subscriptions=1)
        story.world.advance(1)
        assert kept(story.world) == m.AbsentRecord(unclaimed=3)
        (line,) = (note for note in story.world.notes if "did not come back" in note)
        assert line == (
            "lost subscriptions that did not come back: 1 (the last: /node_2 of listener (pid 101) on "
            "'/topic'); messages kept for them: 3"
        )
        story.publisher.publish("d")
        story.publisher.destroy()
        assert missed(story.come_back({})) == []

    def test_nothing_is_said_where_nothing_waited(self) -> None:
        story = Story()
        story.publisher.publish("a")
        story.lose()
        story.world.advance((KEEP_NS + LOG_AGAIN_NS) / SECOND)
        assert not [note for note in story.world.notes if "did not come back" in note]

    def test_the_log_hears_of_many_at_once(self) -> None:
        story = Story()
        for _ in range(30):
            story.come_back({}, is_blocked=True)
            story.gid = next(story.world.gids).to_bytes(16, "big")
            story.publisher.publish("a")
            story.lose()
            story.world.advance(1)
        story.world.advance((KEEP_NS + LOG_AGAIN_NS) / SECOND)
        lines = [note for note in story.world.notes if "did not come back" in note]
        assert 2 < len(lines) <= 30 / (LOG_AGAIN_NS / SECOND) + 2
        assert sum(int(line.rsplit(maxsplit=1)[1]) for line in lines) == 30
        assert kept(story.world).unclaimed == 30

    def test_many_are_given_up_some_at_a_time(self) -> None:
        story = Story()
        node = story.listener.node("many")
        for _ in range(600):
            node.subscription("/topic")
        story.listener.is_blocked = True
        story.publisher.publish("a")
        story.lose()
        broker = story.world.broker
        broker.tick(story.world.now_ns + KEEP_NS)
        assert 0 < kept(story.world).subscriptions < 601
        story.world.advance((KEEP_NS + LOG_AGAIN_NS) / SECOND)
        assert kept(story.world) == m.AbsentRecord(unclaimed=601)

    def test_the_longest_absent_of_a_user_goes_first(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(absent, "MOST_PER_USER", 3)
        story = Story()
        gids = []
        for number in range(5):
            story.gid = (1000 + number).to_bytes(16, "big")
            gids.append(story.gid)
            story.come_back({})
            story.lose()
        assert kept(story.world) == m.AbsentRecord(subscriptions=3, given_up=2)
        (line,) = (note for note in story.world.notes if "no room" in note)
        assert line.endswith("dropped, the longest absent first: 1")
        story.publisher.publish("a")
        story.publisher.destroy()
        found = []
        for gid in gids:
            story.gid = gid
            found.append(len(missed(story.come_back({}))))
        assert found == [0, 0, 1, 1, 1]

    def test_of_all_the_user_with_most_loses(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(absent, "MOST", 4)
        story = Story()
        guest = story.world.process(uid=UID + 1)
        guest.subscription("/topic")
        guest.die()
        for number in range(6):
            story.gid = (1000 + number).to_bytes(16, "big")
            story.come_back({})
            story.lose()
        asked = story.world.process("tool").request(m.GetPeers(request=0), m.Peers)
        assert {user.uid: user.absent for user in asked.users} == {UID: 3, UID + 1: 1}
        assert asked.absent == m.AbsentRecord(subscriptions=4, given_up=3)
        own = story.world.process("tool", uid=UID + 1).request(m.GetPeers(request=0), m.Peers)
        assert [user.absent for user in own.users] == [1]
        assert own.absent == m.AbsentRecord()

    def test_one_subscription_has_a_bound(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(absent, "MOST_REMEMBERED", 4)
        story = Story()
        for _ in range(6):
            story.talker.publisher("/topic").destroy()
        story.talker.publisher("/topic")
        story.lose()
        assert story.world.broker._absentees._held == {UID: 4}

    def test_publishers_that_nobody_waits_for_are_forgotten(self) -> None:
        story = Story()
        story.lose()
        story.publisher.destroy()
        assert len(story.world.broker._absentees._sources) == 1
        story.come_back()
        assert not story.world.broker._absentees._sources

    def test_the_end_of_busd(self) -> None:
        story = Story()
        story.listener.is_blocked = True
        story.publisher.publish_many("abc")
        story.lose()
        story.world.carry_out(story.world.broker.farewell(story.world.now_ns))
        assert kept(story.world) == m.AbsentRecord(unclaimed=3)
        assert len([note for note in story.world.notes if "did not come back" in note]) == 1


class TestNumbersThatLie:
    """A publisher may report any number. A subscription that receives it must be able to read it."""

    def test_the_last_number_there_is(self) -> None:
        story = Story()
        story.publisher.resume(MAX_COUNT)
        story.publisher.publish("a")
        story.gid = next(story.world.gids).to_bytes(16, "big")
        story.come_back({})  # a subscription that is matched only now
        story.lose()
        back = story.come_back({})
        assert begun(back) == {story.publisher.gid: MAX_COUNT + 1}
        for told in back.got(m.Dropped):
            assert m.from_broker.decode(encode_frame(told)[FRAME_HEAD_BYTES:]) == told

    def test_drops_without_end(self) -> None:
        story = Story()
        kept = story.world.broker.graph.subscriptions[EndpointId(story.subscription.id)]
        kept.dropped["replaced"] = kept.dropped_before["replaced"] = MAX_COUNT
        assert kept.dropped_in_all() == {"replaced": MAX_COUNT}
