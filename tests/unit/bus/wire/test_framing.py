"""bus.wire.framing: frames cut from bytes in any pieces, and refused bytes."""

import ctypes
import subprocess
import sys
from collections.abc import Iterable
from typing import cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus.errors import RemoteProtocolError
from bus.wire.framing import BUFFER_BYTES, FrameReader
from bus.wire.layout import (
    CONTROL,
    DATA,
    DATA_HEAD,
    DATA_HEAD_BYTES,
    FRAME_HEAD,
    FRAME_HEAD_BYTES,
    LENGTH_BYTES,
    MAX_COUNT,
    REPLAY,
    RESUMED,
)
from bus.wire.runs import Account, Run
from effort import examples
from feeding import feed, frame_record
from rows import for_each

MAX_CONTROL = 4 << 20
MAX_DATA = 16 << 20


def reader(*, max_control: int = MAX_CONTROL, max_data: int = MAX_DATA) -> FrameReader:
    return FrameReader(max_control_bytes=max_control, max_data_bytes=max_data)


def control(body: bytes) -> bytes:
    return FRAME_HEAD.pack(FRAME_HEAD_BYTES - LENGTH_BYTES + len(body), CONTROL, 0, 0) + body


def data(body: bytes, *, count: int = 1, first_seq: int = 1, flags: int = 0, zero: int = 0) -> bytes:
    length = DATA_HEAD_BYTES - LENGTH_BYTES + len(body)
    return DATA_HEAD.pack(length, DATA, flags, zero, 7, 8, first_seq, count, 0) + body


def record(size: int) -> bytes:
    return frame_record(bytes(size), 5)


def values(items: Iterable[bytes | Run]) -> list[bytes | tuple[object, ...]]:
    return [
        item
        if isinstance(item, bytes)
        else (item.endpoint, item.source, item.first_seq, item.count, bytes(item.body), item.is_replay)
        for item in items
    ]


def refusal(frame: bytes, **limits: int) -> str:
    with pytest.raises(RemoteProtocolError) as caught:
        list(feed(reader(**limits), frame))
    return str(caught.value)


class TestWhatComesOut:
    def test_a_control_body(self) -> None:
        assert values(feed(reader(), control(b"abc"))) == [b"abc"]

    def test_an_empty_control_body(self) -> None:
        assert values(feed(reader(), control(b""))) == [b""]

    def test_a_run(self) -> None:
        body = frame_record(b"one", 5) + frame_record(b"", 6)
        frame = data(body, count=2, first_seq=9, flags=REPLAY)
        assert values(feed(reader(), frame)) == [(7, 8, 9, 2, body, True)]

    @for_each("size", [0, BUFFER_BYTES])
    @for_each("flags", [0, REPLAY, RESUMED, REPLAY | RESUMED])
    def test_flags_of_a_run(self, flags: int, size: int) -> None:
        (run,) = feed(reader(), data(record(size), flags=flags))
        assert (run.is_replay, run.is_resumed) == (bool(flags & REPLAY), bool(flags & RESUMED))

    @for_each("size", [0, 1, BUFFER_BYTES - DATA_HEAD_BYTES - 12, BUFFER_BYTES, 3 * BUFFER_BYTES])
    def test_a_run_survives_what_comes_after_it(self, size: int) -> None:
        """The body must not be a view of a buffer that the reader uses again."""
        frames = reader()
        (first,) = feed(frames, data(record(size)))
        list(feed(frames, control(b"\xff" * (BUFFER_BYTES - 100)) * 3))
        assert isinstance(first, Run)
        assert bytes(first.body) == record(size)

    @for_each("size", range(BUFFER_BYTES - 2 * DATA_HEAD_BYTES, BUFFER_BYTES + 2, 7))
    def test_sizes_around_the_buffer(self, size: int) -> None:
        frames = [data(record(size)), control(b"between"), data(record(size))]
        assert len(values(feed(reader(), b"".join(frames)))) == 3

    @for_each("is_broker", [False, True])
    @for_each("size", [3, BUFFER_BYTES])
    @for_each("flags", [0, REPLAY, RESUMED])
    def test_one_number_has_a_meaning_for_each_way(self, is_broker: bool, size: int, flags: int) -> None:
        limits = {"max_control_bytes": MAX_CONTROL, "max_data_bytes": 2 * BUFFER_BYTES}
        made = FrameReader(**limits, is_broker=is_broker)
        (run,) = feed(made, data(record(size), flags=flags))
        assert (run.endpoint, run.source, run.only_for) == ((7, 0, 8) if is_broker else (7, 8, 0))

    @pytest.mark.parametrize("is_broker", [False, True])
    def test_also_in_a_read_of_one_run(self, is_broker: bool) -> None:
        made = FrameReader(max_control_bytes=MAX_CONTROL, max_data_bytes=MAX_DATA, is_broker=is_broker)
        frame = data(record(3))
        made.get_buffer()[: len(frame)] = frame
        run = made.came_alone(len(frame))
        assert run is not None
        assert (run.source, run.only_for) == ((0, 8) if is_broker else (8, 0))

    def test_frames_before_a_bad_one_come_out_first(self) -> None:
        items = feed(reader(), control(b"good") + b"\xff" * 32)
        assert next(items) == b"good"
        with pytest.raises(RemoteProtocolError):
            next(items)


