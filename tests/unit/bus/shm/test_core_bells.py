"""bus.shm._core: wake-ups: news, sleep, doorbells, room for a lossless writer, growth."""

import threading

import pytest

from bus.shm import segments
from shm_ends import Listener, Talker, core, is_rung, listener, talker

__all__ = ["listener", "talker"]


def test_a_sleeper_is_rung_once(talker: Talker, listener: Listener) -> None:
    listener.join(talker)
    assert listener.readers.sleep() == []
    talker.write(b"1", b"2", b"3")
    assert talker.writer._debug()["rung"] == 1
    assert is_rung(listener.doorbell)
    assert listener.readers.deliver(False) == [listener]
    talker.write(b"4")
    assert talker.writer._debug()["rung"] == 1
    assert not is_rung(listener.doorbell)


def test_all_writers_of_a_process_ring_once(listener: Listener) -> None:
    talkers = [Talker(), Talker()]
    for source, end in enumerate(talkers):
        listener.join(end, source)
    listener.readers.sleep()
    for end in talkers:
        end.write(b"x")
    assert [talker.writer._debug()["rung"] for talker in talkers] == [1, 0]
    assert listener.readers.deliver(False) == [listener]


def test_one_bell_for_many_matches_of_a_process(talker: Talker, listener: Listener) -> None:
    others = [core.Reader(listener.readers, name, 0, tells_cursor=False) for name in ("a", "b")]
    listener.join(talker)
    for key, reader in enumerate(others):
        slot = next(listener.slots)
        reader.attach(1, segments.map_ring(talker.ring), slot)
        talker.writer.add_gate(key, listener.bell, slot, is_lossless=False)
    assert listener.readers.sleep() == []
    talker.write(b"x")
    assert talker.writer._debug()["rung"] == 1
    assert sorted(map(str, listener.readers.deliver(False))) == sorted(map(str, [listener, "a", "b"]))
    for key in (0, 1, id(listener), 99):
        talker.writer.remove_gate(key)
    listener.readers.sleep()
    talker.write(b"y")
    assert talker.writer._debug()["rung"] == 1


def test_news_is_told_once_and_only_while_it_waits(talker: Talker, listener: Listener) -> None:
    talker.write(b"before")
    listener.join(talker, since_ns=0)
    assert listener.readers.sleep() == [listener]  # attach found these news
    assert listener.readers.sleep() == []
    talker.write(b"a")
    assert listener.take() == [b"before", b"a"]
    assert listener.readers.deliver(False) == []
    talker.write(b"b")
    assert listener.readers.look(0) == [listener]
    assert listener.readers.look(1000) is None
    talker.write(b"c")
    assert len(listener.take(1)) == 1
    assert listener.readers.sleep() == [listener]


def test_a_reader_of_several_rings_is_told_once(listener: Listener) -> None:
    talkers = [Talker() for _ in range(3)]
    for source, end in enumerate(talkers):
        listener.join(end, source)
        end.write(b"x")
    assert listener.readers.deliver(False) == [listener]
    assert listener.readers.deliver(False) == []
    assert listener.take() == [b"x", b"x", b"x"]


def test_of_many_rings_those_with_news_are_found_also_when_others_have_left(listener: Listener) -> None:
    talkers = [Talker() for _ in range(50)]
    readers = [core.Reader(listener.readers, number, 0, tells_cursor=False) for number in range(50)]
    for end, reader in zip(talkers, readers, strict=True):
        reader.attach("source", segments.map_ring(end.ring), next(listener.slots))
    assert listener.readers.sleep() == []
    for reader in readers[::3]:
        reader.detach("source")
    del reader, readers[1::3]  # deleted readers have left, too
    for end in talkers:
        end.write(b"x")
    assert sorted(listener.readers.deliver(False)) == list(range(2, 50, 3))
    assert listener.readers.sleep() == []


def test_a_new_gate_rings_a_sleeper_that_it_missed(talker: Talker, listener: Listener) -> None:
    slot = listener.join(talker, gate=False)
    assert listener.readers.sleep() == []
    talker.write(b"unheard")
    assert not is_rung(listener.doorbell)
    talker.writer.add_gate(1, listener.bell, slot, is_lossless=False)
    assert listener.readers.deliver(False) == [listener]


