"""Identifiers of RTPS: participants, readers and writers.

A GUID has 16 bytes: the prefix of its participant (12), and the id of the entity in it (4).
"""

from collections.abc import Mapping
from typing import Final

__all__ = [
    "CYCLONE",
    "DISCOVERY_READERS",
    "FAST_DDS",
    "GUID_BYTES",
    "OUR_VENDOR",
    "PARTICIPANT",
    "PREFIX_BYTES",
    "PUBLICATIONS_READER",
    "PUBLICATIONS_WRITER",
    "SPDP_READER",
    "SPDP_WRITER",
    "SUBSCRIPTIONS_READER",
    "SUBSCRIPTIONS_WRITER",
    "UNKNOWN_ENTITY",
    "UNKNOWN_PREFIX",
    "is_reader_id",
    "is_writer_id",
    "reader_id",
    "writer_id",
]

PREFIX_BYTES: Final = 12
GUID_BYTES: Final = 16

OUR_VENDOR: Final = b"\x01\x7f"
"""No vendor has this id."""
FAST_DDS: Final = b"\x01\x0f"
CYCLONE: Final = b"\x01\x10"

UNKNOWN_PREFIX: Final = bytes(PREFIX_BYTES)
UNKNOWN_ENTITY: Final = bytes(4)
PARTICIPANT: Final = bytes.fromhex("000001c1")
SPDP_WRITER: Final = bytes.fromhex("000100c2")
SPDP_READER: Final = bytes.fromhex("000100c7")
PUBLICATIONS_WRITER: Final = bytes.fromhex("000003c2")
"""Announces writers."""
PUBLICATIONS_READER: Final = bytes.fromhex("000003c7")
SUBSCRIPTIONS_WRITER: Final = bytes.fromhex("000004c2")
"""Announces readers."""
SUBSCRIPTIONS_READER: Final = bytes.fromhex("000004c7")
DISCOVERY_READERS: Final[Mapping[bytes, bytes]] = {
    SPDP_WRITER: SPDP_READER,
    PUBLICATIONS_WRITER: PUBLICATIONS_READER,
    SUBSCRIPTIONS_WRITER: SUBSCRIPTIONS_READER,
}
"""By the writer of discovery. The pair for participants is reliable between a Discovery Server and its
clients only."""

_WRITER_NO_KEY: Final = 0x03
_READER_NO_KEY: Final = 0x04
_WRITER_KINDS: Final = frozenset((0x02, 0x03))
_READER_KINDS: Final = frozenset((0x04, 0x07))
_KIND_MASK: Final = 0x3F
"""Without the bits for entities that each participant has."""
_MOST_ENTITIES: Final = 1 << 24


def writer_id(number: int) -> bytes:
    """The id of our writer with that number, from 1 to 2**24 - 1."""
    return (number % _MOST_ENTITIES << 8 | _WRITER_NO_KEY).to_bytes(4, "big")


def reader_id(number: int) -> bytes:
    """The id of our reader with that number, from 1 to 2**24 - 1."""
    return (number % _MOST_ENTITIES << 8 | _READER_NO_KEY).to_bytes(4, "big")


def is_writer_id(entity: bytes) -> bool:
    """Whether an entity id, or a GUID, is one of a writer."""
    return entity[-1] & _KIND_MASK in _WRITER_KINDS


def is_reader_id(entity: bytes) -> bool:
    """Whether an entity id, or a GUID, is one of a reader."""
    return entity[-1] & _KIND_MASK in _READER_KINDS