@st.composite
def streams(draw: st.DrawFn) -> tuple[list[bytes], list[int]]:
    """Frames (some longer than the buffer), and the sizes of the pieces in which they arrive."""
    small = st.integers(0, 200)
    large = st.sampled_from([BUFFER_BYTES - 50, BUFFER_BYTES, BUFFER_BYTES + 1, 5 << 20])
    size = st.one_of(small, small, small, large)
    kind = st.sampled_from(["control", "data"])
    frames = [
        control(bytes([at]) * (size % MAX_CONTROL))
        if what == "control"
        else data(record(size), first_seq=at + 1)
        for at, (what, size) in enumerate(draw(st.lists(st.tuples(kind, size), max_size=6)))
    ]
    piece = st.one_of(st.integers(1, 12), st.integers(1, 2 * BUFFER_BYTES))
    return frames, draw(st.lists(piece, max_size=30))


@settings(max_examples=examples(60), deadline=None)
@given(streams())
def test_the_pieces_do_not_matter(stream: tuple[list[bytes], list[int]]) -> None:
    frames, pieces = stream
    whole = [one for frame in frames for one in values(feed(reader(), frame))]
    assert values(feed(reader(), b"".join(frames), pieces)) == whole
    assert len(whole) == len(frames)


def test_byte_by_byte() -> None:
    frames = [control(b"abc"), data(record(40)), control(b""), data(record(0) * 3, count=3)]
    stream = b"".join(frames)
    assert len(values(feed(reader(), stream, [1] * len(stream)))) == len(frames)


