"""Records of MCAP files: their layout, and the package `mcap`, which reads and writes all except messages.

Messages have a separate layout here because of their number: reader and writer handle whole chunks.
"""

import struct
from importlib import import_module
from typing import Any

from bus.base.optional import how_to_install
from bus_bag.errors import BagError

__all__ = [
    "CHUNK_HEAD",
    "FOOTER_SIZE",
    "MAGIC",
    "MESSAGE",
    "RECORD",
    "Opcode",
    "decode",
    "encode",
    "package",
]

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")
"""The head of every record: opcode, length of the rest."""
MESSAGE = struct.Struct("<BQHIQQ")
"""Opcode, length, channel, sequence, log time, publish time; then the data."""
CHUNK_HEAD = struct.Struct("<QQQI")
"""First and last log time, size and CRC of the records; then the compression, as a text."""
FOOTER_SIZE = 9 + 20


class Opcode:
    """The kinds of records."""

    HEADER = 1
    FOOTER = 2
    SCHEMA = 3
    CHANNEL = 4
    MESSAGE = 5
    CHUNK = 6
    MESSAGE_INDEX = 7
    CHUNK_INDEX = 8
    ATTACHMENT = 9
    ATTACHMENT_INDEX = 10
    STATISTICS = 11
    METADATA = 12
    METADATA_INDEX = 13
    SUMMARY_OFFSET = 14
    DATA_END = 15


def package(module: str = "mcap.records") -> Any:
    """Import a module of the package `mcap`, or a module installed with it. Raises BagError if it is
    missing."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if error.name not in (module, module.partition(".")[0]):
            raise
        missing = error.name.partition(".")[0]
        raise BagError(f"bags need the package {missing}: {how_to_install('mcap')}") from None


def encode(*records: Any) -> bytes:
    """Encode records of `mcap.records`."""
    builder = package("mcap.data_stream").RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())


def decode(kind: str, content: bytes) -> Any:
    """Decode a record of `mcap.records` with the name `kind`. Raises ValueError if `content` is not one."""
    import io

    try:
        return getattr(package(), kind).read(package("mcap.data_stream").ReadDataStream(io.BytesIO(content)))
    except BagError:
        raise
    except Exception as error:  # a parser may raise any error for unknown bytes
        raise ValueError(f"no valid {kind} record ({error or type(error).__name__})") from None
