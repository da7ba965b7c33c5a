"""bus.shm._core: writing and taking, losses and their counts, the first and the last sample of a reader."""

import gc
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from bus.base.time_parts import part_of
from bus.shm import segments
from shm_ends import LARGE, Listener, Talker, core, listener, talker

__all__ = ["listener", "talker"]


# --- writing and taking


def test_what_is_written_is_taken(talker: Talker, listener: Listener) -> None:
    listener.join(talker)
    before = time.monotonic_ns()
    talker.write(b"one", bytearray(b"two"), memoryview(b"three"), b"")  # type: ignore[arg-type]
    assert talker.writer.write_parts([b"fo", bytearray(b"u"), b"r"] + [b""] * 20) is True
    after = time.monotonic_ns()
    assert (talker.writer.samples, talker.writer.bytes, talker.writer.latest) == (5, 15, 5)
    assert (listener.reader.waiting(), listener.reader.next_seq(1)) == (5, 1)
    taken = listener.reader.take(3, bytes) + listener.reader.take(9, bytes)
    assert [message for message, *_ in taken] == [b"one", b"two", b"three", b"", b"four"]
    assert [seq for _, _, seq, _, _ in taken] == [1, 2, 3, 4, 5]
    stamps = [stamp for _, stamp, *_ in taken]
    assert stamps == sorted(stamps)
    assert before <= stamps[0] <= stamps[-1] <= after <= taken[0][4]
    assert {source for *_, source, _ in taken} == {1}
    assert (listener.reader.samples, listener.reader.bytes, listener.reader.waiting()) == (5, 15, 0)


def test_a_batch_ends_with_its_limit_or_at_256_kib(listener: Listener) -> None:
    talker = Talker(1 << 20, keep=100)
    listener.join(talker)
    talker.write(*[bytes(30_000)] * 20)
    assert listener.reader.messages(0, bytes) == []
    assert len(listener.take(2)) == 2
    assert len(listener.take()) == 9
    assert len(listener.take()) == 9


def test_ages_of_some_are_looked_at(talker: Talker, listener: Listener) -> None:
    listener.join(talker)
    began_ns = time.monotonic_ns()
    talker.write(b"one", b"two", b"three")
    assert len(listener.reader.messages(1, bytes)) == 1
    assert len(listener.reader.take(9, bytes)) == 2
    count, sum_ns, most_ns, parts = listener.reader.pop_ages()
    assert count == sum(parts) == 3
    assert len(parts) == part_of(most_ns) + 1
    assert 0 < most_ns < sum_ns < 3 * (time.monotonic_ns() - began_ns)
    assert listener.reader.pop_ages() == (0, 0, 0, ())
    for _ in range(64 + 3 * 32):
        talker.write(b"more")
        listener.reader.messages(1, bytes)
    assert listener.reader.pop_ages()[0] == 64 + 3


def test_the_histogram_of_ages_has_the_parts_of_the_library(talker: Talker, listener: Listener) -> None:
    clock_ns = 20_000 * 10**9
    listener.join(talker, clock_ns=clock_ns)
    bits_of_most = time.monotonic_ns().bit_length() - 2  # no sample is older than the clock; stamps only grow
    for age_ns in (place << bits for bits in reversed(range(bits_of_most)) for place in (3, 2)):
        talker.writer.write_parts([b"x"], stamp_ns=time.monotonic_ns() - age_ns + clock_ns)
        assert listener.take() == [b"x"]
        count, _, most_ns, parts = listener.reader.pop_ages()
        assert (count, most_ns >= age_ns) == (1, True)
        assert parts == (0,) * part_of(most_ns) + (1,), most_ns