class TestMemory:
    def test_a_lying_length_takes_little(self) -> None:
        """Only received bytes make the buffer grow."""
        frames = reader(max_data=1 << 30)
        head = DATA_HEAD.pack((1 << 30) + 20, DATA, 0, 0, 1, 0, 1, 1, 0)
        assert list(feed(frames, head)) == []
        assert len(frames.get_buffer()) <= 4 << 20

    def test_a_large_frame_is_not_read_beyond(self) -> None:
        """Otherwise the body of a large frame would need a second copy."""
        frames = reader()
        frame = data(record(6 << 20))
        assert list(feed(frames, frame[:-10])) == []
        assert len(frames.get_buffer()) == 10

    @for_each("size", [BUFFER_BYTES, 1 << 20, 6 << 20])
    def test_the_payload_of_a_large_frame_begins_at_a_multiple_of_8(self, size: int) -> None:
        """Python then checks and copies a long text in one pass."""
        (run,) = feed(reader(), data(record(size)))
        assert isinstance(run, Run)
        whole = cast(bytearray, memoryview(run.body).obj)
        address = ctypes.addressof(ctypes.c_char.from_buffer(whole)) + len(whole) - size
        assert address % 8 == 0
        assert bytes(run.body) == record(size)

    @pytest.mark.parametrize("size", [BUFFER_BYTES, 1 << 20])
    def test_the_buffer_of_a_large_frame_may_have_any_contents(self, size: int) -> None:
        """None of them gets into a frame, nor into the next one."""
        frames = reader()
        frames.make_room = lambda size: bytearray(b"?" * size)
        stream = data(record(size)) + control(b"x") + data(record(10))
        (first, message, last) = feed(frames, stream)
        assert isinstance(first, Run)
        assert isinstance(last, Run)
        assert (bytes(first.body), message, bytes(last.body)) == (record(size), b"x", record(10))

    def test_the_buffer_is_never_empty(self) -> None:
        frames = reader()
        stream = control(b"x" * (BUFFER_BYTES - FRAME_HEAD_BYTES)) + data(record(5 << 20))
        at = 0
        while at < len(stream):
            space = frames.get_buffer()
            assert len(space) > 0
            count = min(len(space), len(stream) - at)
            space[:count] = stream[at : at + count]
            list(frames.received(count))
            at += count

    @for_each("held", ["reader", "reader._view", "reader.get_buffer()[10:]"])
    def test_in_a_cycle_it_is_collected_silently(self, held: str) -> None:
        """With a view of a BytesIO, CPython 3.12.1 crashed. 3.13 printed an error, and other versions did so
        with -X dev.
        """
        program = (
            "import gc\nfrom bus.wire.framing import FrameReader\n"
            "for _ in range(100):\n"
            "  reader = FrameReader(max_control_bytes=9, max_data_bytes=9)\n"
            f"  reader.cycle = [reader, {held}]\n"
            "  reader.cycle.append(reader.cycle)\n"
            "  del reader\n  gc.collect()"
        )
        done = subprocess.run([sys.executable, "-X", "dev", "-c", program], capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, "")


class TestRefusals:
    @for_each("kind", [0, 3, 255])
    def test_an_unknown_kind(self, kind: int) -> None:
        assert refusal(FRAME_HEAD.pack(4, kind, 0, 0)) == f"frame of unknown kind {kind}"

    @for_each("flags", [REPLAY, RESUMED, 128])
    def test_flags_on_a_control_frame(self, flags: int) -> None:
        assert "flags" in refusal(FRAME_HEAD.pack(4, CONTROL, flags, 0))

    @for_each("flags", [4, REPLAY | RESUMED | 4, 255])
    def test_unknown_flags_on_a_data_frame(self, flags: int) -> None:
        assert "flags" in refusal(data(record(1), flags=flags))

    def test_bytes_that_are_to_be_zero(self) -> None:
        assert "flags" in refusal(FRAME_HEAD.pack(4, CONTROL, 0, 1))
        assert "flags" in refusal(data(record(1), zero=1))

    @pytest.mark.parametrize("length", [0, 3])
    def test_a_control_frame_that_is_too_short(self, length: int) -> None:
        assert f"frame of {length} bytes" in refusal(FRAME_HEAD.pack(length, CONTROL, 0, 0))

    @for_each("length", [0, 4, 27])
    def test_a_data_frame_that_is_too_short(self, length: int) -> None:
        assert f"frame of {length} bytes" in refusal(FRAME_HEAD.pack(length, DATA, 0, 0))

    def test_the_length_is_checked_before_the_rest_comes(self) -> None:
        assert "frame of 4294967295 bytes" in refusal(FRAME_HEAD.pack(2**32 - 1, DATA, 0, 0))

    def test_the_limit_of_control_bodies_is_exact(self) -> None:
        assert values(feed(reader(max_control=100), control(bytes(100)))) == [bytes(100)]
        assert "frame of 105 bytes" in refusal(control(bytes(101)), max_control=100)

    def test_the_limit_of_data_bodies_is_exact(self) -> None:
        assert len(list(feed(reader(max_data=100), data(record(88))))) == 1
        assert "frame of 129 bytes" in refusal(data(record(89)), max_data=100)

    def test_a_run_without_samples(self) -> None:
        assert refusal(data(record(1), count=0)) == "data frame without samples"

    @pytest.mark.parametrize("first_seq", [MAX_COUNT, 2**64 - 1])
    def test_a_number_that_no_publisher_reaches(self, first_seq: int) -> None:
        """The next number would no longer fit into its field."""
        assert str(MAX_COUNT) in refusal(data(record(1) * 2, count=2, first_seq=first_seq))

    def test_the_last_number(self) -> None:
        assert len(list(feed(reader(), data(record(1), first_seq=MAX_COUNT)))) == 1


