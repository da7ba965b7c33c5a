"""Repairs an MCAP file: writes it again beside the old one, with an index, and replaces the old one."""

import os
from pathlib import Path

from bus_bag.errors import BagError
from bus_bag.metadata import BagMetadata, to_record
from bus_bag.storage.chunk import ChunkBuilder
from bus_bag.storage.mcap_reader import McapFile
from bus_bag.storage.mcap_writer import PRESETS, McapWriter

__all__ = ["rewrite"]


def rewrite(file: McapFile, metadata: BagMetadata) -> None:
    """Write all readable messages of `file`, and the known metadata of its bag, into a new file.

    The old file stays until the new one is on the disk. Raises BagError or OSError if the new file can't be
    written; then the old file is unchanged.
    """
    if file.is_being_written:
        raise BagError(f"'{file.path}' is still being written")
    beside = file.path.with_suffix(".mcap.tmp")
    beside.unlink(missing_ok=True)
    try:
        _write(file, beside, metadata)
        beside.replace(file.path)
    finally:
        beside.unlink(missing_ok=True)


def _write(file: McapFile, path: Path, metadata: BagMetadata) -> None:
    preset = PRESETS["zstd_fast" if file.is_compressed else "none"]
    writer = McapWriter(path, preset)
    try:
        for schema in file.schemas.values():
            writer.add_schema(schema)
        for channel in file.channels.values():
            writer.add_channel(channel)
        builder = ChunkBuilder()
        for channel_id, log_time, publish_time, sequence, data in file.in_file_order():
            builder.add(channel_id, log_time, publish_time, sequence, [data])
            if builder.size >= preset.chunk_bytes and (chunk := builder.close()):
                writer.write_chunk(chunk)
        if chunk := builder.close():
            writer.write_chunk(chunk)
        for name, texts in file.records:
            writer.write_metadata(name, texts)
        writer.write_metadata("rosbag2", {"serialized_metadata": to_record(metadata)})
        writer.close()
    finally:
        writer.abandon()
    with path.open("rb") as written:
        os.fsync(written.fileno())
