"""busd.core.match: every cell of the table, the events that lead from state to state, and the effect of a
state.
"""

from collections.abc import Container
from itertools import product
from typing import NamedTuple

import pytest

from broker_endpoints import Publisher, Subscription
from broker_world import World
from bus.base.ids import EndpointId
from bus.qos import QoSProfile
from bus.vocabulary import Route
from bus.wire import messages as m
from busd.core import entities
from busd.core.entities import Match, Owed
from busd.core.match import TRANSITIONS, MatchError, MatchEvent, MatchState
from match_tables import check_matches
from rows import for_each

ALL = QoSProfile(history="keep_all")
GID = bytes(15) + b"g"
LIVE = [state for state in MatchState if state not in (MatchState.NEW, MatchState.ENDED)]


class Scene(NamedTuple):
    """A match of lossless ends, and both ends as their processes see them."""

    world: World
    publisher: Publisher
    subscription: Subscription
    match: Match


def scene(state: MatchState) -> Scene:
    """A match brought to `state` by messages of processes. NEW stands for two endpoints that don't match."""
    world = World()
    shares = state not in (MatchState.NEW, MatchState.AHEAD, MatchState.ROUTED, MatchState.ENDED)
    role = "mirror" if state is MatchState.BRIDGED else ""
    talker, listener = world.process("talker", shares=shares), world.process("listener", shares=shares)
    known = {GID: 3} if state is MatchState.AHEAD else {}
    topic = "/other" if state is MatchState.NEW else "/topic"
    subscription = listener.node("ear").subscription(topic, ALL, last_seqs=known, role=role)
    publisher = talker.node("mouth").publisher("/topic", ALL, gid=GID)
    graph = world.broker.graph
    one, other = graph.publishers[EndpointId(publisher.id)], graph.subscriptions[EndpointId(subscription.id)]
    match = Match(one, other, 0) if state is MatchState.NEW else one.matches[other.id]
    match state:
        case MatchState.ATTACHED:
            subscription.attach(publisher)
        case MatchState.LEAVING:
            listener.is_blocked = True
            publisher.refuse(subscription)
        case MatchState.CATCHING_UP:
            publisher.refuse(subscription)
        case MatchState.ENDED:
            subscription.destroy()
    assert match.state is state
    check_matches(graph)
    return Scene(world, publisher, subscription, match)


def tables(publisher: entities.Publisher, number: EndpointId) -> set[str]:
    """The publisher's tables that contain the match with that subscription."""
    found: dict[str, Container[EndpointId]] = {
        "routed": publisher.routed,
        "ahead": publisher.ahead,
        "awaited": publisher.awaited,
    }
    return {name for name, table in found.items() if number in table}


@for_each(("state", "event"), list(product(MatchState, MatchEvent)))
def test_every_cell(state: MatchState, event: MatchEvent) -> None:
    _, publisher, subscription, match = scene(state)
    before = tables(match.publisher, match.subscription.id)
    following = TRANSITIONS[state].get(event)
    if following is None:
        with pytest.raises(MatchError) as caught:
            match.on(event)
        ends = f"publisher {publisher.id} (/mouth) and subscription {subscription.id} (/ear)"
        assert str(caught.value) == (
            f"the match on '/topic' of {ends} is {state.value!r}: {event.value!r} can't happen to it"
        )
        assert match.state is state
        assert tables(match.publisher, match.subscription.id) == before
        return
    match.on(event)
    assert match.state is following
    routes = {MatchState.OFFERED: Route.SHM, MatchState.ATTACHED: Route.SHM, MatchState.BRIDGED: Route.BRIDGE}
    assert match.route == routes.get(following, Route.SOCKET)
    assert match.has_ended == (following is MatchState.ENDED)
    of_states = {MatchState.ROUTED: {"routed"}, MatchState.AHEAD: {"ahead"}}
    awaited = before & {"awaited"} if following is not MatchState.ENDED else set()
    assert tables(match.publisher, match.subscription.id) == of_states.get(following, set()) | awaited


def test_every_state_has_a_row_and_can_be_reached() -> None:
    reached, waiting = set[MatchState](), [MatchState.NEW]
    while waiting:
        state = waiting.pop()
        if state not in reached:
            reached.add(state)
            waiting += TRANSITIONS[state].values()
    assert reached == {*MatchState} == {*TRANSITIONS}


