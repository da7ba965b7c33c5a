"""Cuts a stream of bytes into frames: incrementally, within bounds, and without copying a large payload
twice.

The caller reads into `get_buffer()` and passes the number of bytes to `received(n)`. Small frames share one
buffer. A frame that does not fit gets its own buffer, which grows as data arrives, so a forged length cannot
make us allocate memory. `cut` returns a few frames of a read at a time. So the caller can stop in between
without having paid for all of them.

The first frame that breaks the layout sets the reader's `fault`; earlier frames are still returned.
"""

from collections.abc import Callable
from struct import Struct
from typing import TypeAlias

from bus.base.buffers import paged_buffer, zeroed_buffer
from bus.errors import RemoteProtocolError
from bus.wire.layout import (
    CONTROL,
    DATA,
    DATA_HEAD,
    DATA_HEAD_BYTES,
    FRAME_HEAD,
    FRAME_HEAD_BYTES,
    LENGTH_BYTES,
    MAX_COUNT,
    RECORD_HEAD_BYTES,
    REPLAY,
    RESUMED,
)
from bus.wire.runs import Account, Buffer, Run

BUFFER_BYTES = 256 << 10
MOST_CUT = 64
"""Most frames cut at a time: enough to make the call cheap, few enough to stop soon."""
_FIRST_ROOM_BYTES = 4 << 20
"""Bytes of a long frame that are charged at first."""

_SHIFT = -(DATA_HEAD_BYTES + RECORD_HEAD_BYTES) % 8
"""Bytes before a long frame that make its first payload begin at a multiple of 8.

A long text begins at a multiple of 8 of its payload (`bus.types.large_fields.encode_around`). If its memory
does, too, CPython checks and copies it in one pass instead of two."""

_unpack_short = Struct("<IIIIQII").unpack_from  # DATA_HEAD with kind, flags and zero as one word
_DATA_FLAGS = REPLAY | RESUMED
_DATA_WORDS = tuple(DATA | flags << 8 for flags in range(_DATA_FLAGS + 1))
_RESUMED_WORD = DATA | RESUMED << 8  # and above
_END_COUNT = MAX_COUNT + 1
_pack_address = Struct("<II").pack_into  # endpoint and source, which follow FRAME_HEAD
_unpack_frame_head = FRAME_HEAD.unpack_from
_unpack_data_head = DATA_HEAD.unpack_from

Front: TypeAlias = tuple[int, int, int, int, int]
"""Head of a data frame: endpoint, `source` or `only_for`, first number, samples, bytes of the whole frame."""


