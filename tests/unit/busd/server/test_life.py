"""busd.server.life: every cell of the table, and the effect of each state."""

from itertools import product

import pytest

from busd.server.life import TRANSITIONS, Life, LifeError, LifeEvent, LifeState
from rows import for_each

EVENTS_TO: dict[LifeState, list[LifeEvent]] = {
    LifeState.SERVING: [],
    LifeState.STOPPING: [LifeEvent.STOP],
    LifeState.HURRIED: [LifeEvent.INTERRUPT, LifeEvent.INTERRUPT],
    LifeState.RESTARTING: [LifeEvent.RESTART],
    LifeState.STOPPED: [LifeEvent.STOP, LifeEvent.DRAIN],
    LifeState.HANDING_OVER: [LifeEvent.RESTART, LifeEvent.DRAIN],
}
"""The events that lead to each state."""

FOLLOWING: dict[LifeState, tuple[LifeState | None, ...]] = {
    # after a stop, a restart, an interrupt, the last connection
    LifeState.SERVING: (LifeState.STOPPING, LifeState.RESTARTING, LifeState.STOPPING, None),
    LifeState.STOPPING: (LifeState.STOPPING, LifeState.STOPPING, LifeState.HURRIED, LifeState.STOPPED),
    LifeState.HURRIED: (LifeState.HURRIED, LifeState.HURRIED, LifeState.HURRIED, LifeState.STOPPED),
    LifeState.RESTARTING: (
        LifeState.STOPPING,
        LifeState.RESTARTING,
        LifeState.STOPPING,
        LifeState.HANDING_OVER,
    ),
    LifeState.STOPPED: (LifeState.STOPPED, LifeState.STOPPED, LifeState.STOPPED, None),
    LifeState.HANDING_OVER: (LifeState.STOPPED, LifeState.HANDING_OVER, LifeState.STOPPED, None),
}


def life_in(state: LifeState) -> Life:
    life = Life()
    for event in EVENTS_TO[state]:
        life.on(event)
    assert life.state is state
    return life


@for_each(("state", "event"), list(product(LifeState, LifeEvent)))
def test_every_cell(state: LifeState, event: LifeEvent) -> None:
    life = life_in(state)
    following = FOLLOWING[state][[*LifeEvent].index(event)]
    if following is None:
        with pytest.raises(LifeError) as caught:
            life.on(event)
        assert str(caught.value) == f"busd is {state.value!r}: {event.value!r} can't happen to it"
        assert life.state is state
    else:
        assert life.on(event) is following
        assert life.state is following


def test_every_state_has_a_row() -> None:
    assert {*TRANSITIONS} == {*LifeState}


@for_each("state", [*LifeState])
def test_only_a_busd_that_serves_is_not_ending(state: LifeState) -> None:
    assert life_in(state).is_ending is (state is not LifeState.SERVING)


@for_each("state", [*LifeState])
def test_a_restart_begins_before_the_last_connection_is_closed_and_lasts(state: LifeState) -> None:
    is_restarting = state in (LifeState.RESTARTING, LifeState.HANDING_OVER)
    assert life_in(state).is_restarting is is_restarting


@for_each("event", [LifeEvent.STOP, LifeEvent.INTERRUPT])
def test_an_end_is_never_taken_back(event: LifeEvent) -> None:
    life = life_in(LifeState.SERVING)
    life.on(event)
    life.on(LifeEvent.RESTART)
    assert not life.is_restarting
    assert life.on(LifeEvent.DRAIN) is LifeState.STOPPED