def test_refusals(listener: Listener) -> None:
    talker = Talker(4096, 16, keep=3)
    writer = talker.writer
    most = writer._debug()["max_payload"]
    assert most == 4096 // 4 - segments.RING_HEAD_BYTES
    assert writer.write(bytes(most + 1)) == core.TOO_LARGE
    assert writer.write_parts([bytes(most), b"x"]) == core.TOO_LARGE
    assert writer.lend(most + 1) == core.TOO_LARGE
    writer.most = 10
    assert writer.write(bytes(11)) == writer.write_parts([bytes(11)]) == writer.lend(11) == core.TOO_LARGE
    writer.most = 1 << 62
    talker.write(*[bytes(most)] * 4)
    writer.keep = 5
    assert writer.write(bytes(900)) == writer.lend(900) == core.SHORT
    assert writer.write_parts([bytes(900)], force=True) is True
    writer.keep, writer.hold = 1, writer.oldest
    assert writer.write(bytes(900)) == core.FULL
    writer.hold = 0
    talker.write(bytes(900))
    writer.keep, writer.hold = 2, 7
    assert (writer.keep, writer.hold, writer.most) == (2, 7, 1 << 62)
    for name in ("keep", "hold", "most"):
        with pytest.raises(OverflowError):
            setattr(writer, name, -1)


def test_noted_once(talker: Talker) -> None:
    talker.write(b"")
    talker.writer.is_report_due = False
    assert [talker.writer.write(b"") for _ in range(2)] == [core.REPORT_DUE, True]


def test_only_the_thread_that_made_it_writes(talker: Talker) -> None:
    outcomes: list[object] = []
    writer = talker.writer

    def run() -> None:
        outcomes.extend([writer.write(b""), writer.write_parts([b""]), writer.lend(1), writer.publish_lent()])

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert outcomes == [core.WRONG_THREAD] * 4
    assert writer.samples == 0


def test_where_threads_share_it_whoever_holds_the_lock_writes(talker: Talker) -> None:
    outcomes: list[object] = []
    writer, lock = talker.writer, threading.RLock()

    def run() -> None:
        outcomes.append(writer.write(b"x"))
        with lock:
            outcomes.extend([writer.write(b"x"), writer.write_parts([b"x"])])

    writer.is_mine = lock._is_owned  # type: ignore[attr-defined]
    assert writer.write(b"") == core.WRONG_THREAD
    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert outcomes == [core.WRONG_THREAD, True, True]
    writer.is_mine = None
    assert writer.write(b"x") is True
    writer.is_mine = lambda: 1 // 0 == 0
    with pytest.raises(ZeroDivisionError):
        writer.write(b"x")
    assert writer.samples == 3
    writer.is_mine = lock._is_owned  # type: ignore[attr-defined]
    writer.close()
    with lock, pytest.raises(ValueError, match="closed"):
        writer.write(b"x")


def test_nothing_is_written_after_close(talker: Talker, listener: Listener) -> None:
    listener.join(talker)
    talker.write(b"last")
    talker.writer.close()
    talker.writer.close()
    for write in (lambda: talker.writer.write(b""), lambda: talker.writer.lend(1)):
        with pytest.raises(ValueError, match="closed"):
            write()
    assert listener.take() == [b"last"]
    assert listener.reader.pop_left() == []  # the writer may still announce another ring
    listener.reader.finish(1)
    assert [left[:2] for left in listener.reader.pop_left()] == [(1, "")]


def test_a_loan_is_filled_in_place(talker: Talker, listener: Listener) -> None:
    listener.join(talker)
    place = talker.writer.lend(5)
    place[:] = b"hello"
    assert listener.take() == []
    assert talker.writer.publish_lent() is True
    with pytest.raises(ValueError, match="nothing is lent"):
        talker.writer.publish_lent()
    talker.writer.lend(5)
    assert talker.writer.write(b"quickly") is talker.writer.publish("quickly") is False
    assert talker.writer.write_parts([b"between"]) is True
    with pytest.raises(ValueError, match="took the place back"):
        talker.writer.publish_lent()
    assert listener.take() == [b"hello", b"between"]


