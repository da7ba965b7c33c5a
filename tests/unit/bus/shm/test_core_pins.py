"""bus.shm._core: records that are read in place do not change, and the reader releases them."""

import gc
import os
import random
import time
from collections.abc import Iterator
from typing import Any

import pytest

from bus.shm import segments
from shm_ends import LARGE, Listener, Talker, core, listener

__all__ = ["listener"]


@pytest.fixture
def talker() -> Iterator[Talker]:
    end = Talker(1 << 17)
    yield end
    end.close()


def as_is(payload: Any) -> Any:
    return payload


def test_short_ones_are_copied_and_long_ones_pinned(talker: Talker, listener: Listener) -> None:
    slot = listener.join(talker)
    talker.write(bytes(4096), bytes(4097))
    short, view = listener.reader.messages(2, as_is)
    assert type(short) is bytes
    assert type(view) is memoryview
    assert (view.readonly, len(view), view.format) == (True, 4097, "B")
    with pytest.raises(TypeError):
        view[0] = 1
    assert talker.writer.has_pins(id(listener))
    assert not listener.readers.is_free(slot)
    del view
    assert not talker.writer.has_pins(id(listener))
    assert listener.readers.is_free(slot)


def test_what_is_held_stays_whatever_is_written(talker: Talker, listener: Listener) -> None:
    """The reader drops views and parts of views in any order, while the writer laps the ring again and
    again.
    """
    slot = listener.join(talker)
    dice = random.Random(1)
    held: list[tuple[memoryview, bytes]] = []
    for number in range(1, 600):
        payload = dice.randbytes(dice.randrange(4097, 12_000))
        talker.write(payload)
        (view,) = listener.reader.messages(1, as_is)
        assert bytes(view) == payload, number
        if type(view) is memoryview and dice.random() < 0.3:
            begin = dice.randrange(4000)
            held.append((view[begin:], payload[begin:]))
        if len(held) > 5:
            held.pop(dice.randrange(len(held)))
        assert all(bytes(part) == expected for part, expected in held), number
    assert held
    view = None
    held.clear()
    assert listener.readers.is_free(slot)
    assert listener.reader.overrun == 0


def test_where_all_pins_are_in_use_it_is_copied(listener: Listener) -> None:
    talker = Talker(1 << 16)
    listener.join(talker)
    held = []
    for number in range(13):
        talker.write(bytes(4500))
        (payload,) = listener.reader.messages(1, as_is)
        assert type(payload) is memoryview
        if number % 2 == 0:
            held.append(payload)
        del payload
    talker.write(bytes(4200))
    assert [type(payload) for payload in listener.reader.messages(1, as_is)] == [bytes]
    assert talker.writer.write(bytes(10_000)) == core.PINNED
    assert talker.writer.lend(10_000) == core.PINNED
    held.clear()
    talker.write(bytes(10_000))


def test_nothing_is_pinned_before_the_writer_sees_it(talker: Talker, listener: Listener) -> None:
    slot = listener.join(talker, gate=False)
    talker.write(bytes(LARGE))
    assert [type(payload) for payload in listener.reader.messages(1, as_is)] == [bytes]
    talker.writer.add_gate(1, listener.bell, slot, is_lossless=False)
    assert not talker.writer.has_pins(1)
    talker.write(bytes(LARGE))
    assert [type(payload) for payload in listener.reader.messages(1, as_is)] == [memoryview]
    assert listener.readers.is_free(slot)


def test_a_gate_for_another_slot_lets_nothing_be_pinned(talker: Talker, listener: Listener) -> None:
    listener.join(talker, gate=False)
    talker.writer.add_gate(1, listener.bell, 7, is_lossless=False)
    talker.write(bytes(LARGE))
    assert [type(payload) for payload in listener.reader.messages(1, as_is)] == [bytes]


def test_whoever_is_admitted_last_of_many_still_is(talker: Talker) -> None:
    listeners = [Listener() for _ in range(20)]
    for end in listeners:
        end.join(talker)
    talker.write(bytes(LARGE))
    for end in listeners:
        assert [type(payload) for payload in end.reader.messages(1, as_is)] == [memoryview]
        end.close()