class FrameReader:
    """Cuts a stream into control bodies (`bytes`) and runs.

    `max_control_bytes` and `max_data_bytes` bound the body of a frame of each kind. A frame that is too
    long for the common buffer can be charged to an account (`charge_to`) until it is whole.
    `is_broker`: the stream comes from a client, and its runs have `only_for` instead of `source`.
    """

    def __init__(self, *, max_control_bytes: int, max_data_bytes: int, is_broker: bool = False) -> None:
        self.max_control_bytes = max_control_bytes
        self.max_data_bytes = max_data_bytes
        self._is_broker = is_broker
        self._view = paged_buffer(BUFFER_BYTES)
        self._end = 0  # bytes of a part of a frame at the start of the buffer
        self._start = self._stop = 0  # range of bytes not yet cut
        self._begin = 0  # start of the readdressed frames
        self.make_room: Callable[[int], bytearray | memoryview] = zeroed_buffer
        """Makes a buffer for a long frame, which must cost little if it is not written. Its contents may be
        undefined."""
        self._large: memoryview | None = None  # for a frame that is too long for the common buffer
        self._large_room = 0  # size of that buffer so far, which is charged
        self._large_end = 0
        self._account: Account | None = None
        self.is_unfinished = False
        """The last bytes completed no frame; or the next frame, which has begun, is a long one."""
        self.fault: RemoteProtocolError | None = None

    def charge_to(self, account: Account) -> None:
        """Charge long frames to `account` from now on, including a frame that has begun."""
        held = self._held
        self._charge(-held)
        self._account = account
        self._charge(held)

    def close(self) -> None:
        """Free the memory now, even if a reference to the reader remains. No more bytes may come."""
        self._forget_large()
        self._view = memoryview(bytearray())
        self._end = self._start = self._stop = 0

    def _forget_large(self) -> None:
        self._charge(-self._held)
        self._large = None

    def get_buffer(self) -> memoryview:
        """The buffer for the next bytes of the stream; never empty. All earlier frames must have been cut."""
        if self._large is None:
            return self._view[self._end :] if self._end else self._view
        return self._large[self._large_end : self._large_room]

    def received(self, count: int) -> list[bytes | Run]:
        """Take `count` new bytes, and return the first complete frames; `cut` returns the next ones."""
        self.came(count)
        return self.cut()

    def came(self, count: int) -> None:
        """Take `count` new bytes; `front` and `cut` return their frames."""
        if self._large is None:
            self._begin = self._start = 0
            self._stop, self._end = self._end + count, 0
        else:
            self._large_end += count

    def came_alone(self, count: int) -> Run | None:
        """As `came`. Returns the run, if the bytes are exactly one whole run without fault or flags.

        At a moderate rate a read always is one run, and this saves most of the cost of `cut`.
        """
        if self._large is not None:
            self._large_end += count
            return None
        self._begin = self._start = 0
        self._stop, self._end = self._end + count, 0
        front = self.front()
        if front is None or front[4] != self._stop:
            return None
        endpoint, address, first_seq, number, self._start = front
        run = Run(endpoint, address, first_seq, number, self._view[DATA_HEAD_BYTES : self._start].tobytes())
        if address and self._is_broker:
            run.source, run.only_for = 0, address
        return run

    @property
    def is_cut(self) -> bool:
        """Whether the buffer has no whole frame left."""
        return self._start == self._stop

    def front(self) -> Front | None:
        """The head of the next frame, if that is a whole data frame without fault or flags.

        The frame stays in the buffer until `readdress` or `cut`.
        """
        start = self._start
        left = self._stop - start
        if left < DATA_HEAD_BYTES or self._large is not None:
            return None
        length, word, endpoint, address, first_seq, number, rest = _unpack_short(self._view, start)
        size = length + LENGTH_BYTES
        if (
            word != DATA
            or not DATA_HEAD_BYTES <= size <= left
            or size > DATA_HEAD_BYTES + self.max_data_bytes
            or not number
            or first_seq + number > _END_COUNT
            or rest
        ):
            return None
        return endpoint, address, first_seq, number, size

    def is_last(self, front: Front) -> bool:
        """Whether the buffer has nothing behind the frame of `front`."""
        return self._start + front[4] == self._stop

    def addressed(self, front: Front, endpoint: int, source: int) -> memoryview:
        """The frame of `front`, changed in place as by `readdress`; it stays the next frame."""
        start = self._start
        _pack_address(self._view, start + FRAME_HEAD_BYTES, endpoint, source)
        return self._view[start : start + front[4]]

    def readdress(self, front: Front, endpoint: int, source: int) -> None:
        """Change the frame of `front`, in place, to one from `source` to `endpoint`."""
        start = self._start
        _pack_address(self._view, start + FRAME_HEAD_BYTES, endpoint, source)
        self._start = start + front[4]

    def readdressed(self) -> memoryview:
        """The frames readdressed since the last call, back to back; valid until the next bytes come."""
        begin, self._begin = self._begin, self._start
        return self._view[begin : self._start]

    def cut(self) -> list[bytes | Run]:
        """The next complete frames, MOST_CUT at most; none: more bytes must come first.

        If a frame breaks the layout, the frames before it are returned and `fault` is set.
        """
        if self._large is not None:
            return self._cut_large()
        frames: list[bytes | Run] = []
        view, start, end = self._view, self._start, self._stop
        is_broker = self._is_broker
        self._start = self._stop = 0
        self.is_unfinished = False
        most = DATA_HEAD_BYTES - LENGTH_BYTES + self.max_data_bytes
        least_control = FRAME_HEAD_BYTES - LENGTH_BYTES
        most_control = least_control + self.max_control_bytes
        try:
            while end - start >= FRAME_HEAD_BYTES:
                if len(frames) == MOST_CUT:
                    self._start, self._stop = start, end
                    return frames
                if end - start >= DATA_HEAD_BYTES:
                    # The short way, for a whole frame without fault: one check and no call.
                    length, word, endpoint, address, first_seq, number, rest = _unpack_short(view, start)
                    stop = start + LENGTH_BYTES + length
                    body = start + DATA_HEAD_BYTES
                    if (
                        word in _DATA_WORDS
                        and body <= stop <= end
                        and length <= most
                        and number
                        and first_seq + number <= _END_COUNT
                        and not rest
                    ):
                        payload = view[body:stop].tobytes()
                        run = Run(endpoint, address, first_seq, number, payload)
                        if address and is_broker:
                            run.source, run.only_for = 0, address
                        if word != DATA:
                            run.is_replay = word != _RESUMED_WORD
                            run.is_resumed = word >= _RESUMED_WORD
                        frames.append(run)
                        start = stop
                        continue
                    if word == CONTROL and least_control <= length <= most_control and stop <= end:
                        frames.append(view[start + FRAME_HEAD_BYTES : stop].tobytes())
                        start = stop
                        continue
                stop = start + self._check_head(view, start)
                if stop > end:
                    break
                frames.append(_parse(view, start, stop, is_broker))
                start = stop
            if start != end:
                self._keep(start, end)
        except RemoteProtocolError as error:
            self.fault = error
        return frames

    def _cut_large(self) -> list[bytes | Run]:
        try:
            whole = self._large
            self.is_unfinished = whole is None or self._large_end < len(whole)
            if whole is None or self.is_unfinished:
                self._grow()
                return []
            self._forget_large()
            return [_parse(whole, 0, len(whole), self._is_broker)]
        except RemoteProtocolError as error:
            self.fault = error
            return []

    def _grow(self) -> None:
        if self._large is not None and self._large_end == self._large_room:
            room = min(len(self._large), 2 * self._large_room)
            self._reserve(room - self._large_room)
            self._large_room = room

    def _keep(self, start: int, end: int) -> None:
        rest = end - start
        self.is_unfinished = not start
        if rest >= FRAME_HEAD_BYTES:
            total = self._check_head(self._view, start)
            if total > BUFFER_BYTES:
                room = min(total, _FIRST_ROOM_BYTES)
                self._reserve(room)
                try:
                    large = memoryview(self.make_room(_SHIFT + total))
                except MemoryError as error:
                    self._charge(-room)
                    raise RemoteProtocolError(f"a frame of {total} bytes: {error or 'no memory'}") from None
                self._large = large[_SHIFT:]
                self._large[:rest] = self._view[start:end]
                self._large_room, self._large_end = room, rest
                self.is_unfinished = True
                return
        if start:
            self._view[:rest] = self._view[start:end]
        self._end = rest

    @property
    def _held(self) -> int:
        return self._large_room if self._large is not None else 0

    def _reserve(self, size: int) -> None:
        account = self._account
        if account is not None:
            if account.used + size > account.limit:
                raise RemoteProtocolError(
                    f"messages that have not come whole: {account.used + size} bytes, "
                    f"the limit is {account.limit}"
                )
            account.charge(size)

    def _charge(self, size: int) -> None:
        if self._account is not None:
            self._account.charge(size)

    def _check_head(self, view: memoryview, start: int) -> int:
        """The length of the whole frame that begins at `start`."""
        length, kind, flags, zero = _unpack_frame_head(view, start)
        if kind == DATA:
            least, room, known_flags = DATA_HEAD_BYTES - LENGTH_BYTES, self.max_data_bytes, _DATA_FLAGS
        elif kind == CONTROL:
            least, room, known_flags = FRAME_HEAD_BYTES - LENGTH_BYTES, self.max_control_bytes, 0
        else:
            raise RemoteProtocolError(f"frame of unknown kind {kind}")
        if not least <= length <= least + room:
            raise RemoteProtocolError(
                f"frame of {length} bytes; a frame of kind {kind} has {least} to {least + room}"
            )
        if zero or flags & ~known_flags:
            raise RemoteProtocolError(f"frame with unknown flags {flags:#x}")
        return LENGTH_BYTES + int(length)


def _parse(view: memoryview, start: int, stop: int, is_broker: bool) -> bytes | Run:
    """The frame from `start` to `stop`, as a copy; a long body stays in its own buffer."""
    if view[start + LENGTH_BYTES] == CONTROL:
        return view[start + FRAME_HEAD_BYTES : stop].tobytes()
    _, _, flags, _, endpoint, address, first_seq, count, zero = _unpack_data_head(view, start)
    if zero:
        raise RemoteProtocolError(f"data frame with {zero:#x} where there must be zero")
    if not count:
        raise RemoteProtocolError("data frame without samples")
    if first_seq + count - 1 > MAX_COUNT:
        raise RemoteProtocolError(f"sample {first_seq + count - 1}; the last number is {MAX_COUNT}")
    body: Buffer = view[start + DATA_HEAD_BYTES : stop]
    if stop <= BUFFER_BYTES:
        body = bytes(body)
    run = Run(endpoint, address, first_seq, count, body, bool(flags & REPLAY))
    run.is_resumed = bool(flags & RESUMED)
    if is_broker:
        run.source, run.only_for = 0, address
    return run