def test_every_match_that_is_there_can_end() -> None:
    assert [state for state in MatchState if MatchEvent.END in TRANSITIONS[state]] == LIVE


@for_each(
    ("state", "word", "following"),
    [
        (MatchState.OFFERED, "attach", MatchState.ATTACHED),
        (MatchState.ATTACHED, "attach", MatchState.ENDED),  # busd cuts it off
        (MatchState.OFFERED, "refuse", MatchState.CATCHING_UP),  # its process leaves the ring at once
        (MatchState.ATTACHED, "refuse", MatchState.CATCHING_UP),
        (MatchState.LEAVING, "leave", MatchState.CATCHING_UP),
        (MatchState.CATCHING_UP, "caught up", MatchState.ROUTED),
        (MatchState.CATCHING_UP, "publish", MatchState.CATCHING_UP),
        (MatchState.AHEAD, "publish", MatchState.AHEAD),
        (MatchState.AHEAD, "publish it all", MatchState.ROUTED),
    ],
)
def test_what_processes_say(state: MatchState, word: str, following: MatchState) -> None:
    one = scene(state)
    say(one, word)
    assert one.match.state is following
    check_matches(one.world.broker.graph)


def say(one: Scene, word: str) -> None:
    publisher, subscription = one.publisher, one.subscription
    match word:
        case "attach":
            subscription.attach(publisher)
        case "refuse":
            subscription.refuse(publisher)
        case "leave":
            leave = m.LeaveRing(subscription=subscription.id, source=publisher.id, seq=0)
            subscription.process.tell(leave)
        case "caught up":
            publisher.catch_up(subscription)
        case "acknowledge":
            subscription.ack(publisher, 0)
        case "publish":
            publisher.publish("1")
        case "publish it all":
            publisher.publish(*"1234")


MOVES = {
    (MatchState.OFFERED, "attach"),
    (MatchState.ATTACHED, "attach"),
    (MatchState.OFFERED, "refuse"),
    (MatchState.ATTACHED, "refuse"),
    (MatchState.LEAVING, "leave"),
    (MatchState.CATCHING_UP, "caught up"),
}


@for_each(
    ("state", "word"),
    sorted({*product(LIVE, ["attach", "refuse", "leave", "caught up", "acknowledge"])} - MOVES, key=str),
)
def test_what_comes_too_late_is_no_mistake(state: MatchState, word: str) -> None:
    one = scene(state)
    say(one, word)
    assert one.match.state is state
    assert one.publisher.process.cut_reason is one.subscription.process.cut_reason is None


@for_each("end", ["subscription", "listener", "publisher", "talker"])
@for_each("state", LIVE)
def test_whoever_goes_in_whatever_state_leaves_nothing(state: MatchState, end: str) -> None:
    """The remaining end continues."""
    world, publisher, subscription, match = scene(state)
    match end:
        case "subscription":
            subscription.destroy()
        case "listener":
            subscription.process.die()
        case "publisher":
            publisher.destroy()
        case "talker":
            publisher.process.die()
    assert match.has_ended
    assert tables(match.publisher, match.subscription.id) == set()
    assert not match.publisher.matches and not match.subscription.matches
    check_matches(world.broker.graph)
    if end in ("subscription", "listener"):
        publisher.publish_many("12345")
        assert publisher.statistics().samples == 5
        heard = world.process().subscription("/topic", ALL)
    else:
        heard = (
            subscription
            if state is not MatchState.BRIDGED
            else subscription.process.subscription("/topic", ALL)
        )
        publisher = world.process().publisher("/topic", ALL)
        subscription.process.unblock()
    publisher.publish("6")
    assert heard.payloads[-1:] == ["6"]