def test_a_slot_with_pins_is_not_given_to_a_new_match(talker: Talker, listener: Listener) -> None:
    slot = listener.join(talker)
    talker.write(bytes(LARGE))
    (view,) = listener.reader.messages(1, as_is)
    listener.reader.detach(1)
    with pytest.raises(ValueError, match="in use"):
        listener.reader.attach(1, segments.map_ring(talker.ring), slot)
    del view
    listener.reader.attach(1, segments.map_ring(talker.ring), slot)
    with pytest.raises(ValueError, match="in use"):  # the attach before still waits to be admitted
        listener.reader.attach(2, segments.map_ring(talker.ring), slot)
    listener.reader.detach(1)
    assert listener.readers.is_free(slot)


def test_views_outlive_all_that_they_came_from() -> None:
    talker, listener = Talker(), Listener()
    listener.join(talker)
    payload = os.urandom(LARGE)
    talker.write(payload)
    (view,) = listener.reader.messages(1, as_is)
    place = talker.writer.lend(10)
    talker.close()
    listener.close()
    del talker, listener
    gc.collect()
    place[:] = b"0123456789"
    assert view == payload


def test_pins_hold_over_growth(talker: Talker, listener: Listener) -> None:
    listener.join(talker)
    payload = os.urandom(LARGE)
    talker.write(payload)
    (view,) = listener.reader.messages(1, as_is)
    listener.reader.extend(1, segments.map_ring(talker.grow(1 << 17)))
    for _ in range(100):
        talker.write(bytes(LARGE))
        (newest,) = listener.reader.messages(1, as_is)
        assert type(newest) is memoryview
        assert view == payload
    assert newest == bytes(LARGE)


def test_a_decoder_that_refuses_a_view_lets_it_go(talker: Talker, listener: Listener) -> None:
    slot = listener.join(talker)

    def refuse(payload: memoryview) -> None:
        raise ValueError(payload)

    talker.write(bytes(LARGE))
    assert listener.reader.messages(1, refuse) == []
    assert [size for size, _ in listener.reader.pop_rejected()] == [LARGE]
    assert listener.readers.is_free(slot)


def test_the_error_of_a_decoder_does_not_keep_the_sample(talker: Talker, listener: Listener) -> None:
    """Its traceback would: the frame of the decoder has the payload."""
    slot = listener.join(talker)

    def refuse(payload: memoryview) -> None:
        raise ValueError("no")

    talker.write(bytes(LARGE))
    assert listener.reader.messages(1, refuse) == []
    assert listener.readers.is_free(slot)
    ((_, error),) = listener.reader.pop_rejected()
    assert error.__traceback__ is None


def test_a_child_does_not_release_the_parents_pins(talker: Talker, listener: Listener) -> None:
    slot = listener.join(talker)
    talker.write(bytes(LARGE))
    held = listener.reader.messages(1, as_is)
    child = os.fork()
    if child == 0:
        try:
            held.clear()
            is_refused = talker.writer.write(b"x") == core.WRONG_THREAD
            os._exit(0 if is_refused and not listener.readers.is_free(slot) else 1)
        finally:
            os._exit(2)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert not listener.readers.is_free(slot)
    assert held[0] == bytes(LARGE)
    held.clear()
    assert listener.readers.is_free(slot)


def test_a_loan_is_the_place_itself(talker: Talker, listener: Listener) -> None:
    """Data written into the loan after publishing are in the record, so nothing was copied."""
    listener.join(talker)
    place = talker.writer.lend(LARGE)
    assert talker.writer.publish_lent() is True
    (view,) = listener.reader.messages(1, as_is)
    place[:4] = b"late"
    assert bytes(view[:4]) == b"late"
    assert time.monotonic_ns() > talker.writer.since(0)[0][1]


def test_a_gate_that_comes_once_more_still_keeps_what_is_held(talker: Talker, listener: Listener) -> None:
    slot = listener.join(talker)
    talker.write(b"x" * LARGE)
    (view,) = listener.reader.messages(1, as_is)
    talker.write(*[bytes(LARGE)] * 40)  # the writer laps the ring
    talker.writer.add_gate(id(listener), listener.bell, slot, is_lossless=False)
    talker.write(*[bytes(LARGE)] * 40)
    assert view == b"x" * LARGE
