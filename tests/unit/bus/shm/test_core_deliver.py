"""bus.shm._core: Readers.deliver, which calls the callbacks itself and puts the readers back to sleep."""

import gc
import os
import sys
import weakref
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from bus.shm import segments
from shm_ends import Listener, Talker, core, is_rung, listener, talker

__all__ = ["listener", "talker"]


class Heard:
    """Receives a reader's callbacks; `then` runs in each call."""

    def __init__(self, reader: Any, decode: Callable[[Any], Any] = bytes) -> None:
        self.reader = reader
        self.messages: list[Any] = []
        self.errors: list[BaseException] = []
        self.queue: list[object] = []
        self.then: Callable[[], object] = int
        reader.is_report_due = True
        self.on_report_due: Callable[[], object] = self.note
        self.notes: list[int] = []
        reader.prepare(self, decode, self.errors.append, (self.queue,), lambda: self.on_report_due())

    def __call__(self, message: Any) -> None:
        self.messages.append(message)
        self.then()

    def note(self) -> None:
        """Record the number of messages so far."""
        self.notes.append(len(self.messages))


@pytest.fixture(params=[0, 20])
def crowd(request: pytest.FixtureRequest, listener: Listener) -> Iterator[list[Talker]]:
    """Further rings that this process reads. With many rings, a knock names its slot."""
    talkers = [Talker(4096, 64) for _ in range(request.param)]
    reader = core.Reader(listener.readers, "nobody", 0, tells_cursor=False)
    for source, end in enumerate(talkers):
        slot = next(listener.slots)
        reader.attach(source, segments.map_ring(end.ring), slot)
        end.writer.add_gate(source, listener.bell, slot, is_lossless=False)
    yield talkers
    for end in talkers:
        end.close()


@pytest.fixture
def heard(listener: Listener, talker: Talker, crowd: list[Talker]) -> Heard:
    listener.join(talker)
    is_rung(listener.doorbell)
    listener.readers.sleep()
    return Heard(listener.reader)


def another(listener: Listener, talker: Talker, owner: object) -> Any:
    """Another reader of the same process."""
    reader = core.Reader(listener.readers, owner, 0, tells_cursor=False)
    slot = next(listener.slots)
    reader.attach(1, segments.map_ring(talker.ring), slot)
    talker.writer.add_gate(slot, listener.bell, slot, is_lossless=False)
    return reader


def test_a_message_is_called_back_with_and_the_process_sleeps(
    talker: Talker, listener: Listener, heard: Heard
) -> None:
    for number in range(1, 4):
        talker.write(b"x")
        assert talker.writer._debug()["rung"] == number
        assert listener.readers.deliver(True) is None
        assert heard.messages == [b"x"] * number
        assert not is_rung(listener.doorbell)
    assert listener.reader.samples == 3
    assert listener.readers.deliver(True) is None  # the doorbell rang without a message


def test_among_many_it_looks_only_at_what_it_was_rung_for(
    talker: Talker, listener: Listener, heard: Heard, crowd: list[Talker]
) -> None:
    silent, quiet = Talker(), core.Reader(listener.readers, "quiet", 0, tells_cursor=False)
    quiet.attach(1, segments.map_ring(silent.ring), next(listener.slots))  # no doorbell rings for it
    unheard = Heard(quiet)
    assert listener.readers.sleep() == []
    for number in range(1, 4):
        silent.write(b"x")
        talker.write(b"x")
        assert listener.readers.deliver(True) is None
        assert len(heard.messages) == number
        assert len(unheard.messages) == (0 if crowd else number)
    if crowd:
        assert listener.readers.deliver(False) == ["quiet"]
        assert unheard.messages + quiet.messages(9, bytes) == [b"x"] * 3
    silent.close()


def test_knocks_for_two_rings_are_a_look_at_all(
    talker: Talker, listener: Listener, heard: Heard, crowd: list[Talker]
) -> None:
    for number, end in enumerate(crowd, 1):
        end.write(b"x")
        talker.write(b"x", b"x")
        assert (end.writer._debug()["rung"], talker.writer._debug()["rung"]) == (1, number)
        assert listener.readers.deliver(True) == ["nobody", listener]
        assert listener.take() == [b"x", b"x"]
        assert listener.readers.sleep() == []


