"""Reads one MCAP file: by its index, or in one pass if it has no index or is cut off.

A file may contain any bytes. Reading it ends, raises only BagError, and keeps one chunk and the index in
memory. Unreadable parts become a Problem and are skipped.
"""

import struct
import zlib
from array import array
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import islice, repeat
from operator import le
from pathlib import Path
from typing import Any

from bus_bag.errors import BagError
from bus_bag.metadata import BagMetadata, TopicMetadata, from_record
from bus_bag.profiles import profiles_from_yaml
from bus_bag.storage.bag_file import BagMessage, Buffer, Order, Summary
from bus_bag.storage.mcap_bytes import INDEX_HEAD, McapBytes, Segment
from bus_bag.storage.mcap_format import CHUNK_HEAD, FOOTER_SIZE, MAGIC, MESSAGE, RECORD, Opcode, decode
from bus_bag.storage.merge import Place, merge
from bus_bag.storage.stretches import Stretch, split

__all__ = ["McapFile"]

_MAX_RECORD = 64 << 20
"""The largest size of records other than messages and chunks. A larger size counts as damage."""
_RUN = 1 << 20
"""Most bytes of messages outside of chunks that are read together."""
_MOST_WAITING = 20_000_000
"""Most messages of chunks that overlap in time; no recorder makes so many."""
_SHORT = 64 << 10
"""Records up to this size are read together with the records around them."""
_HEAD = MESSAGE.size
_TIME_AT: Mapping[Order, int] = {"log_time": 4, "publish_time": 5}
"""Indexes of the times in the head of a message."""
_CHUNK_INDEX = struct.Struct("<QQQQI")
"""First and last log time, offset, length, size of the entries with the position of each channel's index."""
_INDEX_ENTRY = struct.Struct("<HQ")


