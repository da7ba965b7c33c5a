"""Every cell of the table of continuity, and the meaning of a batch in each state."""

from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus_bridge.batch import Batch, Loose, Sample
from bus_bridge.core.continuity import (
    TRANSITIONS,
    Classified,
    Continuity,
    ContinuityError,
    Listeners,
)
from bus_bridge.core.continuity import (
    ContinuityEvent as Event,
)
from bus_bridge.core.continuity import (
    ContinuityState as State,
)
from rows import for_each
from transitions import paths


def batch(*numbers: int, at_ns: int = 0) -> Loose:
    return Loose([Sample(b"x", number, at_ns) for number in numbers])


def numbers(some: Batch | None) -> list[int]:
    return [sample.number for sample in some or ()]


def at(state: State, last: int = 10) -> Continuity:
    """A Continuity that reached `state` on the shortest way. Its last message has the number `last`."""
    continuity = Continuity()
    for event in paths(TRANSITIONS, State.BEGINNING)[state]:
        continuity.on(event)
    continuity.last = last
    assert continuity.state is state
    return continuity


@for_each(("state", "event"), product(State, Event))
def test_every_cell(state: State, event: Event) -> None:
    continuity, following = at(state), TRANSITIONS[state].get(event)
    if following is not None:
        continuity.on(event)
        assert continuity.state is following
        return
    with pytest.raises(ContinuityError) as caught:
        continuity.on(event)
    assert str(caught.value) == f"a way is {state.value!r}: {event.value!r} can't happen to it"
    assert continuity.state is state


def test_every_state_has_a_row_and_can_be_reached() -> None:
    assert {*paths(TRANSITIONS, State.BEGINNING)} == {*State} == {*TRANSITIONS}


@for_each("state", State)
def test_the_next_messages_follow_in_each_state(state: State) -> None:
    continuity = at(state)
    assert continuity.follows(batch(11, 12))
    assert (continuity.last, continuity.state) == (12, State.FOLLOWING)


@for_each(("state", "some"), product(State, [(10,), (9, 10), (11, 13), (11, 11), (12,), (0,)]))
def test_nothing_else_follows(state: State, some: tuple[int, ...]) -> None:
    continuity = at(state)
    assert not continuity.follows(batch(*some))
    assert (continuity.last, continuity.state) == (10, state)


GAPS = {State.BEGINNING: (0, 0), State.FOLLOWING: (3, 0), State.RETURNING: (0, 3), State.RESTORING: (0, 3)}
"""Lost and missed messages if the number after 10 is 14."""


@for_each(("state", "gap"), GAPS.items())
def test_what_a_gap_means_in_each_state(state: State, gap: tuple[int, int]) -> None:
    continuity, some = at(state), batch(14, 15)
    assert continuity.classify(some) == Classified(some, 0, *gap)
    assert (continuity.last, continuity.state) == (15, State.FOLLOWING)
    if state is not State.RESTORING:  # if taps come and go, nothing is restored
        jumping = at(state)
        assert jumping.jump(some) == Classified(some, 0, *gap)
        assert (jumping.last, jumping.state) == (15, State.FOLLOWING)


def test_numbers_that_do_not_rise_leave_no_gap_below_zero() -> None:
    continuity, some = at(State.FOLLOWING), batch(11, 11)
    assert continuity.jump(some) == Classified(some, 0, 0, 0)


@for_each("state", [State.BEGINNING, State.FOLLOWING, State.RETURNING])
def test_lower_numbers_are_repetitions(state: State) -> None:
    continuity = at(state)
    found = continuity.classify(batch(8, 9, 10))
    assert (found.batch, found.repeated, found.lost, found.missed) == (None, 3, 0, 0)
    assert (continuity.last, continuity.state) == (10, state)
    found = continuity.classify(batch(10, 11, 11, 13))
    assert (numbers(found.batch), found.repeated, found.lost, found.missed) == ([11, 13], 2, 1, 0)


def test_a_history_that_is_needed_once_more_is_no_repetition() -> None:
    continuity = Continuity()
    continuity.resume(10, restores=True)
    continuity.on(Event.INTERRUPT)
    found = continuity.classify(batch(8, 9, 11, 9))
    assert (numbers(found.batch), found.repeated, found.lost, found.missed) == ([8, 9, 11], 1, 1, 0)


def test_a_history_that_goes_on_right_after_the_last_is_restored_once() -> None:
    continuity = Continuity()
    continuity.resume(10, restores=True)
    assert continuity.follows(batch(11))
    continuity.on(Event.INTERRUPT)
    assert numbers(continuity.classify(batch(9, 10, 11, 12)).batch) == [12]