def test_what_is_read_since_the_last_look_at_all_is_looked_at(
    talker: Talker, listener: Listener, heard: Heard, crowd: list[Talker]
) -> None:
    other = Talker()
    other.write(b"before")
    reader = core.Reader(listener.readers, "new", 0, tells_cursor=False)
    unheard = Heard(reader)
    reader.attach(1, segments.map_ring(other.ring), next(listener.slots), since_ns=0)
    talker.write(b"x")
    assert listener.readers.deliver(True) is None
    assert (heard.messages, unheard.messages) == ([b"x"], [b"before"])
    other.close()


def test_an_old_knock_is_no_reason_not_to_look(
    talker: Talker, listener: Listener, heard: Heard, crowd: list[Talker]
) -> None:
    talker.write(b"x")
    knock = os.eventfd_read(listener.doorbell.number)
    listener.reader.is_busy = True
    assert listener.readers.deliver(False) == [listener]
    listener.reader.is_busy = False
    for end in crowd[:1]:
        end.write(b"y")  # does not ring: the reader is awake
    os.eventfd_write(listener.doorbell.number, knock)  # as from a slow writer
    talker.write(b"x")
    assert listener.readers.deliver(True) == [*(["nobody"] * len(crowd[:1])), listener]


def test_a_knock_for_a_match_that_was(
    talker: Talker, listener: Listener, heard: Heard, crowd: list[Talker]
) -> None:
    listener.reader.detach(1)
    talker.write(b"x")
    assert talker.writer._debug()["rung"] == 1
    assert listener.readers.deliver(True) is None
    assert heard.messages == []


def test_a_new_gate_rings_once_more_where_its_writer_has_rung_for_another(
    talker: Talker, listener: Listener, heard: Heard, crowd: list[Talker]
) -> None:
    talker.write(b"x")
    later = Heard(another(listener, talker, "later"))
    assert talker.writer._debug()["rung"] == (2 if crowd else 1)
    assert listener.readers.deliver(True) is None
    assert (heard.messages, later.messages) == ([b"x"], [b"x"])


def test_it_stays_awake_where_it_may_not_sleep(talker: Talker, listener: Listener, heard: Heard) -> None:
    talker.write(b"x")
    assert listener.readers.deliver(False) == []
    assert heard.messages == [b"x"]
    talker.write(b"y")
    assert talker.writer._debug()["rung"] == 1


def test_the_owner_takes_what_is_more_than_one(talker: Talker, listener: Listener, heard: Heard) -> None:
    talker.write(b"a", b"b", b"c")
    assert listener.readers.deliver(True) == [listener]
    assert heard.messages == [b"a"]
    assert listener.take() == [b"b", b"c"]
    assert listener.readers.sleep() == []


def test_what_comes_in_the_call_is_the_owners(talker: Talker, listener: Listener, heard: Heard) -> None:
    heard.then = lambda: talker.write(b"b")
    talker.write(b"a")
    assert listener.readers.deliver(True) == [listener]
    assert heard.messages == [b"a"]


def test_what_comes_for_others_in_the_call_is_found_before_the_sleep(
    talker: Talker, listener: Listener, heard: Heard
) -> None:
    late = Talker()
    first = another(listener, late, "first")
    Heard(first)
    first.detach(1)  # and every look comes to it last
    again = core.Reader(listener.readers, "again", 0, tells_cursor=False)
    again.attach(1, segments.map_ring(late.ring), next(listener.slots))
    others = Heard(again)
    heard.then = lambda: late.write(b"b")
    talker.write(b"a")
    assert listener.readers.deliver(True) is None
    assert (heard.messages, others.messages) == ([b"a"], [b"b"])
    others.then, heard.then = lambda: talker.write(b"d"), int
    late.write(b"c")
    assert listener.readers.deliver(True) == []  # its turn is over, so it stays awake
    assert listener.readers.sleep() == [listener]
    late.close()


