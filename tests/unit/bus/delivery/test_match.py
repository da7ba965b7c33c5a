"""bus.delivery.match: every cell of the table, and the events that lead from state to state."""

from collections.abc import Callable
from itertools import product
from typing import Any, cast

import pytest

from bus import shm
from bus.delivery.match import (
    FEEDS,
    GATES,
    Feed,
    FeedEvent,
    FeedState,
    Gate,
    GateEvent,
    GateState,
    MatchError,
)
from bus.delivery.port import RETURN_S
from bus.delivery.sequence import PublisherProxy
from bus.errors import ConnectionClosed
from bus.qos import QoSProfile
from bus.types.support import type_support
from bus.wire import messages as m
from client_world import ClientWorld, Numbered
from list_port import Owner
from rows import for_each
from transitions import paths

shared = pytest.mark.skipif(not shm.is_available(), reason=shm.why_not())
KEEP_ALL = QoSProfile(history="keep_all")


def matched(qos: QoSProfile = KEEP_ALL) -> m.Matched:
    return m.Matched(
        endpoint=4, other=7, node="/far", gid=bytes(16), qos=qos, route="shm", next_seq=1, at_ns=0
    )


def owner() -> Any:
    return Owner(KEEP_ALL, type_support(Numbered), number=4)


def new_gate() -> Any:
    return Gate(owner(), matched(), 1)


def new_feed() -> Any:
    return Feed(owner(), matched(), PublisherProxy(7, bytes(16), 0, 0, needs_ack=True), 0)


ENDS = {
    GateState: (GATES, GateEvent, new_gate, "publisher 4 (here) and subscription 7 (/far)"),
    FeedState: (FEEDS, FeedEvent, new_feed, "subscription 4 (here) and publisher 7 (/far)"),
}
CELLS = [*product(GateState, GateEvent), *product(FeedState, FeedEvent)]


@for_each(("state", "event"), CELLS)
def test_every_cell(state: GateState | FeedState, event: GateEvent | FeedEvent) -> None:
    transitions, _, make, ends = ENDS[type(state)]
    match, rows = make(), cast("Any", transitions)
    for one in paths(rows, match.state)[state]:
        match.on(one)
    assert match.state is state
    following = rows[state].get(event)
    if following is not None:
        match.on(event)
        assert match.state is following
        return
    with pytest.raises(MatchError) as caught:
        match.on(event)
    assert str(caught.value) == (
        f"the match on '/topic' of {ends} is {state.value!r}: {event.value!r} can't happen to it"
    )
    assert match.state is state


@pytest.mark.parametrize("states", ENDS)
def test_every_state_has_a_row_and_can_be_reached_and_left(states: Any) -> None:
    transitions: Any = ENDS[states][0]
    assert {*paths(transitions, states.NEW)} == {*states} == {*transitions}
    for state in states:
        assert states.ENDED in paths(transitions, state)


def test_how_many_records_must_stay() -> None:
    assert Gate(owner(), matched(QoSProfile(7)), 1).depth == 7
    assert Gate(owner(), matched(), 1).depth == 1


