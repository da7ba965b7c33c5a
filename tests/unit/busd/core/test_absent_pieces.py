"""busd.core.absent: busd serves others between two pieces of the work for one subscription."""

from collections.abc import Callable

from absence import DEEP, Story, kept
from broker_endpoints import Publisher, Subscription
from broker_world import TEXT
from bus.base.ids import EndpointId
from bus.wire import messages as m
from rows import for_each

MANY = 150
STEP = 90
"""More than the most expensive single step."""


class Crowd(Story):
    """One subscription with many publishers that it does not know. Each publisher has published twice."""

    def __init__(self) -> None:
        super().__init__()
        self.listener.is_blocked = True
        self.many = [self.publisher, *(self.talker.publisher("/topic", DEEP) for _ in range(MANY - 1))]
        for publisher in self.many:
            publisher.publish_many("ab")

    def in_pieces(self, action: Callable[[], object], *, after: int, do: Callable[[], object]) -> None:
        """Do `action` in the smallest pieces. After `after` of them, do `do`, all at once."""
        left = after

        def between() -> None:
            nonlocal left
            left -= 1
            if not left:
                self.world.budget, self.world.between = 1 << 62, lambda: None
                self.world.refill()
                do()
                self.world.budget, self.world.between = 1, between

        self.world.budget, self.world.between, self.world.overdrawn = 1, between, 0
        action()
        self.world.budget, self.world.between = 1 << 62, lambda: None
        self.world.refill()
        assert not self.world.broker.tasks.unfinished
        assert left <= 0, f"it had {after - left} pieces"

    def come_back_knowing_nothing(self) -> Subscription:
        return self.come_back({})


def told(subscription: Subscription) -> dict[bytes, tuple[int, int]]:
    """All the losses that the subscription was told."""
    found: dict[bytes, tuple[int, int]] = {}
    for some in subscription.got(m.Dropped):
        found |= some.missed
    return found


def check(story: Crowd, left: list[Publisher]) -> None:
    """The subscription must know the first number of each publisher, and the last number of those that have
    left.
    """
    back = story.subscription
    news = told(back)
    for publisher in story.many:
        assert news[publisher.gid] == ((1, 2) if publisher in left else (1, 0))
    matched = {one.gid for one in back.got(m.Matched)} - {one.gid for one in left}
    assert matched == {one.gid for one in story.many} - {one.gid for one in left}
    assert kept(story.world) == m.AbsentRecord()
    story.world.advance(20)
    assert told(back) == news
    assert not story.world.broker._absentees._open
    assert [*story.world.broker._absentees._here.values()] == [
        story.world.broker.graph.subscriptions[EndpointId(back.id)]
    ]


@for_each("after", [1, 2, 3, 40, 100])
def test_it_is_back_while_it_still_leaves(after: int) -> None:
    story = Crowd()
    story.in_pieces(story.lose, after=after, do=story.come_back_knowing_nothing)
    check(story, [])


@for_each("after", [1, 2, 3, 40, 100])
def test_a_publisher_leaves_while_it_leaves(after: int) -> None:
    story = Crowd()
    gone = [story.many[1], story.many[-2]]
    story.in_pieces(story.lose, after=after, do=lambda: [one.destroy() for one in gone])
    story.come_back_knowing_nothing()
    check(story, gone)


@for_each("after", [1, 2, 3, 4, 40, 100])
def test_a_publisher_leaves_while_it_comes_back(after: int) -> None:
    story = Crowd()
    gone = [story.many[1], story.many[-2]]
    story.lose()
    story.in_pieces(story.come_back_knowing_nothing, after=after, do=lambda: [one.destroy() for one in gone])
    back = story.subscription
    unmatched = {one.other: one.last_seq for one in back.got(m.Unmatched)}
    for one in gone:  # one of the two messages told it
        assert told(back)[one.gid] == (1, 2) or unmatched[one.id] == 2
    assert not story.world.broker._absentees._open or after == 1


@for_each("after", [1, 2, 3, 4, 40])
def test_it_is_lost_while_it_comes_back(after: int) -> None:
    story = Crowd()
    story.lose()
    listener = story.world.process("listener")
    node = listener.node()
    listener.declare_type(TEXT)
    again = m.CreateSubscription(
        request=99,
        node=node.id,
        topic="/topic",
        type_name=TEXT[0],
        type_hash=TEXT[1],
        qos=story.requested,
        gid=story.gid,
    )
    story.in_pieces(lambda: listener.tell(again), after=after, do=listener.die)
    assert kept(story.world).subscriptions == 1
    story.come_back_knowing_nothing()
    check(story, [])


def test_no_piece_is_long() -> None:
    story = Crowd()
    story.publisher.destroy()
    story.in_pieces(story.lose, after=1, do=lambda: None)
    assert story.world.overdrawn <= STEP
    story.in_pieces(story.come_back_knowing_nothing, after=1, do=lambda: None)
    assert story.world.overdrawn <= STEP