@pytest.mark.parametrize("reason", ["busy", "queue", "forgotten", "never prepared"])
def test_who_must_not_be_called_back_is_left_to_its_owner(
    talker: Talker, listener: Listener, heard: Heard, reason: str
) -> None:
    if reason == "busy":
        listener.reader.is_busy = True
    elif reason == "queue":
        heard.queue.append(None)
    elif reason == "forgotten":
        listener.reader.forget_callback()
    else:
        listener.reader.detach(1)
        other = another(listener, talker, "other")
        talker.write(b"x")
        assert listener.readers.deliver(True) == ["other"]
        del other
        return
    talker.write(b"x")
    assert listener.readers.deliver(True) == [listener]
    assert heard.messages == []
    assert listener.readers.sleep() == []  # reported only once
    if reason != "forgotten":
        listener.reader.is_busy = False
        heard.queue.clear()
        talker.write(b"y")
        assert listener.readers.deliver(True) == [listener]
        assert heard.messages == [b"x"]
    assert listener.take() == [b"x", b"y"][len(heard.messages) : 1 + len(heard.messages)]


def test_those_behind_an_owner_wait_for_it(talker: Talker, listener: Listener, heard: Heard) -> None:
    """Readers are served in the order in which their rings were attached, with or without a callback."""
    middle, last = (another(listener, talker, name) for name in ("middle", "last"))
    others = Heard(last)
    talker.write(b"x")
    assert listener.readers.deliver(True) == ["middle", "last"]
    assert (heard.messages, others.messages) == ([b"x"], [])
    Heard(middle)
    last.messages(1, bytes)
    middle.messages(1, bytes)
    talker.write(b"y")
    assert listener.readers.deliver(True) is None
    assert others.messages == [b"y"]


