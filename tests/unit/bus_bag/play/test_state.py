"""The states of a replay: every cell of their table."""

import pytest

from bus_bag.life import LifeError
from bus_bag.play.state import TRANSITIONS, PlayerEvent, PlayerLife, PlayerState
from rows import for_each

PLAY, READY, JUMP, BURST, BURST_END, STOP, END = (
    PlayerEvent.PLAY,
    PlayerEvent.READY,
    PlayerEvent.JUMP,
    PlayerEvent.BURST,
    PlayerEvent.BURST_END,
    PlayerEvent.STOP,
    PlayerEvent.END,
)
WAYS = {
    PlayerState.NEW: [],
    PlayerState.CANCELED: [STOP],
    PlayerState.STARTING: [PLAY],
    PlayerState.PLAYING: [PLAY, READY],
    PlayerState.BURSTING: [PLAY, READY, BURST],
    PlayerState.AT_END: [PLAY, READY, PlayerEvent.LAST],
    PlayerState.STOPPING: [PLAY, READY, BURST, STOP],
    PlayerState.ENDED: [PLAY, READY, END],
}


def life_in(state: PlayerState) -> PlayerLife:
    life = PlayerLife()
    for event in WAYS[state]:
        life.on(event)
    assert life.state is state
    return life


@for_each(("state", "event"), [(state, event) for state in PlayerState for event in PlayerEvent])
def test_every_cell(state: PlayerState, event: PlayerEvent) -> None:
    life = life_in(state)
    following = TRANSITIONS[state].get(event)
    if following is None:
        with pytest.raises(LifeError, match=f"PlayerState: '{event.value}' .* '{state.value}'"):
            life.on(event)
        assert life.state is state
    else:
        assert life.on(event) is life.state is following


def test_what_was_stopped_publishes_nothing_whatever_happens() -> None:
    life = life_in(PlayerState.STOPPING)
    for event in (JUMP, READY, BURST, BURST_END, STOP, END, BURST, BURST_END, STOP):
        life.on(event)
        assert not life.may_publish and life.has_begun
    assert life.state is PlayerState.ENDED


def test_a_replay_that_is_stopped_before_it_begins_ends_once_it_has_begun() -> None:
    life = life_in(PlayerState.CANCELED)
    assert not life.has_begun
    assert life.on(PLAY) is PlayerState.STOPPING
