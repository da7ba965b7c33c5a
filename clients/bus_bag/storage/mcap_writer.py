"""Writes one MCAP file, from its header to its footer.

Writing only appends, so a file that was cut off anywhere is readable up to its last complete chunk. If
nothing more fits, the file ends after its last complete record, and can still be closed. A part of the disk
is reserved for that (`Reserve`). If the file's size has a limit instead, its last chunks are removed to make
room.
"""

import errno
import fcntl
import os
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

from bus.base.version import RELEASE
from bus_bag.errors import BagFull
from bus_bag.metadata import TopicMetadata, profiles_to_text
from bus_bag.storage.bag_file import Buffer
from bus_bag.storage.chunk import Chunk
from bus_bag.storage.mcap_format import MAGIC, encode, package
from bus_bag.storage.mcap_summary import McapSummary
from bus_bag.storage.reserve import UNIT, Reserve

__all__ = ["PRESETS", "McapWriter", "Preset"]

_FULL = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)
_MAX_PIECES = 1024
"""Most buffers in one call of writev (IOV_MAX)."""
_LEAST_ROOM = 16 << 10
"""Room for the last metadata records, and for the end."""


class Preset(msgspec.Struct, frozen=True):
    """The form in which a file is written."""

    chunk_bytes: int = 1 << 20
    """0: no chunks, and no index."""
    compression: str = ""
    """Empty for no compression, or `zstd`."""
    level: int = 0


PRESETS: Mapping[str, Preset] = {
    "none": Preset(),
    "fastwrite": Preset(chunk_bytes=0),
    "zstd_fast": Preset(compression="zstd", level=-5),
    "zstd_small": Preset(chunk_bytes=4 << 20, compression="zstd", level=19),
}
"""Presets by rosbag2's names (`--storage-preset-profile`)."""


