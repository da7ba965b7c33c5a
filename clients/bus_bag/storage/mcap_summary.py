"""The end of an MCAP file: copies of its types and topics, and positions of everything. Pure."""

import zlib
from collections.abc import Mapping, Set
from typing import Any

from bus_bag.storage.mcap_format import MAGIC, Opcode, encode, package

__all__ = ["McapSummary"]


class McapSummary:
    """Gathers the records of a summary while a file is written."""

    def __init__(self) -> None:
        self.size = 0
        """Estimated size of the summary; rather too large than too small."""
        self._schemas: dict[int, bytes] = {}
        self._channels: dict[int, bytes] = {}
        self._chunks: list[bytes] = []
        self._metadata: list[tuple[int, int, str]] = []
        """Offset, length and name of each metadata record."""

    def has_channels(self, channels: Set[int]) -> bool:
        """Whether all of these were added."""
        return channels <= self._channels.keys()

    def add_schema(self, schema: Any) -> bytes:
        """Add a schema, a record of `mcap.records`; returns its bytes."""
        record = self._schemas[schema.id] = encode(schema)
        self.size += len(record)
        return record

    def add_channel(self, channel: Any) -> bytes:
        """Add a channel, a record of `mcap.records`; returns its bytes."""
        record = self._channels[channel.id] = encode(channel)
        self.size += len(record)
        return record

    def add_chunk(self, index: bytes) -> None:
        """Add the index record of a chunk."""
        self._chunks.append(index)
        self.size += len(index)

    def add_metadata(self, offset: int, length: int, name: str) -> None:
        """Add a metadata record that was written at `offset`."""
        self._metadata.append((offset, length, name))
        self.size += length + 100

    def take_back(self, offset: int, *, has_chunk: bool) -> None:
        """Shorten the file to `offset`. `has_chunk`: the last chunk is removed, too."""
        if has_chunk:
            self._chunks.pop()
        self._metadata = [one for one in self._metadata if one[0] < offset]

    def encode(self, start: int, counts: Mapping[int, int], starting_time: int, end_time: int) -> bytes:
        """All bytes from the end of the data on; `start` is the position of that end. `counts`: channel ->
        number of messages."""
        records = package()
        data_end = encode(records.DataEnd(data_section_crc=0))
        start += len(data_end)
        statistics = records.Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(counts),
            chunk_count=len(self._chunks),
            message_count=sum(counts.values()),
            message_start_time=starting_time,
            message_end_time=end_time,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        indexes = [
            records.MetadataIndex(offset=offset, length=length, name=name)
            for offset, length, name in self._metadata
        ]
        groups = [
            (Opcode.SCHEMA, b"".join(self._schemas.values())),
            (Opcode.CHANNEL, b"".join(self._channels.values())),
            (Opcode.STATISTICS, encode(statistics)),
            (Opcode.CHUNK_INDEX, b"".join(self._chunks)),
            (Opcode.METADATA_INDEX, encode(*indexes)),
        ]
        offsets = []
        position = start
        for opcode, group in groups:
            if group:
                offsets.append(
                    records.SummaryOffset(group_opcode=opcode, group_start=position, group_length=len(group))
                )
                position += len(group)
        summary = b"".join([group for _, group in groups])
        summary_offsets = encode(*offsets)
        footer = encode(records.Footer(summary_start=start, summary_offset_start=position, summary_crc=0))
        crc = zlib.crc32(summary + summary_offsets + footer[:-4])
        return b"".join((data_end, summary, summary_offsets, footer[:-4], crc.to_bytes(4, "little"), MAGIC))