class Scene:
    """A lossless publisher and a subscription that reads its ring. Their match is in `state`."""

    def __init__(self, state: GateState) -> None:
        self.world = ClientWorld()
        self.talker, self.listener = self.world.client(shares=True), self.world.client(shares=True)
        self.publisher = publisher = self.talker.publisher(KEEP_ALL)
        self.world.settle()
        self.listener.is_held = state in (GateState.EXPECTED, GateState.UNSURE)
        self.subscription = self.listener.subscription(KEEP_ALL)
        self.world.settle()
        ring = publisher._sender.ring
        assert ring is not None
        self.ring = ring
        self.gate = ring.gates.by_gid[self.subscription.gid]
        if state in (GateState.UNSURE, GateState.READING_ON):
            self.lose_busd()
        assert self.gate.state is state
        self.check()

    def check(self) -> None:
        """Check the tables against the state."""
        gate, gates = self.gate, self.ring.gates
        is_gone = gate.state in (GateState.LEFT, GateState.LOST, GateState.ENDED)
        assert (gates.by_gid.get(self.subscription.gid) is not gate) is is_gone
        assert (gate in gates._unattached.values()) is (gate.state in (GateState.EXPECTED, GateState.UNSURE))
        assert (gate in gates._left.values()) is (gate.state in (GateState.LEFT, GateState.LOST))

    # --- events

    def lose_busd(self) -> None:
        self.world.restart_broker()
        self.world.settle()

    def answer(self) -> None:
        self.listener.is_held = False
        self.world.settle()

    def close(self) -> None:
        """The subscription closes."""
        self.listener.close(self.subscription)
        self.listener.serve()
        self.talker.step()

    def close_and_rest(self) -> None:
        self.close()
        self.world.advance(0)

    def refuse(self) -> None:
        core = self.subscription._core
        refusal = m.RefuseRoute(endpoint=core.id, other=next(iter(core.matches)), text="a test")
        self.listener.send_about(core, refusal)
        self.world.advance(1)

    def vanish(self) -> None:
        """The subscription hangs up; its process lives on."""
        self.listener.hang_up()
        self.world.advance(1)

    def die(self) -> None:
        self.listener.die()
        self.world.advance(1)

    def all_come_back(self) -> None:
        self.listener.is_held = False
        self.world.connect_all()

    def the_other_does_not_come_back(self) -> None:
        self.talker.connect()
        self.world.advance(RETURN_S + 1)

    def the_other_dies(self) -> None:
        self.listener.die()
        self.ring.drop_dead_readers()
        self.world.advance(0)


@shared
@pytest.mark.parametrize(
    ("state", "happens", "following"),
    [
        (GateState.EXPECTED, Scene.answer, GateState.ATTACHED),
        (GateState.EXPECTED, Scene.lose_busd, GateState.UNSURE),
        (GateState.EXPECTED, Scene.vanish, GateState.ENDED),
        (GateState.ATTACHED, Scene.lose_busd, GateState.READING_ON),
        (GateState.ATTACHED, Scene.close, GateState.LEFT),
        (GateState.ATTACHED, Scene.close_and_rest, GateState.ENDED),
        (GateState.ATTACHED, Scene.refuse, GateState.ENDED),
        (GateState.ATTACHED, Scene.vanish, GateState.LOST),
        (GateState.ATTACHED, Scene.die, GateState.ENDED),
        (GateState.UNSURE, Scene.all_come_back, GateState.ATTACHED),
        (GateState.UNSURE, Scene.the_other_does_not_come_back, GateState.ENDED),
        (GateState.READING_ON, Scene.all_come_back, GateState.ATTACHED),
        (GateState.READING_ON, Scene.the_other_does_not_come_back, GateState.LOST),
        (GateState.READING_ON, Scene.the_other_dies, GateState.ENDED),
    ],
)
def test_what_processes_do(state: GateState, happens: Callable[[Scene], None], following: GateState) -> None:
    scene = Scene(state)
    happens(scene)
    assert scene.gate.state is following
    scene.check()


@shared
def test_what_is_lost_and_comes_back_goes_on_with_the_same_gate() -> None:
    scene = Scene(GateState.READING_ON)
    scene.the_other_does_not_come_back()
    scene.listener.connect()
    scene.world.settle()
    assert scene.gate.state is GateState.ENDED
    scene.check()
    after = scene.ring.gates.by_gid[scene.subscription.gid]
    assert (after.state, after.key, after.place) == (GateState.ATTACHED, scene.gate.key, scene.gate.place)


@shared
def test_while_busd_is_there_it_says_who_has_died() -> None:
    scene = Scene(GateState.ATTACHED)
    scene.listener.die()
    assert not scene.ring.drop_dead_readers()
    assert scene.gate.state is GateState.ATTACHED