@pytest.mark.parametrize("busy", ["sleep", "look"])
def test_a_spin_ends_with_news(talker: Talker, listener: Listener, busy: str) -> None:
    """The other thread runs while this one spins, although the spin never blocks."""
    listener.join(talker)
    writing = threading.Event()

    def write() -> None:
        writer = Talker()
        listener.join(writer, "late")
        writer.write(b"x")
        writing.set()

    thread = threading.Thread(target=write)
    thread.start()
    found = getattr(listener.readers, busy)(10**10)
    thread.join()
    assert found == [listener]
    assert writing.is_set()
    assert not is_rung(listener.doorbell)


# --- lossless


def test_room_is_waited_for_and_rung() -> None:
    talker, listener = Talker(4096, 16), Listener(tells_cursor=True)
    listener.join(talker, start=1)
    writer = talker.writer
    assert writer._debug()["lossless"] == 1
    written = 0
    while writer.write(b"x") is True:
        written += 1
    assert written == 16
    assert writer.write_parts([b"x"], force=True) == core.FULL
    assert writer._debug()["taken"] == 1
    assert writer.wait_for_room()
    listener.take(1)
    assert not is_rung(talker.doorbell)
    listener.take(10)
    assert writer._debug()["taken"] == 12
    assert is_rung(talker.doorbell)
    writer.woken()
    assert writer.write(b"x") is True
    assert writer.wait_for_room()  # half of it must be taken first
    listener.take()
    assert not writer.wait_for_room()
    writer.make_lossy(id(listener))
    assert writer._debug()["lossless"] == 0
    assert writer._debug()["taken"] == writer.latest + 1
    while writer.latest < 100:
        talker.write(b"x")


def test_hold_is_like_a_reader_but_is_none() -> None:
    talker = Talker(4096, 16)
    talker.writer.hold = 3
    while talker.writer.write(b"x") is True:
        pass
    assert talker.writer.latest == 18
    assert talker.writer._debug()["taken"] == 19
    assert talker.writer.wait_for_room()
    talker.writer.hold = 4
    assert [talker.writer.write(b"x") for _ in range(2)] == [True, core.FULL]
    talker.writer.hold = 1  # back; a reader's cursor never moves like this
    assert talker.writer.write(b"x") == core.FULL
    talker.writer.hold = 0
    talker.write(b"x")


# --- growth


def test_order_is_kept_over_growth(listener: Listener) -> None:
    """The reader falls behind, so several rings wait for it, and it loses some samples."""
    talker = Talker(4096, 16, keep=10)
    listener.join(talker, since_ns=0)
    payloads = [b"%d," % number * number for number in range(1, 401)]
    taken: list[bytes] = []
    for number, payload in enumerate(payloads):
        while (status := talker.writer.write(payload)) is not True:
            assert status in (core.SHORT, core.TOO_LARGE)
            listener.reader.extend(1, segments.map_ring(talker.grow(talker.writer.capacity * 2, 64)))
        if number % 7 == 0:
            taken += listener.take(5)
    taken += listener.take()
    assert talker.writer.capacity == 1 << 15
    numbers = [int(payload.split(b",")[0]) for payload in taken]
    assert numbers == sorted(set(numbers))
    assert taken == [payloads[number - 1] for number in numbers]
    assert numbers[-10:] == list(range(391, 401))
    assert len(taken) + listener.reader.overrun == 400
    assert listener.reader.pop_left() == []


def test_growth_loses_nothing_of_a_lossless_match() -> None:
    """The writer fills three rings before the reader takes a sample."""
    talker, listener = Talker(4096, 16), Listener(tells_cursor=True)
    listener.join(talker, start=1)
    for number in range(100):
        while talker.writer.write(b"%d" % number) is not True:
            ring = talker.grow(talker.writer.capacity * 2, talker.writer._debug()["index_length"] * 2)
            listener.reader.extend(1, segments.map_ring(ring))
    assert talker.writer._debug()["index_length"] == 128
    assert listener.reader.waiting() == 100
    assert listener.take() == [b"%d" % number for number in range(100)]
    assert talker.writer._debug()["taken"] == 101


