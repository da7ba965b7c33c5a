"""Gathers messages into a chunk of an MCAP file. Pure.

This is the hot path of recording: no part is joined before the chunk is closed, and long parts never are.
"""

from array import array
from collections.abc import Sequence
from itertools import accumulate, repeat
from typing import Any

from bus_bag.core import crc32
from bus_bag.storage.bag_file import Buffer, Records, Stamp
from bus_bag.storage.mcap_format import CHUNK_HEAD, MESSAGE, RECORD, Opcode

__all__ = ["Chunk", "ChunkBuilder"]

LONG = 16 * 1024
"""Parts of this size or more are not copied. Shorter ones are joined, because each part costs time in
writev."""
_HEAD = MESSAGE.size
_BEFORE = _HEAD - 9
"""Size of a record's content before the message."""
_MAX_SEQUENCE = 0xFFFFFFFF
_MAX_TIME = (1 << 64) - 1
_pack = MESSAGE.pack


class Chunk:
    """Messages to write together: records as buffers, in order."""

    __slots__ = ("end", "has_long_parts", "index", "pieces", "size", "start")

    def __init__(
        self,
        pieces: list[Buffer],
        size: int,
        index: dict[int, "array[int]"],
        start: int,
        end: int,
        *,
        has_long_parts: bool,
    ) -> None:
        self.pieces = pieces
        self.size = size
        self.index = index
        """Channel -> log time and offset of each message, alternating."""
        self.has_long_parts = has_long_parts
        self.start, self.end = start, end
        """The first and the last log time."""

    @property
    def counts(self) -> dict[int, int]:
        """Channel -> number of messages."""
        return {channel: len(entries) // 2 for channel, entries in self.index.items()}

    def crc(self) -> int:
        """CRC of all records."""
        value = 0
        for piece in self.pieces:
            value = crc32(piece, value)
        return value

    def head(self, compression: str, stored: int, crc: int) -> bytes:
        """The beginning of the chunk's record, if the records after it have `stored` bytes."""
        name = compression.encode()
        length = CHUNK_HEAD.size + 4 + len(name) + 8 + stored
        return b"".join(
            (
                RECORD.pack(Opcode.CHUNK, length),
                CHUNK_HEAD.pack(self.start, self.end, self.size, crc),
                len(name).to_bytes(4, "little"),
                name,
                stored.to_bytes(8, "little"),
            )
        )

    def message_indexes(self, offset: int) -> tuple[list[bytes], dict[int, int]]:
        """Message indexes: their records, and the offset of each record if the first is at `offset`."""
        records, offsets = [], {}
        for channel, entries in self.index.items():
            content = entries.tobytes()
            record = b"".join(
                (
                    RECORD.pack(Opcode.MESSAGE_INDEX, 6 + len(content)),
                    channel.to_bytes(2, "little"),
                    len(content).to_bytes(4, "little"),
                    content,
                )
            )
            records.append(record)
            offsets[channel] = offset
            offset += len(record)
        return records, offsets


class ChunkBuilder:
    """Gathers messages. Added parts must not change before the chunk is written."""

    __slots__ = ("_end", "_has_long_parts", "_index", "_pieces", "_short", "_start", "size")

    def __init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self.size = 0
        self._pieces: list[Buffer] = []
        self._short: list[Buffer] = []
        self._index: dict[int, array[int]] = {}
        self._has_long_parts = False
        self._start = self._end = -1

    def _entries(self, channel: int, first: int, last: int) -> "array[int]":
        """The index of a channel, to add messages with log times from `first` to `last`."""
        if first < self._start or not self._index:
            self._start = first
        if last > self._end:
            self._end = last
        entries = self._index.get(channel)
        if entries is None:
            entries = self._index[channel] = array("Q")
        return entries

    def add(
        self, channel: int, log_time: int, publish_time: int, sequence: int, parts: Sequence[Buffer]
    ) -> int:
        """Add a message; returns the bytes that it uses. Each part's length must be its number of bytes."""
        length = 22
        for part in parts:
            length += len(part)
        head = _pack(5, length, channel, sequence & _MAX_SEQUENCE, log_time, publish_time & _MAX_TIME)
        entries = self._entries(channel, log_time, log_time)
        entries.append(log_time)
        entries.append(self.size)
        short = self._short
        short.append(head)
        if length < LONG:
            short += parts
        else:
            for part in parts:
                if len(part) < LONG:
                    self._short.append(part)
                else:
                    self._has_long_parts = True
                    self._add_piece(part)
        length += 9
        self.size += length
        return length

    def add_many(self, channel: int, stamps: Sequence[Stamp], messages: Sequence[Buffer]) -> int:
        """Add short messages of one part, like `add` for each; returns the bytes that they use.

        Each step handles all of them in C: a Python loop would cost as much as all its work.
        """
        count = len(messages)
        if not count:
            return 0
        publish_times, log_times, sequences, _, _ = zip(*stamps, strict=True)
        if max(sequences) > _MAX_SEQUENCE:
            sequences = tuple(one & _MAX_SEQUENCE for one in sequences)
        if max(publish_times) > _MAX_TIME or min(publish_times) < 0:  # the stamps of a hostile publisher
            publish_times = tuple(one & _MAX_TIME for one in publish_times)
        lengths = [length + _BEFORE for length in map(len, messages)]
        begin = self.size
        offsets = list(accumulate([length + 9 for length in lengths], initial=begin))
        self.size = offsets.pop()
        records: list[Any] = [None] * (2 * count)
        records[::2] = map(
            _pack, repeat(5, count), lengths, repeat(channel), sequences, log_times, publish_times
        )
        records[1::2] = messages
        self._short += records
        places: list[int] = [0] * (2 * count)
        places[::2] = log_times
        places[1::2] = offsets
        entries = self._entries(channel, min(log_times), max(log_times))
        entries += array("Q", places)
        return self.size - begin

    def add_packed(self, channel: int, log_time: int, data: bytes, records: Records) -> int:
        """See `PackGatherer`."""
        made = records(data, channel, log_time, self.size)
        if made is None:
            return 0
        piece, places = made
        self._entries(channel, log_time, log_time).frombytes(places)
        if len(piece) < LONG:
            self._short.append(piece)
        else:
            self._add_piece(piece)
        self.size += len(piece)
        return len(piece)

    def _add_piece(self, piece: Buffer) -> None:
        """Add a piece that is not joined with others."""
        if self._short:
            self._pieces.append(b"".join(self._short))
            self._short = []
        self._pieces.append(piece)

    def close(self) -> Chunk | None:
        """Remove and return the gathered messages; None if there are none."""
        if not self._index:
            return None
        if self._short:
            self._pieces.append(b"".join(self._short))
        chunk = Chunk(
            self._pieces,
            self.size,
            self._index,
            self._start,
            self._end,
            has_long_parts=self._has_long_parts,
        )
        self._begin()
        return chunk