@settings(max_examples=examples(60), deadline=None)
@given(st.binary(max_size=200), st.lists(st.integers(1, 9), max_size=20))
def test_garbage_is_refused_or_waits(garbage: bytes, pieces: list[int]) -> None:
    """The reader raises only RemoteProtocolError, and returns at most the bytes that it received."""
    frames = reader()
    try:
        size = sum(
            len(item) if isinstance(item, bytes) else len(item.body) for item in feed(frames, garbage, pieces)
        )
    except RemoteProtocolError:
        return
    assert size <= len(garbage)


class TestFront:
    """Frames that can be passed on as they lie in the buffer."""

    def came(self, content: bytes) -> FrameReader:
        made = reader()
        made.get_buffer()[: len(content)] = content
        made.came(len(content))
        return made

    def test_frames_are_readdressed_in_their_place(self) -> None:
        first, second = data(record(3)), data(record(5), first_seq=2)
        made = self.came(first + second + control(b"x") + first[:10])
        for frame, seq in ((first, 1), (second, 2)):
            front = made.front()
            assert front == (7, 8, seq, 1, len(frame))
            made.readdress(front, 70 + seq, 80 + seq)
        assert made.front() is None
        sent = bytes(made.readdressed())
        assert values(feed(reader(), sent)) == [
            (71, 81, 1, 1, record(3), False),
            (72, 82, 2, 1, record(5), False),
        ]
        assert len(made.readdressed()) == 0
        assert made.cut() == [b"x"]
        assert made.cut() == []
        buffer = made.get_buffer()  # the reader kept the beginning of the next run
        buffer[: len(first) - 10] = first[10:]
        run = made.came_alone(len(first) - 10)
        assert run is not None
        assert values([run]) == [(7, 8, 1, 1, record(3), False)]
        assert made.is_cut

    @for_each(
        "content",
        [
            control(bytes(100)),
            data(record(3))[:-1],
            data(record(3))[: DATA_HEAD_BYTES - 1],
            data(record(3), flags=REPLAY),
            data(record(3), flags=RESUMED),
            data(record(3), flags=4),
            data(record(3), zero=1),
            data(record(3), count=0),
            data(record(3), first_seq=MAX_COUNT + 1),
            bytes(64),
            b"\xff" * 64,
        ],
    )
    def test_all_others_are_cut(self, content: bytes) -> None:
        assert self.came(content).front() is None
        made = reader()
        made.get_buffer()[: len(content)] = content
        assert made.came_alone(len(content)) is None

    @for_each("more", [b"\x01", control(b"x"), data(record(5), first_seq=2)])
    def test_a_run_that_does_not_come_alone_is_cut_with_the_rest(self, more: bytes) -> None:
        content, made = data(record(3)) + more, reader()
        made.get_buffer()[: len(content)] = content
        assert made.came_alone(len(content)) is None
        first, *_ = made.cut()
        assert values([first]) == [(7, 8, 1, 1, record(3), False)]

    def test_what_is_too_large_is_cut(self) -> None:
        made = reader(max_data=100)
        frame = data(record(100))
        made.get_buffer()[: len(frame)] = frame
        made.came(len(frame))
        assert made.front() is None
        assert made.cut() == []
        assert made.fault is not None

    def test_not_within_a_long_frame(self) -> None:
        frame, made = data(record(BUFFER_BYTES)), reader()
        head = frame[:100_000]
        made.get_buffer()[: len(head)] = head
        assert made.received(len(head)) == []
        made.get_buffer()[:1] = frame[100_000:100_001]
        made.came(1)
        assert made.front() is None
        made.get_buffer()[: len(frame) - 100_001] = frame[100_001:]
        assert made.came_alone(len(frame) - 100_001) is None
        assert len(made.cut()) == 1