class TestExpected:
    """The samples that count as routed for the subscription, by the state of the match."""

    @for_each("state", LIVE)
    def test_by_state(self, state: MatchState) -> None:
        one = scene(state)
        one.publisher.publish(*"12345")
        expected = {MatchState.ROUTED: 5, MatchState.AHEAD: 2}.get(state, 0)
        assert one.match.subscription.expected == expected
        if expected:
            assert one.match.routed_count == expected

    def test_what_was_routed_stays_expected_when_the_match_has_ended(self) -> None:
        one = scene(MatchState.ROUTED)
        one.publisher.publish(*"123")
        one.publisher.destroy()
        assert one.match.subscription.expected == 3

    def test_one_that_comes_back_is_a_return_where_it_gets_all_at_once(self) -> None:
        world = World()
        publisher = world.process().publisher("/topic")
        publisher.publish(*"12")
        entity = world.broker.graph.publishers[EndpointId(publisher.id)]
        for known, is_return in (({}, False), ({publisher.gid: 1}, True), ({publisher.gid: 2}, True)):
            made = world.process().subscription("/topic", last_seqs=known)
            assert entity.matches[EndpointId(made.id)].is_return is is_return

    def test_one_that_was_rerouted_is_no_return(self) -> None:
        """Samples that went to others by the ring meanwhile are no loss for it."""
        one = scene(MatchState.CATCHING_UP)
        one.publisher.publish("1")
        one.publisher.catch_up(one.subscription, "1")
        one.publisher.publish("2")
        one.publisher.resume(8)
        one.publisher.publish("8")
        totals = one.subscription.statistics()
        assert not one.match.is_return
        assert (one.subscription.payloads, totals.expected, totals.dropped) == ([*"128"], 3, {})


class TestOwed:
    """Records of a publisher for a subscription that may get lost or come back."""

    @for_each("state", LIVE)
    def test_by_state(self, state: MatchState) -> None:
        owed = scene(state).match.owed
        from_where = {
            MatchState.OFFERED: 0,
            MatchState.ATTACHED: 0,
            MatchState.AHEAD: 4,
            MatchState.ROUTED: 1,
        }
        assert (owed.first_seq if owed is not None else None) == from_where.get(state)

    def test_what_is_found_in_the_ring_is_not_owed(self) -> None:
        match = scene(MatchState.NEW).match
        match.subscription.owed[GID] = Owed(5, is_kept=False)
        match.share()
        assert match.subscription.owed == {}

    @pytest.mark.parametrize("leaves", [True, False])
    def test_whether_the_publisher_took_its_leave(self, leaves: bool) -> None:
        """By shared memory, only a publisher that leaves properly has reported the number of samples in its
        ring.
        """
        for state, known in ((MatchState.ROUTED, {GID: 0}), (MatchState.OFFERED, {GID: 0} if leaves else {})):
            one = scene(state)
            if leaves:
                one.publisher.destroy()
            else:
                one.publisher.process.die()
            assert one.match.subscription.last_seqs == known
            assert [owed.has_left for owed in one.match.subscription.owed.values()] == [leaves] * len(known)

    def test_a_run_for_one_alone_tells_how_far_it_is_only_while_it_catches_up(self) -> None:
        for state, known in ((MatchState.CATCHING_UP, 2), (MatchState.ROUTED, None), (MatchState.AHEAD, 3)):
            one = scene(state)
            one.publisher.publish(*"1234")
            one.publisher.catch_up(one.subscription, *"12")
            assert one.match.subscription.last_seqs.get(GID) == known


class TestAwaited:
    """In every state, a lossless publisher waits for lossless subscriptions by socket."""

    @for_each("state", LIVE)
    def test_by_state(self, state: MatchState) -> None:
        match = scene(state).match
        is_awaited = state not in (MatchState.OFFERED, MatchState.ATTACHED, MatchState.BRIDGED)
        assert (match.acked_seq is not None) is is_awaited
        assert (match.subscription.id in match.publisher.awaited) is is_awaited

    def test_one_that_is_excused_is_waited_for_no_more(self) -> None:
        match = scene(MatchState.ROUTED).match
        assert match.excuse()
        assert match.acked_seq is None and not match.publisher.awaited
        assert not match.excuse()
        match.await_acks()
        assert match.acked_seq == 0 and [*match.publisher.awaited.values()] == [match]
        assert not match.publisher.is_credit_ahead

    def test_of_one_that_is_ahead_what_it_has_had_counts_as_acknowledged(self) -> None:
        match = scene(MatchState.AHEAD).match
        assert match.acked_seq == 3
        assert match.publisher.is_credit_ahead
