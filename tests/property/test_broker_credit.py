"""Credit of a keep-all publisher, compared with the lowest position of its subscriptions."""

from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from broker_endpoints import Subscription
from broker_world import World
from bus.qos import QoSProfile
from bus.wire import messages as m
from effort import examples

indices = st.integers(0, 99)
credit_steps = st.one_of(
    st.tuples(st.just("publish"), st.integers(1, 5)),
    st.tuples(st.just("publish"), st.integers(1, 5)),
    st.tuples(st.just("ack"), indices, st.integers(0, 8)),
    st.tuples(st.just("ack"), indices, st.integers(0, 8)),
    st.tuples(st.just("join")),
    st.tuples(st.just("leave"), indices),
)


@settings(max_examples=examples(60), deadline=None)
@given(st.lists(credit_steps, min_size=10, max_size=40))
def test_credit_is_what_the_slowest_has_taken(story: list[tuple[Any, ...]]) -> None:
    """For a keep-all publisher; a subscription that keeps only the last samples does not limit it."""
    everything = QoSProfile(history="keep_all")
    world = World()
    publisher = world.process().publisher("/a", everything)
    world.process().subscription("/a", QoSProfile(depth=1))
    taken: dict[Subscription, int] = {}
    published = credited = 0
    for name, *arguments in story:
        match name:
            case "publish":
                publisher.publish(*["x"] * arguments[0])
                published += arguments[0]
            case "join":
                taken[world.process().subscription("/a", everything)] = published
            case "ack" if taken:
                subscription = list(taken)[arguments[0] % len(taken)]
                before = taken[subscription]
                taken[subscription] = min(published, before + arguments[1])
                subscription.ack(publisher, taken[subscription])
                if taken[subscription] > before:
                    credited = max(credited, min(taken.values()))
            case "leave" if taken:
                subscription = list(taken)[arguments[0] % len(taken)]
                del taken[subscription]
                subscription.process.die()
                credited = max(credited, min(taken.values(), default=published))
        numbers = [message.seq for message in publisher.got(m.Credit)]
        assert numbers == sorted(set(numbers))
        assert (numbers or [0])[-1] == credited