def test_the_first_since_a_report_is_noted_and_the_process_sleeps(
    talker: Talker, listener: Listener, heard: Heard, crowd: list[Talker]
) -> None:
    silent, quiet = Talker(), core.Reader(listener.readers, "quiet", 0, tells_cursor=False)
    quiet.attach(1, segments.map_ring(silent.ring), next(listener.slots))
    unheard = Heard(quiet)
    assert listener.readers.sleep() == []
    silent.write(b"x")
    for number in range(1, 4):
        listener.reader.is_report_due = number == 2
        talker.write(b"x")
        assert listener.readers.deliver(True) is None
        assert listener.reader.is_report_due
        assert len(heard.messages) == number
        # The note came before the callback, which may close the reader.
        assert heard.notes == [0, 2][: (number + 1) // 2]
        assert unheard.messages == ([] if crowd else [b"x"])  # with many rings, only one is read
    silent.close()


def test_what_a_note_raises_is_told_and_the_message_delivered(
    talker: Talker, listener: Listener, heard: Heard, crowd: list[Talker]
) -> None:
    def fail() -> None:
        heard.note()
        raise ValueError("note")

    listener.reader.is_report_due = False
    heard.on_report_due = fail
    for number in (1, 2):
        talker.write(b"x")
        assert listener.readers.deliver(True) is None
        assert [str(error) for error in heard.errors] == ["note"] * number
        assert heard.notes == [*range(number)]
        assert heard.messages == [b"x"] * number


def test_a_note_may_take_the_callback_away(talker: Talker, listener: Listener, heard: Heard) -> None:
    def forget() -> None:
        listener.reader.forget_callback()
        gc.collect()

    listener.reader.is_report_due = False
    heard.on_report_due = forget
    for _ in range(2):
        talker.write(b"x")
        listener.readers.deliver(True)
    assert heard.messages == [b"x"]  # this delivery had begun before
    assert listener.take() == [b"x"]


def test_the_owner_is_told_of_losses(talker: Talker, listener: Listener, heard: Heard) -> None:
    listener.reader.depth = 1
    for number, lost in ((3, 2), (600, 601)):
        talker.write(*[b"x"] * number)
        assert listener.readers.deliver(True) == [listener]
        assert listener.reader.replaced + listener.reader.overrun == lost
        assert (listener.reader.overrun != 0) is (number == 600)
        assert listener.readers.sleep() == []
        talker.write(b"y")
        assert listener.readers.deliver(True) is None
    assert heard.messages == [b"x", b"y"] * 2


def test_the_owner_looks_after_what_does_not_decode_or_has_expired(
    talker: Talker, listener: Listener
) -> None:
    def decode(payload: bytes) -> bytes:
        if payload == b"bad":
            raise ValueError("bad")
        return payload

    listener.join(talker, lifespan_ns=1)
    talker.write(b"old")
    heard = Heard(listener.reader, decode)
    assert listener.readers.deliver(True) == [listener]
    assert listener.reader.expired == 1
    listener.reader.detach(1)
    listener.join(talker, start=2)
    talker.write(b"bad")
    assert listener.readers.deliver(True) == [listener]
    assert [(size, str(error)) for size, error in listener.reader.pop_rejected()] == [(3, "bad")]
    assert heard.messages == []
    assert not listener.reader.is_busy


def test_an_error_is_told_while_it_is_handled(talker: Talker, listener: Listener, heard: Heard) -> None:
    told: list[Any] = []

    def fail() -> None:
        raise ValueError("no")

    def on_error(error: BaseException) -> None:
        told.append((error, sys.exc_info()[1], error.__traceback__))

    heard.then = fail
    listener.reader.prepare(heard, bytes, on_error, (), heard.note)
    talker.write(b"x")
    try:
        raise KeyError
    except KeyError as outer:
        assert listener.readers.deliver(True) is None
        assert sys.exc_info()[1] is outer
    ((error, handled, traceback),) = told
    assert isinstance(error, ValueError) and handled is error
    assert traceback.tb_frame.f_code is Heard.__call__.__code__
    assert not listener.reader.is_busy


@pytest.mark.parametrize("error", [SystemExit, KeyboardInterrupt, GeneratorExit])
@pytest.mark.parametrize("where", ["callback", "decode", "on_error", "on_report_due"])
def test_what_is_no_exception_goes_through_and_loses_no_wake_up(
    talker: Talker, listener: Listener, heard: Heard, error: type[BaseException], where: str
) -> None:
    other = Heard(another(listener, talker, "other"))

    def fail(*_: object) -> None:
        raise error

    def fail_simply() -> None:
        raise ValueError

    if where == "callback":
        heard.then = fail
    elif where == "decode":
        listener.reader.prepare(heard, fail, fail, (), heard.note)
    elif where == "on_report_due":
        heard.on_report_due = fail
        listener.reader.is_report_due = False
    else:
        heard.then = fail_simply
        listener.reader.prepare(heard, bytes, fail, (), heard.note)
    talker.write(b"x")
    with pytest.raises(error):
        listener.readers.deliver(True)
    assert is_rung(listener.doorbell)
    assert not listener.reader.is_busy
    assert other.messages == []
    assert listener.readers.deliver(True) == [listener]
    assert other.messages == [b"x"]
    assert not is_rung(listener.doorbell)
    assert listener.reader.is_report_due is (where != "on_report_due")  # the next message makes it due


def test_a_callback_may_look_itself(talker: Talker, listener: Listener, heard: Heard) -> None:
    """A callback may call `deliver` itself, for example by running the loop."""
    other = Heard(another(listener, talker, "other"))
    answers: list[Any] = []
    heard.then = lambda: answers.append(listener.readers.deliver(True))
    talker.write(b"x")
    assert listener.readers.deliver(True) is None
    assert answers == [None]
    assert (heard.messages, other.messages) == ([b"x"], [b"x"])
    talker.write(b"y")
    heard.then = lambda: (talker.write(b"z"), answers.append(listener.readers.deliver(True)))
    assert listener.readers.deliver(True) is not None
    assert answers[1] == [listener, "other"]  # calls don't overlap
    assert heard.messages == [b"x", b"y"]


def test_a_callback_may_end_itself_and_others(talker: Talker, listener: Listener, heard: Heard) -> None:
    others = [Heard(another(listener, talker, number)) for number in range(5)]

    def end() -> None:
        listener.reader.forget_callback()
        listener.reader.detach(1)
        others[0].reader.detach(1)
        del others[1:3]
        gc.collect()
        for other in others:
            other.reader.forget_callback()

    heard.then = end
    talker.write(b"x")
    told = listener.readers.deliver(True)
    assert sorted([*told, *listener.readers.sleep()]) == [3, 4]
    assert heard.messages == [b"x"]
    assert all(other.messages == [] for other in others)


def test_a_callback_may_add_readers(
    talker: Talker, listener: Listener, heard: Heard, crowd: list[Talker]
) -> None:
    added: list[Heard] = []

    def add() -> None:
        heard.then = int
        added.extend(Heard(another(listener, talker, number)) for number in range(40))

    heard.then = add
    talker.write(b"x")
    # A look at one ring only does not end in sleep.
    assert listener.readers.deliver(True) == ([] if crowd else None)
    assert listener.readers.deliver(True) is None
    talker.write(b"y")
    assert listener.readers.deliver(True) is None
    assert [one.messages for one in added] == [[b"x", b"y"]] * 40


def test_closed_in_a_callback_the_doorbell_is_left_alone(
    talker: Talker, listener: Listener, heard: Heard, crowd: list[Talker]
) -> None:
    other = Heard(another(listener, talker, "other"))
    heard.then = listener.readers.close
    talker.write(b"x")
    assert listener.readers.deliver(True) is None
    assert crowd or is_rung(listener.doorbell)  # neither read afterwards nor armed
    talker.write(b"y")
    assert not is_rung(listener.doorbell)
    assert listener.readers.deliver(True) is None
    assert (heard.messages, other.messages) == ([b"x"], [])


def test_a_child_forked_in_a_callback_leaves_the_doorbell_to_its_parent(
    talker: Talker, listener: Listener, heard: Heard
) -> None:
    children = []

    def fork() -> None:
        if child := os.fork():
            children.append(child)
        else:
            core.forget_pins()
            listener.readers.close()

    heard.then = fork
    talker.write(b"x")
    answer = listener.readers.deliver(False)
    if not children:
        os._exit(0 if answer is None and is_rung(listener.doorbell) else 1)
    os.waitpid(children[0], 0)
    assert answer == []


def test_a_prepared_reader_is_collected_with_what_it_calls(talker: Talker, listener: Listener) -> None:
    reader = another(listener, talker, "owner")
    heard = Heard(reader)
    heard.then = reader.messages  # a reference cycle
    gone = weakref.ref(heard)
    del heard, reader
    gc.collect()
    assert gone() is None
    talker.write(b"x")
    assert listener.readers.deliver(True) is None


def test_nothing_is_kept_of_what_was_called(talker: Talker, listener: Listener) -> None:
    class Message:
        def __init__(self, payload: bytes) -> None:
            if payload == b"bad":
                raise ValueError

    listener.join(talker)
    heard = Heard(listener.reader, Message)

    def raise_error() -> None:
        heard.errors.clear()
        raise ValueError

    def count() -> tuple[int, list[int]]:
        gc.collect()
        used = (heard, Message, listener, listener.reader, listener.readers, heard.queue)
        return sys.getallocatedblocks(), [sys.getrefcount(one) for one in used]

    def round_trips() -> None:
        for heard.then in (int, raise_error):
            for payload in (b"x", b"bad"):
                for may_sleep in (True, False):
                    listener.reader.is_report_due = False
                    talker.write(payload)
                    listener.readers.deliver(may_sleep)
                    listener.reader.pop_rejected()
                    heard.messages.clear()
                    heard.notes.clear()

    round_trips()
    blocks, references = count()
    for _ in range(1000):
        round_trips()
    after = count()
    assert after[1] == references
    assert after[0] < blocks + 50


def test_a_look_gives_turns_too(talker: Talker, listener: Listener, heard: Heard) -> None:
    assert listener.readers.deliver(False) == []
    assert listener.readers.look(1000) is None
    talker.write(b"x")
    assert talker.writer._debug()["rung"] == 0
    assert listener.readers.look(0) == []
    assert heard.messages == [b"x"]
    assert listener.readers.look(0) is None
    talker.write(b"y", b"z")
    assert listener.readers.look(0) == [listener]
    assert listener.take() == [b"z"]


def test_an_error_in_a_look_loses_no_wake_up(talker: Talker, listener: Listener, heard: Heard) -> None:
    def fail() -> None:
        raise KeyboardInterrupt

    heard.then = fail
    talker.write(b"x")
    with pytest.raises(KeyboardInterrupt):
        listener.readers.look(0)
    assert is_rung(listener.doorbell)
    assert listener.readers.look(0) == [listener]
