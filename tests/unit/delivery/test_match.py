"""bus.delivery.match: every cell of the table, and what leads from state to state."""

from collections import deque
from collections.abc import Callable
from itertools import product
from typing import Any

import pytest

from bus import shm
from bus.delivery.match import GATES, Gate, GateEvent, GateState, MatchError
from bus.delivery.port import RETURN_S
from bus.qos import QoSProfile
from bus.types.support import type_support
from bus.wire import messages as m
from client_world import ClientWorld, Numbered
from list_port import Owner

shared = pytest.mark.skipif(not shm.is_available(), reason=shm.why_not())
KEEP_ALL = QoSProfile(history="keep_all")


def paths(transitions: Any, first: Any) -> dict[Any, list[Any]]:
    """To each state that can be reached, the events of a shortest way."""
    found: dict[Any, list[Any]] = {first: []}
    waiting = deque([first])
    while waiting:
        state = waiting.popleft()
        for event, following in transitions[state].items():
            if following not in found:
                found[following] = [*found[state], event]
                waiting.append(following)
    return found


WAYS = paths(GATES, GateState.NEW)


def matched(qos: QoSProfile = KEEP_ALL) -> m.Matched:
    return m.Matched(
        endpoint=4, other=7, node="/ear", gid=bytes(16), qos=qos, route="shm", next_seq=1, at_ns=0
    )


def owner() -> Any:
    return Owner(KEEP_ALL, type_support(Numbered), number=4)


def gate_in(state: GateState) -> Gate:
    gate = Gate(owner(), matched(), 1)
    for event in WAYS[state]:
        gate.on(event)
    assert gate.state is state
    return gate


@pytest.mark.parametrize(("state", "event"), list(product(GateState, GateEvent)))
def test_every_cell(state: GateState, event: GateEvent) -> None:
    gate = gate_in(state)
    following = GATES[state].get(event)
    if following is not None:
        gate.on(event)
        assert gate.state is following
        return
    with pytest.raises(MatchError) as caught:
        gate.on(event)
    ends = "publisher 4 (here) and subscription 7 (/ear)"
    assert str(caught.value) == (
        f"the match on '/topic' of {ends} is {state.value!r}: {event.value!r} can't happen to it"
    )
    assert gate.state is state


def test_every_state_has_a_row_and_can_be_reached() -> None:
    assert {*WAYS} == {*GateState} == {*GATES}


def test_from_every_state_it_comes_to_its_end() -> None:
    for state in set(GateState) - {GateState.NEW}:
        assert GateState.ENDED in paths(GATES, state)


def test_how_many_records_must_stay() -> None:
    assert Gate(owner(), matched(QoSProfile(7)), 1).depth == 7
    assert Gate(owner(), matched(), 1).depth == 1


class Scene:
    """A lossless publisher and one that reads its ring, whose match has come to a state."""

    def __init__(self, state: GateState) -> None:
        self.world = ClientWorld()
        self.talker, self.listener = self.world.client(shares=True), self.world.client(shares=True)
        publisher = self.talker.publisher(KEEP_ALL)
        self.world.settle()
        self.listener.is_held = state in (GateState.EXPECTED, GateState.UNSURE)
        self.subscription = self.listener.subscription(KEEP_ALL)
        self.world.settle()
        ring = publisher._sender._ring
        assert ring is not None
        self.ring = ring
        self.gate = ring._gates[self.subscription.gid]
        if state in (GateState.UNSURE, GateState.READING_ON):
            self.lose_busd()
        assert self.gate.state is state
        self.check()

    def check(self) -> None:
        """The tables that go with the state."""
        gate, ring = self.gate, self.ring
        is_gone = gate.state in (GateState.LEFT, GateState.LOST, GateState.ENDED)
        assert (ring._gates.get(self.subscription.gid) is not gate) is is_gone
        assert (gate in ring._unattached.values()) is (gate.state in (GateState.EXPECTED, GateState.UNSURE))
        assert (gate in ring._left.values()) is (gate.state in (GateState.LEFT, GateState.LOST))

    # --- what happens

    def lose_busd(self) -> None:
        self.world.restart_broker()
        self.world.settle()

    def answer(self) -> None:
        self.listener.is_held = False
        self.world.settle()

    def close(self) -> None:
        self.listener.close(self.subscription)
        self.listener.serve()
        self.talker.step()

    def close_and_rest(self) -> None:
        self.close()
        self.world.advance(0)

    def refuse(self) -> None:
        refusal = m.RefuseRoute(
            endpoint=self.subscription._id, other=next(iter(self.subscription._matches)), text="a test"
        )
        self.listener.send_about(self.subscription, refusal)
        self.world.advance(1)

    def vanish(self) -> None:
        """It hangs up, and its process lives."""
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
        self.ring.let_the_dead_go()
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
