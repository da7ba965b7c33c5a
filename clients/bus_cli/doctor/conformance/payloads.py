"""Messages of any type, encoded: to send to a client, and to check its messages.

Uses the declared schema, or the library's own definition if the client declared none.
"""

from functools import lru_cache
from typing import Any

import msgspec

from bus.errors import BusError
from bus.schema import MessageSchema
from bus.types.support import TypeSupport, find_type, type_hash, type_support

__all__ = ["NOTHING", "fault", "make"]

NOTHING = b"\xc0"
"""The schema in DeclareType if the client sends none."""

_INTEGERS = ("uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "int")
_HEAD = bytes.fromhex("c70d540000000000")
_HEAD_BYTES = 16
"""The mark and the size of a source time (docs/protocol.md)."""


@lru_cache
def _support(schema: MessageSchema) -> TypeSupport[Any] | None:
    """None if the type is not known."""
    try:
        if schema.encoded != NOTHING:
            return type_support(schema.to_class())
        ready_made = find_type(schema.type_name)
        is_same = ready_made is not None and type_hash(ready_made) == schema.type_hash
        return type_support(ready_made) if ready_made is not None and is_same else None
    except (BusError, ValueError, TypeError):
        return None


def make(schema: MessageSchema, number: int, text_bytes: int = 0) -> bytes | None:
    """The message with that number: messages with different numbers differ, if a field of the type allows it.

    With `text_bytes`, its text has at least that many bytes. None if the type is not known, has no message of
    defaults, or needs a text and has none.
    """
    support = _support(schema)
    if support is None:
        return None
    root = support.schema["types"][support.schema["root"]]
    values: dict[str, Any] = {}
    for field in root["fields"]:
        if field["type"] == "string":
            values = {field["name"]: f"message {number}".ljust(text_bytes, ".")}
        elif field["type"] in _INTEGERS and not text_bytes:
            values = {field["name"]: number}
        if values:
            break
    if text_bytes and not values:
        return None
    try:
        return bytes(support.encode(support.cls(**values)))
    except (TypeError, ValueError):
        return None


def fault(schema: MessageSchema, payload: bytes) -> str | None:
    """Why a payload is no message of the type; None if it is one, or if the type is not known."""
    support = _support(schema)
    if payload.startswith(_HEAD):
        payload = payload[_HEAD_BYTES:]
    if support is None:
        return None
    try:
        support.decode(payload)
    except (msgspec.MsgspecError, ValueError) as error:
        return str(error)
    return None