class McapWriter:
    """A file that is being written. Not for several threads at a time, but any thread may read its counters.

    Raises BagFull if nothing more fits; `write_metadata` and `close` still work then. Raises OSError for
    other faults.
    """

    def __init__(self, path: Path, preset: Preset) -> None:
        package()
        self.path = path
        self.counts: Counter[int] = Counter()
        """Channel -> number of messages in the file."""
        self.size = 0
        """Bytes in the file."""
        self.starting_time = 0
        self.end_time = 0
        self._preset = preset
        self._compressor = _compressor(preset)
        self._summary = McapSummary()
        self._last: deque[_Written] = deque()
        """The chunks that can still be removed."""
        self._is_full = False
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        self._reserve = Reserve(path.parent)
        with suppress(OSError):  # some file systems have no locks
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)  # a locked file is being written
        try:
            self._append([MAGIC, encode(package().Header(profile="ros2", library=f"busd {RELEASE}"))])
        except BaseException:
            self.abandon()
            path.unlink(missing_ok=True)
            raise

    @property
    def is_open(self) -> bool:
        return self._descriptor >= 0

    @property
    def message_count(self) -> int:
        return self.counts.total()

    def write_schema(self, number: int, name: str, definition: str) -> None:
        """Write a type, before its first channel."""
        self.add_schema(package().Schema(id=number, name=name, encoding="ros2msg", data=definition.encode()))

    def add_schema(self, schema: Any) -> None:
        """Write a type, given as a record of `mcap.records`."""
        self._append_record(self._summary.add_schema(schema))

    def write_channel(self, number: int, schema: int, topic: TopicMetadata, extra: Mapping[str, str]) -> None:
        """Write a topic, before its first message."""
        channel = package().Channel(
            id=number,
            topic=topic.name,
            message_encoding=topic.serialization_format,
            metadata={
                "offered_qos_profiles": profiles_to_text(topic.offered_qos_profiles),
                "topic_type_hash": topic.type_description_hash,
                **extra,
            },
            schema_id=schema,
        )
        self.add_channel(channel)

    def add_channel(self, channel: Any) -> None:
        """Write a topic, given as a record of `mcap.records`."""
        self._append_record(self._summary.add_channel(channel))

    def _append_record(self, record: bytes) -> None:
        """Append a record that the summary repeats."""
        self._reserve.hold(self._summary.size)
        self._append([record])

    def write_chunk(self, chunk: Chunk) -> None:
        """Write messages. If a channel was not written before, or the file is full, writes nothing."""
        if self._is_full or not self._summary.has_channels(chunk.index.keys()):
            return
        before = self.size
        if not self._preset.chunk_bytes:
            self._append_chunk(chunk.pieces)
            self._count(_Written(before, chunk.counts, None, self.starting_time, self.end_time), chunk)
            return
        pieces: Sequence[Buffer] = chunk.pieces
        stored = chunk.size
        # A CRC reads every byte: this is too slow for images, which are not even copied.
        crc = 0 if chunk.has_long_parts else chunk.crc()
        if self._compressor is not None:
            pieces = [self._compressor.compress(pieces[0] if len(pieces) == 1 else b"".join(pieces))]
            stored = len(pieces[0])
        head = chunk.head(self._preset.compression, stored, crc)
        length = len(head) + stored
        indexes, offsets = chunk.message_indexes(before + length)
        record = encode(
            package().ChunkIndex(
                message_start_time=chunk.start,
                message_end_time=chunk.end,
                chunk_start_offset=before,
                chunk_length=length,
                message_index_offsets=offsets,
                message_index_length=sum(map(len, indexes)),
                compression=self._preset.compression,
                compressed_size=stored,
                uncompressed_size=chunk.size,
            )
        )
        self._reserve.hold(self._summary.size + len(record))
        self._append_chunk([head, *pieces, *indexes])
        self._count(_Written(before, chunk.counts, record, self.starting_time, self.end_time), chunk)

    def _append_chunk(self, pieces: Sequence[Buffer]) -> None:
        """Append a chunk. Without room, remove chunks until the end fits; counters then match the
        file."""
        before = self.size
        try:
            self._append(pieces)
        except BagFull as full:
            self._is_full = True
            room = full.room + (0 if full.is_limit else self._reserve.size)
            while self._last and room + before - self.size < max(3 * self._summary.size, _LEAST_ROOM):
                self._take_back()
            raise

    def _count(self, written: "_Written", chunk: Chunk) -> None:
        if written.record is not None:
            self._summary.add_chunk(written.record)
        self.starting_time = min(self.starting_time, chunk.start) if self.counts else chunk.start
        self.end_time = max(self.end_time, chunk.end)
        self.counts.update(written.counts)
        self._last.append(written)
        enough = max(6 * self._summary.size, UNIT)
        while len(self._last) > 1 and self.size - self._last[1].offset > enough:
            self._last.popleft()

    def write_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record."""
        record = encode(package().Metadata(name=name, metadata=dict(values)))
        offset = self._append_surely([record])
        self._summary.add_metadata(offset, len(record), name)

    def close(self) -> None:
        """Complete the file with the summary. The file is closed even if that fails."""
        try:
            self._reserve.give_back()
            self._append_surely([], is_end=True)
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Close the incomplete file."""
        self._reserve.give_back()
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _end(self) -> bytes:
        """All bytes from the end of the data on, if the data end here."""
        return self._summary.encode(self.size, self.counts, self.starting_time, self.end_time)

    def _append_surely(self, pieces: Sequence[Buffer], *, is_end: bool = False) -> int:
        """Append a part that the file needs. Without room, free the reserve, then remove the last chunks.

        Returns the position of the beginning of the part.
        """
        while True:
            try:
                before = self.size
                self._append([self._end()] if is_end else pieces)
                return before
            except BagFull:
                if self._reserve.give_back():
                    continue
                if not self._take_back():
                    raise

    def _take_back(self) -> bool:
        """Remove the last chunk with everything after it; False if there is none."""
        if not self._last:
            return False
        written = self._last.pop()
        self.counts.subtract(written.counts)
        self.counts = +self.counts
        self.starting_time, self.end_time = written.starting_time, written.end_time
        self._summary.take_back(written.offset, has_chunk=written.record is not None)
        os.ftruncate(self._descriptor, written.offset)
        os.lseek(self._descriptor, written.offset, os.SEEK_SET)
        self.size = written.offset
        return True

    def _append(self, pieces: Sequence[Buffer]) -> None:
        """Write everything or nothing."""
        before = self.size
        try:
            for first in range(0, len(pieces), _MAX_PIECES):
                self.size += _write_all(self._descriptor, pieces[first : first + _MAX_PIECES])
        except OSError as error:
            room = os.fstat(self._descriptor).st_size - before
            self.size = before
            os.ftruncate(self._descriptor, before)
            os.lseek(self._descriptor, before, os.SEEK_SET)
            if error.errno not in _FULL:
                raise
            text = f"{self.path} can't grow beyond {before:,} bytes: {error.strerror}"
            raise BagFull(text, room=room, is_limit=error.errno == errno.EFBIG) from None


class _Written(msgspec.Struct):
    """A chunk in the file, and the state of the file before it."""

    offset: int
    counts: dict[int, int]
    record: bytes | None
    starting_time: int
    end_time: int


def _write_all(descriptor: int, pieces: Sequence[Buffer]) -> int:
    total = sum(map(len, pieces))
    left = total
    while True:
        written = os.writev(descriptor, pieces)
        left -= written
        if not left:
            return total
        rest: list[Buffer] = []
        for piece in pieces:
            if written >= len(piece):
                written -= len(piece)
            else:
                rest.append(memoryview(piece)[written:])
                written = 0
        pieces = rest


def _compressor(preset: Preset) -> Any:
    if not preset.compression:
        return None
    return package("zstandard").ZstdCompressor(level=preset.level, write_checksum=True)