class TestCharges:
    """A frame too long for the common buffer is charged until it is complete, or until it never can be."""

    def begin(self, made: FrameReader, frame: bytes, count: int) -> list[bytes | Run]:
        out: list[bytes | Run] = []
        at = 0
        while at < count:
            buffer = made.get_buffer()
            piece = frame[at : min(at + len(buffer), count)]
            buffer[: len(piece)] = piece
            out += made.received(len(piece))
            at += len(piece)
        return out

    def test_until_it_is_whole(self) -> None:
        made, account = reader(), Account(1 << 30)
        made.charge_to(account)
        frame = data(record(3_000_000))
        self.begin(made, data(record(1000)), 500)
        assert account.used == 0
        made = reader()
        made.charge_to(account)
        assert self.begin(made, frame, len(frame) - 1) == []
        assert account.used == len(frame)
        buffer = made.get_buffer()
        buffer[:1] = frame[-1:]
        assert len(made.received(1)) == 1
        assert account.used == 0

    def test_as_it_grows(self) -> None:
        account = Account(1 << 30)
        frame = data(record(12 << 20))
        charged = []
        for count in (1 << 20, 5 << 20, 9 << 20):
            made = reader()
            made.charge_to(account)
            self.begin(made, frame, count)
            charged.append(account.used >> 20)
            made.close()
            assert account.used == 0
        assert charged == [4, 8, 12]

    def test_over_the_limit(self) -> None:
        """The reader makes no room for a refused frame."""
        text = "messages that have not come whole: {} bytes, the limit is {}"
        made, account = reader(), Account(1 << 20)
        made.charge_to(account)
        assert self.begin(made, data(record(3 << 20)), 300) == []
        assert str(made.fault) == text.format(3145772, 1 << 20)
        assert account.used == 0
        made, account = reader(), Account(5 << 20)
        made.charge_to(account)
        assert self.begin(made, data(record(12 << 20)), 4 << 20) == []
        assert str(made.fault) == text.format(8 << 20, 5 << 20)
        assert account.used == 4 << 20

    def test_another_account(self) -> None:
        """The owner of a connection may become known when a frame has already begun."""
        made, first, second = reader(), Account(4 << 20), Account(1 << 30)
        made.charge_to(first)
        self.begin(made, data(record(3 << 20)), 300_000)
        assert first.used == 3_145_772
        made.charge_to(second)
        assert (first.used, second.used) == (0, 3_145_772)


def test_a_read_that_makes_no_frame_whole() -> None:
    """The reader reports such a read, so that the same bytes cannot cost many reads."""
    stream, told = reader(), []
    short, long = control(b"x" * 100), control(b"y" * 600_000)
    for piece in (short, short[:50], short[50:] + short[:9], short[9:], short + long[:1000], long[1000:2000]):
        stream.get_buffer()[: len(piece)] = piece
        stream.received(len(piece))
        told.append(stream.is_unfinished)
    assert told == [False, True, False, False, True, True]


def test_a_long_frame_is_charged_as_it_comes() -> None:
    """The buffer is never copied. It has the frame's full length from the start, and uses memory page by
    page.
    """
    account, size = Account(limit=1 << 30), 20 << 20
    stream = reader(max_data=64 << 20)
    stream.charge_to(account)
    head = data(bytes(size))[:DATA_HEAD_BYTES]
    stream.get_buffer()[: len(head)] = head
    assert stream.received(len(head)) == []
    left, used, found = size, [account.used], list[object]()
    while left:
        room = len(stream.get_buffer())
        assert room <= left
        left -= room
        found = [*stream.received(room)]
        used.append(account.used)
    assert used == [4 << 20, 8 << 20, 16 << 20, size + len(head), 0]
    assert [len(run.body) for run in found if isinstance(run, Run)] == [size]
