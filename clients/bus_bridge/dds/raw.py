"""Private functions of cyclonedds: they read and write bytes, and end an entity.

Cyclonedds' own classes convert the bytes of an image to Python lists. These calls take and return unchanged
CDR. A test fails if one of them changes.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, Final

__all__ = ["TIMED_OUT", "delete", "describe_code", "listen", "taker_of", "writer_of"]

TIMED_OUT: Final = -10
"""Returned by `write` if a reliable writer has no room."""
_ANY: Final = 0x7F
"""A mask for samples in every state."""


def taker_of(reader: Any) -> Callable[[int], list[tuple[bytes, Any]]]:
    """A function that takes up to the given number of samples, each with its SampleInfo; none if the reader
    has gone."""
    from cyclonedds import _clayer

    found: Any = _clayer.ddspy_take
    reference = reader._ref

    def take(count: int) -> list[tuple[bytes, Any]]:
        samples: Any = found(reference, _ANY, count)
        return samples if isinstance(samples, list) else []

    return take


def writer_of(writer: Any) -> Callable[[bytes, int], int]:
    """A function that writes a message with its time; its size must be a multiple of four. It returns 0, or a
    negative code of DDS."""
    from cyclonedds import _clayer

    return partial(_clayer.ddspy_write_ts, writer._ref)


def listen(entity: Any, listener: Any) -> None:
    """Set the listener of an entity, which must outlive the entity. cyclonedds' own method copies
    listeners."""
    entity._set_listener(entity._ref, listener._ref)


def delete(entity: Any) -> None:
    """End an entity with everything made in it, even if other code still refers to the object."""
    if entity._entities.pop(entity._ref, None) is not None:
        entity._delete(entity._ref)


def describe_code(code: int) -> str:
    """The meaning of an error code of DDS."""
    from cyclonedds.core import DDSException

    name, text = DDSException.error_message_mapping.get(code, ("", f"error {code}"))
    return f"{text.removesuffix('.')} ({name.removeprefix('DDS_RETCODE_').lower()})" if name else text
