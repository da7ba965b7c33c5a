"""bus.shm._core: many samples in one buffer, taken from rings and written into them."""

import mmap
import time
from pathlib import Path
from struct import Struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus.wire.source_time import source_head
from shm_ends import Listener, Talker, core, is_rung, listener, talker

__all__ = ["listener", "talker"]

_HEAD = Struct("<QqI")
_OFFSET_NS = 10**18


def unpack(data: bytes) -> list[tuple[int, int, bytes]]:
    at, found = 0, []
    while at < len(data):
        number, time_ns, size = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        found.append((number, time_ns, data[at : at + size]))
        at += size
    assert at == len(data)
    return found


def pack(*messages: tuple[int, bytes]) -> bytes:
    """Pack messages, each given by its time and payload."""
    return b"".join(
        _HEAD.pack(number, time_ns, len(payload)) + payload
        for number, (time_ns, payload) in enumerate(messages, 1)
    )


def packs(listener: Listener, most: int = 1000, longest: int = 200) -> list[Any]:
    found = []
    while (one := listener.reader.take_packed(most, longest, _OFFSET_NS)) is not None:
        found.append(one)
    return found


def both() -> tuple[Talker, Listener, Listener]:
    """A publisher, and two listeners with the same options."""
    talker, ends = Talker(1 << 20, 4096, keep=1000), (Listener(), Listener())
    for one in ends:
        one.join(talker, start=1)
    return talker, *ends