def test_what_was_published_since(talker: Talker) -> None:
    for stamp in (10, 20, 20, 30):
        assert talker.writer.write_parts([b"%d" % stamp], stamp_ns=stamp) is True
    assert talker.writer.since(20) == [(2, 20, b"20"), (3, 20, b"20"), (4, 30, b"30")]
    assert [talker.writer.seq_since(stamp) for stamp in (0, 10, 11, 30, 31)] == [1, 1, 2, 4, 5]
    assert talker.writer.since(31) == []


# --- the first sample of a reader


@pytest.mark.parametrize(
    ("options", "first"),
    [
        ({"start": 3}, 3),
        ({"start": 9}, 9),
        ({"since_ns": 30}, 3),
        ({"since_ns": 60}, 6),
        ({"since_ns": 60, "history": 2}, 4),
        ({"since_ns": 40, "history": 2}, 2),
        ({"since_ns": 40, "history": 1 << 60}, 1),
        ({}, 1),
    ],
)
def test_the_first_number(talker: Talker, listener: Listener, options: dict[str, int], first: int) -> None:
    for stamp in (10, 20, 30, 40, 50):
        talker.writer.write_parts([b""], stamp_ns=stamp)
    assert listener.reader.attach("it", segments.map_ring(talker.ring), 0, **options) == first
    assert listener.reader.next_seq("it") == first
    assert listener.reader.waiting() == max(0, 6 - first)


def test_a_start_before_the_oldest_is_overrun(listener: Listener) -> None:
    talker = Talker(4096, 16)
    talker.write(*[b"x"] * 100)
    listener.join(talker, start=1)
    assert len(listener.take()) + listener.reader.overrun == 100
    assert listener.reader.overrun == talker.writer.oldest - 1


def test_refused_attachments(talker: Talker, listener: Listener) -> None:
    listener.join(talker)
    memory = segments.map_ring(talker.ring)
    for arguments, reason in (((1, memory, 5), "already"), ((2, memory, 128), "beyond")):
        with pytest.raises(ValueError, match=reason):
            listener.reader.attach(*arguments)
    with pytest.raises(ValueError, match="no ring"):
        listener.reader.attach(2, segments.map_readers(listener.segment), 5)
    with pytest.raises(ValueError, match="out of bounds"):
        listener.reader.attach(2, memory, 5, start=1 << 63)
    with pytest.raises(ValueError, match="not attached"):
        listener.reader.extend(2, memory)
    with pytest.raises(ValueError, match="slot"):
        talker.writer.add_gate(1, listener.bell, 128, is_lossless=False)
    assert listener.readers.is_free(5)
    with pytest.raises(ValueError, match="slot"):
        listener.readers.is_free(128)


# --- several rings, depth, loss


def test_rings_are_merged_by_stamp(listener: Listener) -> None:
    talkers = [Talker() for _ in range(3)]
    for source, end in enumerate(talkers):
        listener.join(end, source)
    for stamp in range(1, 31):
        talkers[stamp * 7 % 3].writer.write_parts([b"%d" % stamp], stamp_ns=stamp)
    assert listener.take(4) + listener.take() == [b"%d" % stamp for stamp in range(1, 31)]


def test_the_depth_is_over_all_rings(listener: Listener) -> None:
    talkers = [Talker(), Talker()]
    for source, end in enumerate(talkers):
        listener.join(end, source)
    for stamp in range(1, 21):
        talkers[stamp % 3 == 0].writer.write_parts([b"%d" % stamp], stamp_ns=stamp)
    listener.reader.depth = 4
    assert listener.reader.waiting() == 4
    assert listener.take() == [b"17", b"18", b"19", b"20"]
    assert (listener.reader.replaced, listener.reader.overrun, listener.reader.samples) == (16, 0, 4)