class McapFile(McapBytes):
    """See `BagFile`. Raises BagError if it is not an MCAP file, OSError if it can't be opened."""

    storage = "mcap"

    def __init__(self, path: Path, content: Path | None = None) -> None:
        super().__init__(path, content)
        self.summary = Summary()
        self.topics: dict[str, TopicMetadata] = {}
        self.extra: dict[str, dict[str, str]] = {}
        self.definitions: dict[str, str] = {}
        self.records: list[tuple[str, dict[str, str]]] = []
        """The metadata records: name, texts."""
        self.attachments = 0
        """The number of attachments, which are not read."""
        self.is_cut = False
        self.has_index = False
        self.schemas: dict[int, Any] = {}
        """Schemas by their numbers, as records of `mcap.records`. Channels are kept in the same way."""
        self.channels: dict[int, Any] = {}
        self._channels: dict[int, str] = {}
        """Channel -> topic, for readable topics."""
        self._refused: set[int] = set()
        self._waiting = 0
        self._metadata_read: set[int] = set()
        """Offsets of the metadata records that the index has named so far."""
        self._metadata_bytes = 0
        """Their bytes."""
        try:
            self._open()
        except BaseException:
            self.close()
            raise

    @property
    def has_message_index(self) -> bool:
        """Whether the index also has positions of messages in chunks. Other readers need these to begin
        anywhere."""
        return self.has_index and all(one.channels is not None for one in self._segments)

    def metadata(self) -> BagMetadata | None:
        """The last `rosbag2` record, which describes the whole bag."""
        for name, texts in reversed(self.records):
            if name == "rosbag2" and texts.get("serialized_metadata"):
                try:
                    return from_record(texts["serialized_metadata"])
                except ValueError as error:
                    self._problem(None, f"its rosbag2 record can't be read: {error}")
        return None

    def in_file_order(self) -> Iterator[tuple[int, int, int, int, Buffer]]:
        """Messages in the order of the file: channel, log time, publish time, sequence, data."""
        for segment in self._segments:
            for opcode, position, data in self._walk(segment):
                if opcode == Opcode.MESSAGE:
                    _, length, channel, sequence, *times = MESSAGE.unpack_from(data, position)
                    if channel in self._channels:
                        begin = position + _HEAD
                        content = memoryview(data)[begin : begin + length - 22]
                        yield (channel, *times, sequence, content)

    def messages(self, start: int | None, topics: frozenset[str] | None, by: Order) -> Iterator[BagMessage]:
        """Messages in order; `start`: from that time on; `topics`: only of these."""
        wanted, segments = self._find(topics)
        if by == "log_time":
            places = [
                (segment.start, segment) for segment in segments if start is None or segment.end >= start
            ]
        else:
            places = self._by_publish_time(segments, wanted, start)

        def place(begin: int, segment: Segment) -> Place[tuple[Segment, int]]:
            return Place(begin, lambda: self._in_order(segment, wanted, start, by))

        for segment, position in merge([place(begin, segment) for begin, segment in places]):
            if (message := self._message(segment, position, wanted)) is not None:
                yield message

    def stretches(self, least: int, topics: frozenset[str], by: Order) -> Iterator[Stretch]:
        """See `BagFile`."""
        wanted, segments = self._find(topics)
        for segment in segments:
            if by == "log_time" and segment.end - segment.start <= least:
                yield Stretch(segment.start, segment.end)
            else:
                times, _ = self._entries(segment, wanted, _TIME_AT[by])
                yield from split(sorted(times), least)

    def _find(self, topics: frozenset[str] | None) -> tuple[dict[int, str], list[Segment]]:
        """The channels of these topics, or of all, and the segments that may have messages of them."""
        wanted = {
            channel: topic for channel, topic in self._channels.items() if topics is None or topic in topics
        }
        segments = [
            segment
            for segment in self._segments
            if segment.channels is None or not segment.channels.isdisjoint(wanted)
        ]
        return wanted, segments

    def _by_publish_time(
        self, segments: list[Segment], wanted: dict[int, str], start: int | None
    ) -> list[tuple[int, Segment]]:
        """Messages by publish time. It needs all messages, because an index only has log times."""
        places = []
        for segment in segments:
            times, _ = self._entries(segment, wanted, _TIME_AT["publish_time"])
            if times and (start is None or max(times) >= start):
                places.append((min(times), segment))
        return places

    def _in_order(
        self, segment: Segment, wanted: dict[int, str], start: int | None, by: Order
    ) -> Iterator[tuple[int, tuple[Segment, int]]]:
        """Messages in order. It sorts times and positions, because messages themselves would keep their
        chunks in memory."""
        times, positions = self._entries(segment, wanted, _TIME_AT[by])
        if self._waiting + len(times) > _MOST_WAITING:
            self._problem(segment.offset, f"{len(times)} messages are skipped: too many overlap in time")
            return
        self._waiting += len(times)
        if not all(map(le, times, islice(times, 1, None))):
            order = sorted(range(len(times)), key=times.__getitem__)
            positions = array("Q", map(positions.__getitem__, order))
            times = array("Q", sorted(times))
        first = 0 if start is None else bisect_left(times, start)
        entries = zip(times, zip(repeat(segment), positions, strict=False), strict=False)
        try:
            yield from islice(entries, first, None)
        finally:
            self._waiting -= len(times)

    def _message(self, segment: Segment, position: int, wanted: dict[int, str]) -> BagMessage | None:
        """The message at a position in a segment; None if its chunk could not be read again."""
        data = self._loaded.get(segment.offset) or self._load(segment)
        if position + _HEAD > len(data):
            return None
        _, length, channel, sequence, log_time, publish_time = MESSAGE.unpack_from(data, position)
        begin = position + _HEAD
        content = memoryview(data)[begin : begin + length - 22]
        return BagMessage(wanted[channel], log_time, publish_time, sequence, content)

    def _entries(
        self, segment: Segment, wanted: dict[int, str], at: int
    ) -> tuple["array[int]", "array[int]"]:
        """Times and positions of the wanted messages; `at`: index of the time in heads."""
        times, positions = array("Q"), array("Q")
        unpack_head = MESSAGE.unpack_from
        for opcode, position, data in self._walk(segment):
            if opcode != Opcode.MESSAGE:
                continue
            head = unpack_head(data, position)
            if head[2] in wanted:
                times.append(head[at])
                positions.append(position)
            elif head[2] not in self._channels and head[2] not in self._refused:
                self._refused.add(head[2])
                self._problem(segment.offset, f"messages of channel {head[2]}, which is not described")
        return times, positions

    def _open(self) -> None:
        if not self._size:
            raise BagError(f"'{self.path}' is empty")
        if self._read(0, len(MAGIC)) != MAGIC:
            raise BagError(f"'{self.path}' is not an MCAP file: its first bytes are different")
        try:
            self._read_index()
            self.has_index = True
        except ValueError as error:
            self._forget()
            if str(error):
                self._problem(self._size, str(error))
            self._scan()

    def _forget(self) -> None:
        self.summary = Summary()
        for one in (self.topics, self.extra, self.definitions, self.schemas, self.channels, self._channels):
            one.clear()
        self.records.clear()
        self._segments.clear()

    def _read_index(self) -> None:
        """Read the index. Raises ValueError if no index is usable; its text is empty if there is nothing to
        report."""
        begin = self._size - len(MAGIC) - FOOTER_SIZE
        footer = self._read(begin, FOOTER_SIZE + len(MAGIC))
        if (
            begin < len(MAGIC)
            or footer[FOOTER_SIZE:] != MAGIC
            or footer[:9] != RECORD.pack(Opcode.FOOTER, 20)
        ):
            self.is_cut = True
            raise ValueError("")
        start = int.from_bytes(footer[9:17], "little")
        if not start:
            raise ValueError("")
        if not len(MAGIC) <= start <= begin:
            raise ValueError("its footer points outside the file")
        self._check_summary(start, begin, footer)
        statistics = None
        for opcode, _, content in self._records(start, begin):
            if opcode == Opcode.STATISTICS:
                statistics = decode("Statistics", content)
            elif opcode == Opcode.CHUNK_INDEX:
                self._add_index(content)
            elif opcode == Opcode.METADATA_INDEX:
                index = decode("MetadataIndex", content)
                self._read_metadata(index.offset)
            else:
                self._describe(opcode, content)
        if statistics is None:
            raise ValueError("")
        if statistics.message_count and not self._segments:
            raise ValueError("")
        counts: Counter[str] = Counter()
        for channel, count in statistics.channel_message_counts.items():
            if channel in self._channels:
                counts[self._channels[channel]] += count
        self.summary = Summary(
            statistics.message_count, statistics.message_start_time, statistics.message_end_time, dict(counts)
        )

    def _check_summary(self, start: int, end: int, footer: bytes) -> None:
        expected = int.from_bytes(footer[25:29], "little")
        if not expected:
            return
        crc, position = 0, start
        while position < end:
            piece = self._read(position, min(_RUN, end - position))
            crc = zlib.crc32(piece, crc)
            position += len(piece) or end
        if zlib.crc32(footer[:25], crc) != expected:
            raise ValueError("its index is damaged: its CRC is wrong")

    def _records(self, position: int, end: int) -> Iterator[tuple[int, int, bytes]]:
        """Opcode, offset and content of the records between two positions. Raises ValueError for an invalid
        record."""
        while position < end:
            opcode, length = RECORD.unpack(self._peek(position, 9)) if position + 9 <= end else (0, end)
            if length > min(_MAX_RECORD, end - position - 9):
                raise ValueError(f"its index is damaged at byte {position}")
            is_short = length < _SHORT
            yield (
                opcode,
                position,
                self._peek(position + 9, length) if is_short else self._read(position + 9, length),
            )
            position += 9 + length

    def _add_index(self, content: bytes) -> None:
        """Add the index of a chunk. `mcap.records` would be too slow: a long recording has 100,000 of
        them."""
        if len(content) < _CHUNK_INDEX.size:
            raise ValueError("no valid ChunkIndex record")
        start, end, offset, length, size = _CHUNK_INDEX.unpack_from(content)
        entries = content[_CHUNK_INDEX.size : _CHUNK_INDEX.size + size]
        if len(entries) != size or size % 10:
            raise ValueError("no valid ChunkIndex record")
        channels = frozenset(channel for channel, _ in _INDEX_ENTRY.iter_unpack(entries))
        self._segments.append(Segment(offset, length, start, end, channels or None, True))

    def _read_metadata(self, offset: int) -> None:
        try:
            opcode, length = RECORD.unpack(self._read(offset, 9))
        except struct.error:
            opcode, length = 0, 0
        if opcode != Opcode.METADATA or length > _MAX_RECORD:
            self._problem(offset, "no metadata record, but the index says so")
            return
        if offset in self._metadata_read:
            return
        self._metadata_read.add(offset)
        self._metadata_bytes += length
        if self._metadata_bytes > self._size:
            raise ValueError("its index names more metadata than the file has")
        try:
            self._describe(opcode, self._read(offset + 9, length))
        except ValueError as error:
            self._problem(offset, str(error))

    def _describe(self, opcode: int, content: bytes) -> None:
        """Handle a schema, a channel or a metadata record. Raises ValueError if it is not valid."""
        if opcode == Opcode.SCHEMA:
            schema = decode("Schema", content)
            self.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            self._add_channel(decode("Channel", content))
        elif opcode == Opcode.METADATA:
            record = decode("Metadata", content)
            self.records.append((record.name, record.metadata))

    def _add_channel(self, channel: Any) -> None:
        if channel.id in self._channels or channel.id in self._refused:
            return
        schema = self.schemas.get(channel.schema_id)
        type_name = schema.name if schema else ""
        known = self.topics.get(channel.topic)
        if known is not None and known.type != type_name:
            self._refused.add(channel.id)
            self._problem(
                None,
                f"topic '{channel.topic}' has types {known.type} and {type_name}; only the first is read",
            )
            return
        self._channels[channel.id] = channel.topic
        self.channels[channel.id] = channel
        texts = dict(channel.metadata)
        profiles = texts.pop("offered_qos_profiles", "")
        try:
            offered = profiles_from_yaml(profiles)
        except ValueError as error:
            offered = ()
            self._problem(None, f"topic '{channel.topic}': {error}")
        if known is not None:
            return
        self.topics[channel.topic] = TopicMetadata(
            channel.topic, type_name, channel.message_encoding, offered, texts.pop("topic_type_hash", "")
        )
        self.extra[channel.topic] = texts
        if schema and schema.encoding == "ros2msg":
            self.definitions.setdefault(schema.name, schema.data.decode(errors="replace"))

    def _scan(self) -> None:
        """Read all records once, because there is no index of them."""
        scan = _Scan()
        position = len(MAGIC)
        chunk: Segment | None = None
        while position + 9 <= self._size:
            opcode, length = RECORD.unpack_from(self._peek(position, 9))
            if length > self._size - position - 9 or not opcode or opcode == Opcode.DATA_END:
                break
            if opcode == Opcode.MESSAGE_INDEX and chunk is not None and length >= 6:
                channel, size = INDEX_HEAD.unpack(self._peek(position + 9, 6))
                scan.indexed[channel] += size // 16
            else:
                self._settle(chunk, scan)
                chunk = None
                if opcode == Opcode.CHUNK:
                    chunk = self._add_chunk(position, length)
                elif opcode == Opcode.MESSAGE and length >= 22:
                    self._add_message(position, length, scan)
                elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA):
                    self._describe_at(position, length)
                elif opcode == Opcode.ATTACHMENT:
                    self.attachments += 1
            position += 9 + length
        scan.indexed.clear()  # the last chunk's indexes may be incomplete
        self._settle(chunk, scan)
        self._end_scan(position, scan)

    def _end_scan(self, position: int, scan: "_Scan") -> None:
        is_end = self._peek(position, 1) == bytes((Opcode.DATA_END,))
        rest = self._size - position
        if self.is_cut:
            more = "" if is_end or not rest else f"; the last {rest:,} bytes are not a whole record"
            state = "is still being written" if self.is_being_written else "was not closed"
            self._problem(position, f"the file {state}{more}")
        elif not is_end:
            self._problem(position, "no record begins here; the rest is not read")
        counts: Counter[str] = Counter()
        for channel, count in scan.counts.items():
            if channel in self._channels:
                counts[self._channels[channel]] += count
        times = [segment for segment in self._segments if segment.start <= segment.end]
        self.summary = Summary(
            counts.total(),
            min((segment.start for segment in times), default=0),
            max((segment.end for segment in times), default=0),
            dict(counts),
        )

    def _add_chunk(self, position: int, length: int) -> Segment:
        content = self._peek(position + 9, min(length, CHUNK_HEAD.size))
        start, end = struct.unpack("<QQ", content[:16]) if len(content) >= 16 else (0, 0)
        segment = Segment(position, 9 + length, start, end, None, True)
        self._segments.append(segment)
        return segment

    def _add_message(self, position: int, length: int, scan: "_Scan") -> None:
        _, _, channel, _, log_time, _ = MESSAGE.unpack(self._peek(position, _HEAD))
        scan.counts[channel] += 1
        last = self._segments[-1] if self._segments else None
        if last is None or last.is_chunk or last.offset + last.length != position or last.length > _RUN:
            self._segments.append(Segment(position, 9 + length, log_time, log_time, None, False))
        else:
            last.length += 9 + length
            last.start, last.end = min(last.start, log_time), max(last.end, log_time)

    def _settle(self, chunk: Segment | None, scan: "_Scan") -> None:
        """Count the messages of a chunk: by its message indexes, or, without these, by its contents.

        Its contents are also read if it has messages of an unknown channel, because its description may be in
        the chunk.
        """
        if chunk is None:
            return
        if scan.indexed and self._channels.keys() >= scan.indexed.keys():
            chunk.channels = frozenset(scan.indexed)
            scan.counts.update(scan.indexed)
        else:
            for opcode, position, data in self._walk(chunk):
                if opcode == Opcode.MESSAGE:
                    scan.counts[MESSAGE.unpack_from(data, position)[2]] += 1
                elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    _, length = RECORD.unpack_from(data, position)
                    self._try_describe(
                        chunk.offset, opcode, bytes(data[position + 9 : position + 9 + length])
                    )
            self._unload()
        scan.indexed = Counter()

    def _describe_at(self, position: int, length: int) -> None:
        if length > _MAX_RECORD:
            self._problem(position, f"a record of {length:,} bytes is skipped")
        else:
            opcode = self._peek(position, 1)[0]
            self._try_describe(position, opcode, self._read(position + 9, length))

    def _try_describe(self, offset: int, opcode: int, content: bytes) -> None:
        try:
            self._describe(opcode, content)
        except ValueError as error:
            self._problem(offset, str(error))


class _Scan:
    """Counters of one pass through a file."""

    def __init__(self) -> None:
        self.counts: Counter[int] = Counter()
        """Channel -> number of messages."""
        self.indexed: Counter[int] = Counter()
        """Channel -> number of messages of the current chunk, by the message indexes after it."""