class TestTaking:
    @settings(max_examples=50, deadline=None)
    @given(
        st.lists(st.tuples(st.integers(0, 300), st.sampled_from([0, 5, 10**18])), max_size=30),
        st.integers(1, 1000),
    )
    def test_as_take_does_it(self, messages: list[tuple[int, int]], most: int) -> None:
        talker, one, other = both()
        for size, time_ns in messages:
            head = source_head(time_ns) if time_ns else b""
            talker.write(head + bytes(size))
        expected = [
            (seq, stamp_ns + _OFFSET_NS if stamp_ns > 0 else -stamp_ns, payload)
            for payload, stamp_ns, seq, *_ in one.reader.take(1000, bytes)
        ]
        found: list[tuple[int, int, bytes]] = []
        while len(found) < len(messages):
            for source, data, count, size, last_at, is_consecutive, has_more in packs(other, most):
                samples = unpack(data)
                assert source == 1 and len(data) <= most and is_consecutive
                assert count == len(samples) and size == sum(len(payload) for *_, payload in samples)
                assert data[last_at:] == _HEAD.pack(*samples[-1][:2], len(samples[-1][2])) + samples[-1][2]
                found += samples
                assert has_more is (len(found) < len(messages))
            for payload, stamp_ns, seq, *_ in other.reader.take(1, bytes):  # too long for a pack
                assert len(payload) + 16 >= 200 or len(payload) + 36 > most
                found.append((seq, stamp_ns + _OFFSET_NS if stamp_ns > 0 else -stamp_ns, payload))
        assert found == expected
        assert (one.reader.samples, one.reader.bytes) == (other.reader.samples, other.reader.bytes)
        for end in (talker, one, other):
            end.close()

    def test_those_of_one_publisher_at_a_time(self, talker: Talker, listener: Listener) -> None:
        second = Talker()
        listener.join(talker, 1)
        listener.join(second, 2)
        for number in range(3):
            second.write(b"b%d" % number)
            talker.write(b"a%d" % number)
        found = packs(listener)
        assert [(source, [payload for *_, payload in unpack(data)]) for source, data, *_ in found] == [
            (2, [b"b0", b"b1", b"b2"]),
            (1, [b"a0", b"a1", b"a2"]),
        ]
        second.close()

    @settings(max_examples=50, deadline=None)
    @given(
        st.lists(st.tuples(st.integers(0, 2), st.integers(0, 220)), min_size=1, max_size=40),
        st.integers(1, 2000),
        st.integers(0, 3),
    )
    def test_merged_as_take_does_it(self, messages: list[tuple[int, int]], most: int, depth: int) -> None:
        talkers = [Talker(1 << 20, 4096, keep=1000) for _ in range(3)]
        one, other = Listener(depth * 7), Listener(depth * 7)
        for end in (one, other):
            for number, writing in enumerate(talkers):
                end.join(writing, number, start=1)
        for source, size in messages:
            talkers[source].write(bytes([source]) * size)
        expected = [
            (source, seq, stamp_ns + _OFFSET_NS, payload)
            for payload, stamp_ns, seq, source, _ in one.reader.take(1000, bytes)
        ]
        done = 0
        while other.reader.waiting():
            pack = other.reader.take_merged(most, 200, _OFFSET_NS)
            if pack is None:
                ((payload, stamp_ns, seq, source, _),) = other.reader.take(1, bytes)
                assert len(payload) >= 200 or len(payload) + 20 > most
                assert expected[done] == (source, seq, stamp_ns + _OFFSET_NS, payload)
                done += 1
                continue
            origin, data, count, size, last_at, is_consecutive, has_more = pack
            samples, wanted = unpack(data), expected[done : done + count]
            done += count
            assert samples == [sample[1:] for sample in wanted]
            assert len(data) <= most and size == len(data) - 20 * count
            assert last_at == len(data) - 20 - len(samples[-1][2])
            sources = {source for source, *_ in wanted}
            assert origin == (sources.pop() if len(sources) == 1 else None)
            numbers = [seq for seq, *_ in samples]
            follow = numbers == [*range(numbers[0], numbers[0] + count)]
            assert is_consecutive is (follow and origin is not None)
            assert has_more is (other.reader.waiting() > 0)
        assert done == len(expected)
        assert one.reader.samples == other.reader.samples == done
        assert (one.reader.bytes, one.reader.replaced) == (other.reader.bytes, other.reader.replaced)
        for writing in talkers:
            writing.close()
        one.close()
        other.close()

    def test_what_the_depth_passes_over_is_counted(self, talker: Talker) -> None:
        listener = Listener(3)
        listener.join(talker)
        talker.write(*[b"x"] * 10)
        ((_, data, *_),) = packs(listener)
        assert [number for number, *_ in unpack(data)] == [8, 9, 10]
        assert listener.reader.replaced == 7
        listener.close()

    def test_what_was_overrun_is_not_consecutive_any_more(self, listener: Listener) -> None:
        talker = Talker(4096, 16, keep=1)
        listener.join(talker)
        talker.write(*[bytes(100)] * 100)
        ((_, data, count, *_),) = packs(listener, 10_000)
        assert count + listener.reader.overrun == 100
        assert unpack(data)[-1][0] == 100
        talker.close()

    def test_what_has_expired_is_left_out(self, talker: Talker, listener: Listener) -> None:
        listener.join(talker, lifespan_ns=1)
        talker.write(b"old", b"older")
        time.sleep(0.000_01)
        assert packs(listener) == [] and listener.reader.expired == 2

    def test_times_are_by_our_clock(self, talker: Talker, listener: Listener) -> None:
        clock_ns = 10_000 * 10**9
        listener.join(talker, clock_ns=clock_ns)
        now = time.monotonic_ns()
        talker.writer.write_parts([b"one"], stamp_ns=now + clock_ns)
        ((_, data, *_),) = packs(listener)
        assert unpack(data) == [(1, now + _OFFSET_NS, b"one")]

    def test_wrong_arguments(self, listener: Listener) -> None:
        with pytest.raises(TypeError):
            listener.reader.take_packed(1000)  # type: ignore[call-arg]
        with pytest.raises(TypeError):
            listener.reader.take_merged(1000, 1)  # type: ignore[call-arg]
        with pytest.raises((OverflowError, TypeError)):
            listener.reader.take_packed(-1, 10, 0)


