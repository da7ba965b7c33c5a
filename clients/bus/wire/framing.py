"""Frames out of a stream of bytes: incremental and bounded, and a large payload is never copied twice.

The shell reads into `get_buffer()` and says how much came with `received(n)`. Small frames are cut out of one
buffer; a frame that does not fit gets a buffer of its own, which grows with what really arrives, so that a
lying length costs its sender's word and not our memory.

Raises RemoteProtocolError at the first frame that breaks the layout; frames before it are given out first.
"""

from collections.abc import Iterator

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
    REPLAY,
)
from bus.wire.runs import Run

BUFFER_BYTES = 256 << 10
_FIRST_GROWTH_BYTES = 4 << 20


class FrameReader:
    """Cuts a stream into control bodies (`bytes`) and runs.

    `max_control_bytes` and `max_data_bytes` bound the body of a frame of each kind.
    """

    def __init__(self, *, max_control_bytes: int, max_data_bytes: int) -> None:
        self.max_control_bytes = max_control_bytes
        self.max_data_bytes = max_data_bytes
        self._buffer = bytearray(BUFFER_BYTES)
        self._view = memoryview(self._buffer)
        self._end = 0  # bytes of a part of a frame at the start of the buffer
        self._large: bytearray | None = None  # the frame that is too long for the buffer
        self._large_length = 0
        self._large_end = 0

    @property
    def is_within_frame(self) -> bool:
        """Whether a part of a frame has come, and the rest has not."""
        return self._large is not None or self._end > 0

    def get_buffer(self) -> memoryview:
        """Where the next bytes of the stream belong; never empty."""
        if self._large is None:
            return self._view[self._end :]
        if self._large_end == len(self._large):
            grown = bytearray(min(self._large_length, 2 * len(self._large)))
            grown[: self._large_end] = self._large
            self._large = grown
        return memoryview(self._large)[self._large_end :]

    def received(self, count: int) -> Iterator[bytes | Run]:
        """The frames that are complete now that `count` bytes have come into the buffer."""
        if self._large is not None:
            self._large_end += count
            if self._large_end == self._large_length:
                whole, self._large = memoryview(self._large), None
                yield self._parse(whole, 0, len(whole), copy=False)
            return
        view, start, end = self._view, 0, self._end + count
        self._end = 0
        while end - start >= FRAME_HEAD_BYTES:
            stop = start + LENGTH_BYTES + self._check_length(view, start)
            if stop > end:
                break
            yield self._parse(view, start, stop, copy=True)
            start = stop
        self._keep(start, end)

    def _keep(self, start: int, end: int) -> None:
        rest = end - start
        if rest >= FRAME_HEAD_BYTES:
            total = LENGTH_BYTES + self._check_length(self._view, start)
            if total > BUFFER_BYTES:
                self._large_length = total
                self._large = bytearray(min(total, _FIRST_GROWTH_BYTES))
                self._large[:rest] = self._view[start:end]
                self._large_end = rest
                return
        if start and rest:
            self._buffer[:rest] = self._buffer[start:end]
        self._end = rest

    def _check_length(self, view: memoryview, start: int) -> int:
        length, kind, flags, zero = FRAME_HEAD.unpack_from(view, start)
        if kind == DATA:
            least, room = DATA_HEAD_BYTES - LENGTH_BYTES, self.max_data_bytes
        elif kind == CONTROL:
            least, room = FRAME_HEAD_BYTES - LENGTH_BYTES, self.max_control_bytes
        else:
            raise RemoteProtocolError(f"frame of unknown kind {kind}")
        if not least <= length <= least + room:
            raise RemoteProtocolError(
                f"frame of {length} bytes; a frame of kind {kind} has {least} to {least + room}"
            )
        if zero or flags & ~(REPLAY if kind == DATA else 0):
            raise RemoteProtocolError(f"frame with unknown flags {flags:#x}")
        return int(length)

    @staticmethod
    def _parse(view: memoryview, start: int, stop: int, *, copy: bool) -> bytes | Run:
        if view[start + LENGTH_BYTES] == CONTROL:
            return bytes(view[start + FRAME_HEAD_BYTES : stop])
        _, _, flags, _, endpoint, source, first_seq, count, _ = DATA_HEAD.unpack_from(view, start)
        body = view[start + DATA_HEAD_BYTES : stop]
        if not count:
            raise RemoteProtocolError("data frame without samples")
        if first_seq + count - 1 > MAX_COUNT:
            raise RemoteProtocolError(f"sample {first_seq + count - 1}; the last number is {MAX_COUNT}")
        return Run(endpoint, source, first_seq, count, bytes(body) if copy else body, bool(flags & REPLAY))