@shared
@pytest.mark.parametrize("state", [GateState.EXPECTED, GateState.ATTACHED])
def test_one_that_was_silent_and_is_matched_by_another_busd_is_waited_for_again(state: GateState) -> None:
    scene = Scene(state)
    scene.ring.set_waiting(scene.subscription.gid, is_on=False)
    assert not scene.gate.is_lossless
    scene.lose_busd()
    assert not scene.gate.is_lossless
    scene.all_come_back()
    assert scene.gate.is_lossless


class ReadScene(Scene):
    """The same, seen from the subscription, with a message that waits in the ring."""

    def __init__(self, state: FeedState) -> None:
        super().__init__(GateState.ATTACHED)
        rings = self.subscription._core.rings
        assert rings is not None
        self.rings = rings
        self.read = rings._feeds[self.publisher.gid]
        self.talker.publish(self.publisher)
        self.world.settle()
        if state is FeedState.READING_ON:
            self.lose_busd()
        elif state is FeedState.FINISHING:
            self.talker.hang_up()
            self.world.settle()
        self.check_feed(state)

    def check_feed(self, state: FeedState) -> None:
        assert self.read.state is state
        assert (self.rings._feeds.get(self.publisher.gid) is self.read) is (state is not FeedState.ENDED)

    # --- events

    def publisher_closes(self) -> None:
        self.talker.close(self.publisher)
        self.world.settle()

    def take(self) -> None:
        assert self.listener.take(self.subscription) == [(1, 1)]
        self.rings.sweep()

    def the_publisher_does_not_come_back(self) -> None:
        self.listener.connect()
        self.world.advance(RETURN_S + 1)

    def end(self) -> None:
        self.subscription._core.end(ConnectionClosed("a test"))

    def connection_is_lost(self) -> None:
        self.listener.hang_up()


@shared
@pytest.mark.parametrize(
    ("state", "happens", "following"),
    [
        (FeedState.ATTACHED, ReadScene.take, FeedState.ATTACHED),
        (FeedState.ATTACHED, ReadScene.lose_busd, FeedState.READING_ON),
        (FeedState.ATTACHED, ReadScene.publisher_closes, FeedState.FINISHING),
        (FeedState.ATTACHED, ReadScene.refuse, FeedState.ENDED),
        (FeedState.ATTACHED, ReadScene.end, FeedState.ENDED),
        (FeedState.READING_ON, ReadScene.all_come_back, FeedState.ATTACHED),
        (FeedState.READING_ON, ReadScene.the_publisher_does_not_come_back, FeedState.FINISHING),
        (FeedState.READING_ON, ReadScene.end, FeedState.ENDED),
        (FeedState.FINISHING, ReadScene.take, FeedState.ENDED),
        (FeedState.FINISHING, ReadScene.connection_is_lost, FeedState.FINISHING),
        # Another ring, or the same one from there on.
        (FeedState.FINISHING, ReadScene.all_come_back, FeedState.ENDED),
        (FeedState.FINISHING, ReadScene.end, FeedState.ENDED),
    ],
)
def test_what_becomes_of_a_feed(
    state: FeedState, happens: Callable[[ReadScene], None], following: FeedState
) -> None:
    scene = ReadScene(state)
    happens(scene)
    scene.check_feed(following)


@shared
def test_one_that_comes_back_reads_on() -> None:
    """In another ring of the publisher, the subscription continues at the position that it reached in the
    finishing one.
    """
    scene = ReadScene(FeedState.FINISHING)
    scene.all_come_back()
    assert scene.rings._feeds[scene.publisher.gid].state is FeedState.ATTACHED
    scene.talker.publish(scene.publisher)
    scene.world.settle()
    assert scene.listener.take(scene.subscription) == [(1, 1), (1, 2)]
    assert scene.subscription.statistics().dropped == {}
