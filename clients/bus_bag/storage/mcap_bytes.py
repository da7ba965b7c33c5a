"""The bytes of one MCAP file: pieces of it, the records of its chunks, and its problems.

This module unpacks and checks chunks. Unreadable parts become a Problem and are skipped.
"""

import fcntl
import os
import struct
import zlib
from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path

import msgspec

from bus.base.counted import counted
from bus_bag.storage.bag_file import Buffer, Problem
from bus_bag.storage.decompression import decompress
from bus_bag.storage.mcap_format import CHUNK_HEAD, RECORD, Opcode

__all__ = ["INDEX_HEAD", "McapBytes", "Segment"]

INDEX_HEAD = struct.Struct("<HI")
"""Fields of a message index: the channel, and the size of its entries, which have 16 bytes each."""
_LOADED = 256 << 20
"""Waiting chunks with more bytes in total are unloaded and read again later."""
_MAX_PROBLEMS = 1000
_MOST_INDEXES = 1 << 16
"""Most message indexes that are read to count messages of unreadable chunks: a false index can give the same
ones to many chunks."""
_WINDOW = 64 << 10


class Segment(msgspec.Struct):
    """Messages that are read together: a chunk, or messages outside of chunks."""

    offset: int
    """Offset of the first record."""
    length: int
    start: int
    end: int
    channels: frozenset[int] | None
    """Channels of its messages; None if unknown."""
    is_chunk: bool


class McapBytes:
    """A file that is open for reading; `content`: path of its bytes, if not `path`.

    Raises OSError if it can't be opened.
    """

    def __init__(self, path: Path, content: Path | None) -> None:
        self.path = path
        self.problems: list[Problem] = []
        self._segments: list[Segment] = []
        self._loaded: OrderedDict[int, Buffer] = OrderedDict()
        self._loaded_size = 0
        self._indexes = _MOST_INDEXES
        """How many of them may still be read."""
        self._window = b""
        self._window_at = 0
        self._file = os.open(content or path, os.O_RDONLY | os.O_CLOEXEC)
        self._size = os.fstat(self._file).st_size

    @property
    def is_being_written(self) -> bool:
        """Whether a recorder has it open."""
        try:
            fcntl.flock(self._file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:  # some file systems have no locks
            return False
        fcntl.flock(self._file, fcntl.LOCK_UN)
        return False

    @property
    def is_compressed(self) -> bool:
        """Whether its first chunk is compressed."""
        chunk = next((segment for segment in self._segments if segment.is_chunk), None)
        if chunk is None:
            return False
        try:
            return bool(_chunk_head(self._read(chunk.offset, min(chunk.length, 1024)))[0])
        except ValueError:
            return False

    def close(self) -> None:
        """Close the file."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1
        self._loaded.clear()

    def _walk(self, segment: Segment) -> Iterator[tuple[int, int, Buffer]]:
        """The records of a segment: opcode, position of the beginning, and the buffer."""
        data = self._load(segment)
        position, size = 0, len(data)
        unpack_record = RECORD.unpack_from
        while position + 9 <= size:
            opcode, length = unpack_record(data, position)
            after = position + 9 + length
            if after > size or (opcode == Opcode.MESSAGE and length < 22):
                break
            yield opcode, position, data
            position = after
        if position != size:
            self._problem(segment.offset, f"a record in it, at {position}, does not end within it")

    def _load(self, segment: Segment) -> Buffer:
        """The records of a segment; empty if they can't be read."""
        data = self._loaded.get(segment.offset)
        if data is not None:
            return data
        try:
            data = (
                self._read_chunk(segment) if segment.is_chunk else self._read(segment.offset, segment.length)
            )
        except (ValueError, OSError, MemoryError) as error:
            why = str(error) or type(error).__name__
            self._problem(segment.offset, f"a chunk{self._how_many(segment)} is skipped: {why}")
            data = b""
        self._loaded[segment.offset] = data
        self._loaded_size += len(data)
        while self._loaded_size > _LOADED and len(self._loaded) > 1:
            self._loaded_size -= len(self._loaded.popitem(last=False)[1])
        return data

    def _how_many(self, segment: Segment) -> str:
        """The number of messages in a chunk as text, if its message indexes have it."""
        count, position = 0, segment.offset + segment.length
        while self._indexes and len(self.problems) < _MAX_PROBLEMS:
            self._indexes -= 1
            head = self._read(position, 9 + INDEX_HEAD.size)
            if len(head) < 9 + INDEX_HEAD.size or head[0] != Opcode.MESSAGE_INDEX:
                return f" with {counted(count, 'message')}" if count else ""
            count += INDEX_HEAD.unpack_from(head, 9)[1] // 16
            position += RECORD.size + RECORD.unpack_from(head)[1]
        return ""

    def _read_chunk(self, segment: Segment) -> Buffer:
        """Read a chunk. Raises ValueError if it is not complete."""
        content = self._read(segment.offset, segment.length)
        if len(content) < segment.length or segment.length < 9:
            raise ValueError("the file ends within it")
        opcode, length = RECORD.unpack_from(content)
        if opcode != Opcode.CHUNK or length != segment.length - 9:
            raise ValueError("it is none")
        compression, begin, size, crc = _chunk_head(content)
        stored = int.from_bytes(content[begin - 8 : begin], "little")
        if begin + stored > len(content):
            raise ValueError("it is longer than its record")
        data = decompress(compression, memoryview(content)[begin : begin + stored], size)
        if crc and zlib.crc32(data) != crc:
            raise ValueError("its CRC is wrong")
        return data

    def _read(self, offset: int, size: int) -> bytes:
        """Read `size` bytes of the file; fewer at its end, and none outside of it."""
        if not 0 <= offset < self._size:
            return b""
        content = os.pread(self._file, min(size, self._size - offset), offset)
        while len(content) < size and (
            more := os.pread(self._file, size - len(content), offset + len(content))
        ):
            content += more
        return content

    def _problem(self, offset: int | None, text: str) -> None:
        problem = Problem(str(self.path), offset, text)
        if len(self.problems) < _MAX_PROBLEMS and problem not in self.problems:
            self.problems.append(problem)

    def _peek(self, position: int, size: int) -> bytes:
        """Read a few bytes. The bytes after them are also read into a buffer, except after a far jump."""
        begin = position - self._window_at
        if not 0 <= begin <= len(self._window) - size:
            is_near = 0 <= begin <= len(self._window)
            self._window, self._window_at = (
                self._read(position, _WINDOW if is_near else max(size, 4096)),
                position,
            )
            begin = 0
        return self._window[begin : begin + size]

    def _unload(self) -> None:
        """Remove all chunks from memory."""
        self._loaded.clear()
        self._loaded_size = 0


def _chunk_head(content: bytes) -> tuple[str, int, int, int]:
    """Compression, offset of the records, their unpacked size, and their CRC. Raises ValueError."""
    at = 9 + CHUNK_HEAD.size
    if len(content) < at + 4:
        raise ValueError("it is too short")
    _, _, size, crc = CHUNK_HEAD.unpack_from(content, 9)
    begin = at + 4 + int.from_bytes(content[at : at + 4], "little")
    if begin + 8 > len(content):
        raise ValueError("it is too short")
    return content[at + 4 : begin].decode(errors="replace"), begin + 8, size, crc