def test_the_most_missed_in_a_row(listener: Listener) -> None:
    talker, other = Talker(), Talker()
    listener.join(talker, 0)
    listener.join(other, 1)
    listener.reader.depth = 4

    def stand_still(count: int, end: Talker = talker) -> int:
        for _ in range(count):
            end.write(b"x")
            listener.reader.waiting()  # counts at once, as a report does
        listener.take()
        return listener.reader.most_missed

    assert [stand_still(count) for count in (4, 7, 5, 9, 6)] == [0, 3, 3, 5, 5]
    assert stand_still(12, other) == 8
    listener.reader.detach(1)
    assert (listener.reader.most_missed, listener.reader.replaced) == (8, 3 + 1 + 5 + 2 + 8)


def test_expected_is_what_the_numbers_say(listener: Listener) -> None:
    """All samples are expected: taken, lapped, passed over, expired, waiting, or in a ring that the reader
    left.
    """
    talker, stale = Talker(4096, 16, keep=4), Talker()
    listener.join(talker, "lapped", gate=False, start=1)
    listener.join(stale, "stale", lifespan_ns=1)
    talker.write(*[b"x"] * 100)
    stale.write(b"1", b"2")
    listener.reader.depth = 9
    reader = listener.reader
    assert len(listener.take(2)) == 2
    talker.write(b"y", b"z")

    def accounted() -> int:
        lost = reader.replaced + reader.overrun + reader.expired + reader.undecodable
        return int(reader.samples + lost + reader.waiting())

    assert reader.expected == accounted() == 104
    reader.detach("lapped")
    assert reader.expected == accounted() < 104, "what waited there will never be taken"
    reader.finish("stale")
    assert reader.expected == accounted()


def test_another_depth_leaves_history_its_room(talker: Talker, listener: Listener) -> None:
    talker.write(b"1", b"2")
    listener.reader.depth = 3
    listener.join(talker, history=2, since_ns=1 << 62)
    talker.write(b"3", b"4", b"5")
    listener.reader.depth = 3
    assert listener.reader.waiting() == 5
    assert (len(listener.take()), listener.reader.replaced) == (5, 0)


def test_expired_samples(talker: Talker, listener: Listener) -> None:
    listener.join(talker, lifespan_ns=3600 * 10**9)
    now = time.monotonic_ns()
    for age_ns in (7200 * 10**9, 3601 * 10**9, 0):
        if now > age_ns:
            talker.writer.write_parts([b"%d" % age_ns], stamp_ns=now - age_ns)
    expected = sum(now > age_ns for age_ns in (7200 * 10**9, 3601 * 10**9))
    assert listener.take() == [b"0"]
    assert listener.reader.expired == expected
    listener.reader.detach(1)
    listener.join(talker, lifespan_ns=1, start=1)
    assert listener.take() == []
    assert listener.reader.expired == expected + talker.writer.latest


@pytest.mark.parametrize("ahead_s", [-10_000, 10_000])
def test_a_clock_that_is_ahead_or_behind(talker: Talker, listener: Listener, ahead_s: int) -> None:
    clock_ns, hour_ns = ahead_s * 10**9, 3600 * 10**9
    now = time.monotonic_ns() + 20_000 * 10**9  # so late that no stamp is below 0 with either clock
    for age_ns in (1000, 100, 0):
        talker.writer.write_parts([b"%d" % age_ns], stamp_ns=now - age_ns + clock_ns)
    listener.join(talker, clock_ns=clock_ns, since_ns=now, history=1, lifespan_ns=hour_ns)
    assert listener.take() == [b"100", b"0"]
    talker.writer.write_parts([b"new"], stamp_ns=time.monotonic_ns() + 20_000 * 10**9 + clock_ns)
    assert [stamp_ns for _, stamp_ns, *_ in listener.reader.take(9, bytes)] > [now + clock_ns]
    assert listener.reader.pop_ages()[2] == 0 and listener.reader.expired == 0