def test_the_depth_counts_over_growth(talker: Talker) -> None:
    listener = Listener(depth=3)
    listener.join(talker)
    talker.write(*[b"%d" % number for number in range(10)])
    listener.reader.extend(1, segments.map_ring(talker.grow(1 << 17)))
    talker.write(b"10", b"11")
    assert listener.reader.waiting() == 3
    assert listener.take() == [b"9", b"10", b"11"]
    assert listener.reader.replaced == 9


def test_a_writer_that_waits_in_its_new_ring_is_rung() -> None:
    """The reader reports its cursor in the old ring, and learns of the new ring only afterwards."""
    talker, listener = Talker(4096, 16), Listener(tells_cursor=True)
    listener.join(talker, start=1)
    talker.write(*[b"x"] * 16)
    ring = talker.grow(4096, 32)
    talker.write(*[b"y"] * 16)
    assert talker.writer.write(b"z") == core.FULL
    assert talker.writer.wait_for_room()
    assert len(listener.take()) == 16
    assert not is_rung(talker.doorbell)
    assert listener.readers.sleep() == []
    listener.reader.extend(1, segments.map_ring(ring))
    assert listener.readers.sleep() == [listener]
    assert len(listener.take(1)) == 1
    assert is_rung(talker.doorbell)
    assert talker.writer.write(b"z") is True


def test_growth_that_does_not_fit_changes_nothing(talker: Talker, listener: Listener) -> None:
    listener.join(talker)
    talker.write(*[bytes(1000)] * 20)
    first_seq = talker.writer.carry_from(1 << 60)
    _, small = segments.make_ring(4096, 16, first_seq)
    _, ahead = segments.make_ring(1 << 18, 512, 22)
    _, behind = segments.make_ring(1 << 18, 512, 100)
    for memory, reason in ((small, "too small"), (ahead, "begin"), (behind, "begin")):
        with pytest.raises(ValueError, match=reason):
            talker.writer.move(memory)
    assert talker.writer.capacity == 1 << 18
    assert [talker.writer.carry_from(count) for count in (0, 5, 100)] == [21, 16, 1]
    talker.write(b"still here")
    assert listener.take()[-1] == b"still here"


def test_the_rings_that_wait_are_bounded(talker: Talker, listener: Listener) -> None:
    listener.join(talker)
    memory = segments.map_ring(talker.ring)
    with pytest.raises(ValueError, match="too many"):
        for _ in range(100):
            listener.reader.extend(1, memory)
    assert listener.take() == []
    talker.write(b"x")
    assert listener.take() == [b"x"]  # the reader stays in the first ring, which is not closed


def test_who_fell_asleep_before_its_gate_came_is_rung_by_that(talker: Talker, listener: Listener) -> None:
    slot = listener.join(talker, gate=False)
    assert listener.readers.sleep() == []
    talker.write(b"x")
    assert not is_rung(listener.doorbell)
    talker.writer.add_gate(1, listener.bell, slot, is_lossless=False)
    assert is_rung(listener.doorbell)


def test_what_was_knocked_for_one_slot_does_not_stand_for_another(listener: Listener) -> None:
    talkers = [Talker() for _ in range(20)]  # with so many rings, a knock is for one slot only
    for source, end in enumerate(talkers):
        listener.join(end, source)
    assert listener.readers.sleep() == []
    talker = talkers[0]
    talker.write(b"x")
    assert talker.writer._debug()["rung"] == 1
    talker.writer.remove_gate(id(listener))
    talker.writer.add_gate(1, listener.bell, 100, is_lossless=False)
    assert talker.writer._debug()["rung"] == 2
    for end in talkers:
        end.close()


def test_no_more_than_some_rings_may_wait_behind_one(talker: Talker, listener: Listener) -> None:
    listener.join(talker)
    for _ in range(64):
        listener.reader.extend(1, segments.map_ring(talker.ring))
    with pytest.raises(ValueError, match="too many rings wait"):
        listener.reader.extend(1, segments.map_ring(talker.ring))