class TestPublishing:
    @settings(max_examples=50, deadline=None)
    @given(
        st.lists(
            st.tuples(st.sampled_from([-1, 0, 1, 10**18, 2**63 - 1]), st.binary(max_size=100)), max_size=30
        ),
        st.integers(0, 30),
    )
    def test_as_one_by_one(self, messages: list[tuple[int, bytes]], first: int) -> None:
        one, other = Talker(1 << 20, 4096), Talker(1 << 20, 4096)
        near, far = Listener(), Listener()
        near.join(one)
        far.join(other)
        messages, gone = messages[first:], messages[:first]
        for time_ns, payload in messages:
            one.write((source_head(time_ns) if time_ns > 0 else b"") + payload)
        data = pack(*gone, *messages)
        assert other.writer.publish_packed(data, len(pack(*gone)))[0] == len(messages)
        assert (one.writer.samples, one.writer.bytes) == (other.writer.samples, other.writer.bytes)

        def taken(end: Listener) -> list[Any]:
            return [(payload, min(stamp, 0), seq) for payload, stamp, seq, *_ in end.reader.take(100, bytes)]

        assert taken(near) == taken(far)
        for end in (one, other, near, far):
            end.close()

    def test_readers_are_woken_once(self, talker: Talker, listener: Listener) -> None:
        listener.join(talker)
        listener.readers.sleep(0)
        rung = talker.writer._debug()["rung"]
        assert talker.writer.publish_packed(pack((1, b"a"), (1, b"b")), 0)[0] == 2
        assert is_rung(listener.doorbell) and talker.writer._debug()["rung"] == rung + 1
        assert talker.writer.publish_packed(b"", 0) == (0, False)
        assert not is_rung(listener.doorbell)

    def test_long_ones_too(self, listener: Listener) -> None:
        talker = Talker(1 << 20, 64)
        listener.join(talker)
        sent = [bytes([number]) * 100_000 for number in range(3)]
        assert talker.writer.publish_packed(pack(*[(1, one) for one in sent]), 0)[0] == 3
        ((_, data, *_),) = packs(listener, 310_000, 310_000)
        assert [payload for *_, payload in unpack(data)] == sent
        talker.close()

    def test_a_report_is_asked_for_once(self, talker: Talker) -> None:
        talker.writer.is_report_due = False
        assert talker.writer.publish_packed(b"", 0) == (0, False)
        assert talker.writer.publish_packed(pack((1, b"a")), 0) == (1, True)
        assert talker.writer.publish_packed(pack((1, b"a")), 0) == (1, False)

    def test_it_ends_before_what_is_not_simple(self, listener: Listener) -> None:
        talker = Talker(4096, 16, keep=3)
        writer, most = talker.writer, talker.writer._debug()["max_payload"]
        data = pack((0, b"a"), (1, bytes(most - 15)), (0, b"b"))
        assert writer.publish_packed(data, 0)[0] == 1
        writer.most = 10
        assert writer.publish_packed(pack((0, bytes(10)), (1, b""), (0, b"")), 0)[0] == 1
        writer.most = 1 << 62
        writer.hold = writer.oldest
        assert 0 < writer.publish_packed(pack(*[(0, bytes(500))] * 20), 0)[0] < 20
        writer.hold = 0
        place = writer.lend(10)
        assert writer.publish_packed(data, 0) == (0, False)
        del place
        writer.close()
        with pytest.raises(ValueError, match="closed"):
            writer.publish_packed(data, 0)
        talker.close()

    def test_what_is_cut_off_is_not_published(self, talker: Talker) -> None:
        data = pack((0, b"abc"), (0, b"def"))
        assert talker.writer.publish_packed(data[:-1], 0)[0] == 1
        assert talker.writer.publish_packed(data[:19], 0)[0] == 0
        with pytest.raises(ValueError, match="behind the end"):
            talker.writer.publish_packed(data, len(data) + 1)
        with pytest.raises(TypeError):
            core.Writer.publish_packed(talker.writer, data)


def test_a_record_of_nearly_4_gib_is_stepped_over(tmp_path: Path) -> None:
    last, path = _HEAD.pack(2, 0, 5) + b"later", tmp_path / "pack"
    with path.open("wb") as file:  # a sparse file: only both ends have data
        file.write(_HEAD.pack(1, 0, (1 << 32) - _HEAD.size))
        file.seek(1 << 32)
        file.write(last)
    with path.open("rb") as whole, mmap.mmap(whole.fileno(), 0, access=mmap.ACCESS_READ) as data:
        found = core.scan_packed(data, 0, 9)
    assert found == (2, (1 << 32) + len(last), (1 << 32) - _HEAD.size + 5, 2, 1 << 32, True)
