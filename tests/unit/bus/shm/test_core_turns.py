"""bus.shm._core: large messages stay at the beginning of the ring; messages in use stay in their places."""

import ctypes
import random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from effort import examples
from shm_ends import Listener, Talker, core

SIZE = (64 << 10) - 32
CAPACITY = 4 << 20
FITTING = CAPACITY // (SIZE + 32)


def place_of_loan(talker: Talker) -> int:
    """The address of a large message that is lent now. The message is then published."""
    place = talker.writer.lend(SIZE)
    assert isinstance(place, memoryview)
    address = ctypes.addressof(ctypes.c_char.from_buffer(place))
    del place
    assert talker.writer.publish_lent() is True
    return address


def as_is(payload: Any) -> Any:
    return payload


@pytest.mark.parametrize("is_lossless", [False, True])
def test_what_is_lent_is_soon_lent_again(is_lossless: bool) -> None:
    talker, listener = Talker(CAPACITY), Listener(0 if is_lossless else 1, tells_cursor=is_lossless)
    listener.join(talker, start=1 if is_lossless else 0)
    places = set()
    for _ in range(3 * FITTING):
        places.add(place_of_loan(talker))
        assert len(listener.take()) == 1
    assert len(places) == 3
    talker.close()
    listener.close()


def test_a_hold_in_the_way_is_asked_for_once_a_record() -> None:
    talker, listener = Talker(4 * CAPACITY), Listener(tells_cursor=True)
    listener.join(talker, start=1)
    talker.writer.hold = 1
    asked, places = [], set()
    for number in range(1, 400):
        place = talker.writer.lend(SIZE)
        if place == core.HELD:
            asked.append(number)
            talker.writer.hold = number
            place = talker.writer.lend(SIZE)
        places.add(ctypes.addressof(ctypes.c_char.from_buffer(place)))
        del place
        assert talker.writer.publish_lent() is True
        assert len(listener.take()) == 1
    assert len(places) == FITTING
    assert asked == list(range(FITTING + 1, 400, FITTING))
    talker.close()
    listener.close()


@pytest.mark.parametrize("is_behind", [False, True])
def test_who_does_not_move_a_hold_goes_on_in_the_ring(is_behind: bool) -> None:
    talker, listener = Talker(4 * CAPACITY), Listener(tells_cursor=True)
    listener.join(talker, start=1)
    talker.writer.hold = 1
    outcomes = []
    for _ in range(8 * FITTING):
        outcomes.append(talker.writer.write_parts([bytes(SIZE)]))
        if not is_behind:
            listener.take()
    assert outcomes.count(True) == 4 * FITTING
    # A reader that is behind is in the way itself, so moving the hold would not help.
    assert outcomes.count(core.HELD) == (0 if is_behind else 4 * FITTING - FITTING)
    assert outcomes[-1] == core.FULL
    talker.close()
    listener.close()


def test_who_stops_reading_has_all_of_the_ring() -> None:
    for taken in range(8):
        talker, listener = Talker(CAPACITY), Listener(tells_cursor=True)
        listener.join(talker, start=1)
        for _ in range(taken):
            talker.write(bytes(SIZE))
            listener.take()
        talker.write(*([bytes(SIZE)] * FITTING))
        assert talker.writer.write(bytes(SIZE)) not in (True, 0)
        assert sum(len(listener.take(FITTING)) for _ in range(FITTING)) == FITTING
        talker.close()
        listener.close()


def test_what_is_carried_to_a_larger_ring_is_all_there() -> None:
    talker = Talker(CAPACITY, keep=12)
    talker.write(*(bytes([number]) * SIZE for number in range(100)))
    before = talker.writer.oldest
    talker.grow(2 * CAPACITY)
    assert talker.writer.oldest == before
    assert [payload[0] for _, _, payload in talker.writer.since(0)] == list(range(before - 1, 100))
    talker.close()


def test_views_stay_as_they_are() -> None:
    talker, listener = Talker(CAPACITY), Listener(1)
    listener.join(talker)
    dice = random.Random(1)
    held: list[tuple[memoryview, int]] = []
    for number in range(1000):
        talker.write(bytes([number % 251]) * SIZE)
        (view,) = listener.reader.messages(1, as_is)
        if dice.random() < 0.3:
            held.append((view, number % 251))
        if len(held) > 5:
            held.pop(dice.randrange(len(held)))
        assert all(set(view[::997]) == {value} for view, value in held), number
    held.clear()
    del view
    talker.close()
    listener.close()


SIZES = st.sampled_from([10, 5_000, 33_000, SIZE, 3 * SIZE])
ACTIONS = st.lists(
    st.one_of(
        st.tuples(st.just("write"), SIZES),
        st.tuples(st.just("write"), st.just(SIZE)),
        st.tuples(st.just("take"), st.integers(1, 5)),
        st.tuples(st.just("hold"), st.integers(1, 3)),
        st.tuples(st.just("let go"), st.integers(0, 3)),
        st.tuples(st.just("keep"), st.integers(1, 6)),
    ),
    max_size=120,
)


@settings(max_examples=examples(60), deadline=None)
@given(actions=ACTIONS, keep=st.integers(1, 4))
def test_any_story_against_a_list(actions: list[tuple[str, int]], keep: int) -> None:
    """A lossless reader takes all messages, a lossy one at least the newest. Held messages stay, and the
    depth is kept.
    """
    talker = Talker(1 << 20, keep=keep)
    lossless, lossy = Listener(tells_cursor=True), Listener(keep)
    lossless.join(talker, start=1)
    lossy.join(talker)
    written: list[bytes] = []
    taken: list[bytes] = []
    held: list[tuple[Any, bytes]] = []
    for what, number in actions:
        if what == "write":
            payload = len(written).to_bytes(4, "little") * (number // 4)
            if talker.writer.write(payload) is True:
                written.append(payload)
        elif what == "take":
            taken += lossless.take(number)
        elif what == "hold":
            views = lossless.reader.messages(number, as_is)
            held += zip(views, written[len(taken) :], strict=False)
            taken += map(bytes, views)
            del views
        elif what == "let go" and held:
            held.pop(number % len(held))
        elif what == "keep":
            talker.writer.keep = min(talker.writer.keep, number)
        assert taken == written[: len(taken)]
        assert [bytes(view) for view, _ in held] == [payload for _, payload in held]
        there = [payload for _, _, payload in talker.writer.since(0)]
        assert there == written[len(written) - len(there) :]
        assert len(there) >= min(len(written), talker.writer.keep)
    if written and len(written[-1]) >= 4:
        assert lossy.take()[-1:] == written[-1:]
    while len(taken) < len(written):
        taken += lossless.take(5)
    assert taken == written
    held.clear()
    for end in (talker, lossless, lossy):
        end.close()