def test_ages_and_lifespans_go_by_one_clock(talker: Talker, listener: Listener) -> None:
    clock_ns = 10_000 * 10**9
    listener.join(talker, clock_ns=clock_ns, lifespan_ns=10**9)
    now = time.monotonic_ns()
    talker.writer.write_parts([b"old"], stamp_ns=now - 2 * 10**9 + clock_ns)
    talker.writer.write_parts([b"new"], stamp_ns=now + clock_ns)
    assert listener.take() == [b"new"]
    count, _, most_ns, _ = listener.reader.pop_ages()
    assert (count, listener.reader.expired) == (1, 1) and 0 < most_ns < 10**9


def test_what_does_not_decode(talker: Talker, listener: Listener) -> None:
    listener.join(talker)
    talker.write(*[b"bad"] * 100, b"7")
    assert listener.reader.messages(200, int) == [7]
    assert (listener.reader.undecodable, listener.reader.samples) == (100, 1)
    rejected = listener.reader.pop_rejected()
    assert len(rejected) == 64
    assert rejected[0][0] == 3
    assert isinstance(rejected[0][1], ValueError)
    assert listener.reader.pop_rejected() == []


def test_an_interrupt_goes_through(talker: Talker, listener: Listener) -> None:
    listener.join(talker)
    talker.write(b"one", b"two")

    def interrupt(_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        listener.reader.messages(1, interrupt)
    assert listener.reader.pop_interrupted() == []
    assert listener.take() == [b"two"]
    assert (listener.reader.samples, listener.reader.undecodable) == (1, 1)


def test_messages_decoded_before_an_interrupt_are_kept(talker: Talker, listener: Listener) -> None:
    listener.join(talker)
    talker.write(b"1", b"22", b"no", b"4")

    def decode(payload: bytes) -> int:
        if payload == b"no":
            raise KeyboardInterrupt
        return int(payload)

    with pytest.raises(KeyboardInterrupt):
        listener.reader.messages(10, decode)
    assert listener.reader.pop_interrupted() == [1, 22]
    assert listener.reader.pop_interrupted() == []
    assert [message for message, *_ in listener.reader.take(10, decode)] == [4]
    assert (listener.reader.samples, listener.reader.bytes, listener.reader.undecodable) == (3, 4, 1)


@pytest.mark.parametrize("size", [1, LARGE])
def test_decode_may_use_the_reader(talker: Talker, listener: Listener, size: int) -> None:
    other = Talker()
    listener.join(talker, "gone")
    listener.join(other, "other")
    talker.write(*[b"x" * size] * 3)
    other.write(b"y")

    def decode(payload: Any) -> Any:
        listener.reader.detach("gone")
        return [bytes(payload), *listener.reader.messages(5, bytes)]

    assert listener.reader.take(9, decode)[0][0] == [b"x" * size, b"y"]
    assert listener.take() == []


# --- leaving


def test_a_finished_ring_is_taken_to_where_it_ended(talker: Talker, listener: Listener) -> None:
    listener.join(talker)
    talker.write(b"one", b"two")
    listener.reader.finish(1)
    talker.write(b"too late")
    assert listener.reader.pop_left() == []
    assert listener.take() == [b"one", b"two"]
    assert listener.take() == []
    assert [left[:2] for left in listener.reader.pop_left()] == [(1, "")]
    listener.reader.finish(1)
    listener.reader.detach(1)


def test_finished_rings_are_bounded(listener: Listener) -> None:
    talkers = [Talker(4096, 16) for _ in range(70)]
    for source, end in enumerate(talkers):
        listener.join(end, source)
        end.write(b"%d" % source)
        listener.reader.finish(source)
    assert [left[:2] for left in listener.reader.pop_left()] == [(source, "") for source in range(6)]
    assert listener.take() == [b"%d" % source for source in range(6, 70)]
    assert listener.reader.replaced == 6


# --- no leaks


def test_a_cycle_through_a_reader_is_collected(talker: Talker) -> None:
    listener = Listener()
    listener.join(talker, source=listener)
    talker.write(b"bad")
    listener.reader.messages(1, int)
    ref = weakref.ref(listener)
    del listener
    gc.collect()
    assert ref() is None


def test_nothing_is_left_of_many_rounds(talker: Talker, listener: Listener) -> None:
    source, payload = object(), b"z" * 100

    def refuse(_: object) -> None:
        raise ValueError

    def rounds(decode: Callable[[Any], Any]) -> None:
        for _ in range(300):
            slot = next(listener.slots, None) or 1
            listener.reader.attach(source, segments.map_ring(talker.ring), slot, since_ns=1 << 62)
            talker.writer.add_gate(1, listener.bell, slot, is_lossless=False)
            talker.write(payload, bytes(LARGE), payload)
            talker.writer.write_parts([payload, payload])
            listener.reader.take(9, decode)
            listener.readers.deliver(False)
            listener.reader.pop_rejected()
            listener.reader.extend(source, segments.map_ring(talker.ring))
            listener.reader.detach(source)
            talker.writer.remove_gate(1)

    counts = []
    for decode in (bytes, refuse, bytes, refuse):
        rounds(decode)
        gc.collect()
        counts.append((sys.getallocatedblocks(), sys.getrefcount(source), sys.getrefcount(payload)))
    assert counts[3][1:] == counts[1][1:] == counts[0][1:]
    assert counts[3][0] - counts[1][0] < 100


class TestHold:
    """Messages of a held publisher stay in its ring, and the writer finds no room."""

    @pytest.fixture
    def ends(self) -> Iterator[tuple[Talker, Talker, Listener]]:
        """The held publisher, another publisher, and a reader of both."""
        held, other, listener = Talker(4096, 64), Talker(4096, 64), Listener(tells_cursor=True)
        listener.join(held, 1, start=1)
        listener.join(other, 2, start=1)
        listener.reader.hold(1, True)
        yield held, other, listener
        for end in (held, other, listener):
            end.close()

    def test_others_are_taken(self, ends: tuple[Talker, Talker, Listener]) -> None:
        held, other, listener = ends
        held.write(b"a", b"b")
        other.write(b"c")
        assert listener.take() == [b"c"] and listener.take() == []
        assert listener.reader.waiting() == 2
        other.write(b"d")
        found = listener.reader.take_packed(1000, 500, 0)
        assert found is not None and found[0] == 2 and found[-1] is False  # no other message may be taken
        other.write(b"e")
        found = listener.reader.take_merged(1000, 500, 0)
        assert found is not None and (found[0], found[2]) == (2, 1)
        listener.reader.hold(1, False)
        assert listener.take() == [b"a", b"b"]

    def test_its_writer_waits(self, ends: tuple[Talker, Talker, Listener]) -> None:
        held, other, listener = ends
        for end, status in ((held, core.FULL), (other, True)):
            while (last := end.writer.write(bytes(500))) is True:
                pass
            assert last == core.FULL
            listener.take()
            assert end.writer.write(bytes(500)) == status
        listener.reader.hold(1, False)
        listener.take()
        assert held.writer.write(bytes(500)) is True

    def test_it_is_taken_all_the_same_where_the_reader_says_so(
        self, ends: tuple[Talker, Talker, Listener]
    ) -> None:
        held, _, listener = ends
        held.write(b"a")
        listener.reader.takes_held = True
        assert listener.take() == [b"a"]
        listener.reader.takes_held = False
        held.write(b"b")
        assert listener.take() == []

    def test_a_publisher_that_has_gone_stays_until_what_is_held_was_taken(
        self, ends: tuple[Talker, Talker, Listener]
    ) -> None:
        held, _, listener = ends
        held.write(b"a")
        listener.reader.finish(1)
        assert listener.take() == [] and listener.reader.pop_left() == []
        listener.reader.hold(1, False)
        assert listener.take() == [b"a"] and listener.take() == []
        assert [source for source, *_ in listener.reader.pop_left()] == [1]

    def test_nothing_happens_where_nobody_is_read(self, listener: Listener) -> None:
        listener.reader.hold(7, True)
        with pytest.raises(TypeError):
            listener.reader.hold(7)  # type: ignore[call-arg]