def test_messages_without_a_number_are_always_new() -> None:
    for state in State:
        continuity, some = at(state), batch(0, 0)
        assert continuity.classify(some) == Classified(some, 0, 0, 0)
        assert (continuity.last, continuity.state) == (10, state)


def test_a_new_tap_for_a_new_subscription_misses_nothing_and_repeats_nothing() -> None:
    continuity = at(State.FOLLOWING)
    continuity.on(Event.RESTART)
    found = continuity.classify(batch(9, 10, 12))
    assert (numbers(found.batch), found.repeated, found.lost, found.missed) == ([12], 2, 0, 0)


# --- in a ring of buses: the same messages by another bridge, with other numbers


def renumbered(state: State, copies: int = 2) -> Continuity:
    continuity = at(state)
    continuity.renumber(copies, until_ns=1000)
    assert (continuity.state, continuity.last) == (State.BEGINNING, 0)
    return continuity


@for_each("state", [State.BEGINNING, State.FOLLOWING, State.RETURNING])
def test_copies_are_recognized_by_their_time(state: State) -> None:
    continuity = renumbered(state)
    assert not continuity.follows(batch(1, at_ns=1000))
    found = continuity.classify(batch(1, at_ns=1000))
    assert (found.batch, found.repeated) == (None, 1)
    assert (continuity.last, continuity.state) == (1, State.FOLLOWING)
    found = continuity.classify(batch(4, at_ns=1001))  # 2 and 3 are missing, between a copy and a new message
    assert (numbers(found.batch), found.repeated, found.lost, found.missed) == ([4], 0, 2, 0)
    assert continuity.follows(batch(5, at_ns=0))


def test_there_are_only_so_many_copies() -> None:
    continuity = renumbered(State.FOLLOWING)
    found = continuity.classify(batch(1, 2, 3, at_ns=1000))
    assert (numbers(found.batch), found.repeated, found.lost) == ([3], 2, 0)


def test_the_first_new_message_ends_the_copies() -> None:
    continuity = renumbered(State.FOLLOWING)
    assert numbers(continuity.classify(batch(3, at_ns=1001)).batch) == [3]
    assert continuity.follows(batch(4, at_ns=1000))


def test_a_history_that_is_needed_once_more_has_no_copies() -> None:
    continuity = renumbered(State.RESTORING)
    assert continuity.follows(batch(1, at_ns=1000))


def test_an_interruption_leaves_the_copies() -> None:
    continuity = renumbered(State.FOLLOWING)
    continuity.classify(batch(1, at_ns=1000))
    continuity.on(Event.INTERRUPT)
    found = continuity.classify(batch(1, 2, 4, at_ns=1000))
    assert (numbers(found.batch), found.repeated, found.lost) == ([2, 4], 1, 1)


@given(st.lists(st.lists(st.integers(1, 30), min_size=1, max_size=6), max_size=8))
def test_each_message_is_new_once_or_repeated_and_gaps_fill_the_rest(some: list[list[int]]) -> None:
    continuity, new, repeated, missing = Continuity(), list[int](), 0, 0
    continuity.resume(0, restores=False)
    for one in some:
        if continuity.follows(batch(*one)):
            new += one
            continue
        found = continuity.classify(batch(*one))
        new += numbers(found.batch)
        repeated += found.repeated
        missing += found.lost + found.missed
    assert new == sorted({*new}) and len(new) + repeated == sum(map(len, some))
    assert len(new) + missing == continuity.last


# --- subscriptions that miss messages

A, B = b"a" * 16, b"b" * 16


def test_listeners_are_those_that_had_the_last_message() -> None:
    listeners = Listeners()
    listeners.change(frozenset((A, B)), 0)
    assert not listeners.are_back  # nothing has arrived yet
    listeners.change(frozenset((B,)), 3)
    assert listeners.before == {A, B} and listeners.are_back
    listeners.change(frozenset(), 3)  # busd is away
    assert listeners.before == {A, B} and not listeners.are_back
    listeners.change(frozenset((A,)), 4)  # message 4 had no listener
    assert listeners.before == {A, B} and listeners.are_back
    listeners.change(frozenset(), 5)
    assert listeners.before == {A}


def test_listeners_go_on_or_are_forgotten() -> None:
    listeners = Listeners()
    listeners.resume(frozenset((A,)), 3)
    listeners.change(frozenset((A, B)), 3)
    assert listeners.before == {A} and listeners.are_back
    listeners.forget()
    assert not listeners.are_back
    listeners.change(frozenset((B,)), 0)
    assert listeners.before == frozenset()
