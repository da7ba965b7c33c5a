"""Functions of cyclonedds without a public name: bytes in and out of it, and the end of an entity.

Its own classes make Python lists of an image's bytes; these calls take and give CDR as it is. A test fails
when one of them changes.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, Final

__all__ = ["TIMED_OUT", "delete", "describe_code", "listen", "taker_of", "writer_of"]

TIMED_OUT: Final = -10
"""Returned by `write` if a reliable writer has no room."""
_ANY: Final = 0x7F
"""Samples of every state."""


def taker_of(reader: Any) -> Callable[[int], list[tuple[bytes, Any]]]:
    """Takes up to so many samples, each with its SampleInfo; none if the reader has gone."""
    from cyclonedds import _clayer

    found: Any = _clayer.ddspy_take
    reference = reader._ref

    def take(count: int) -> list[tuple[bytes, Any]]:
        samples: Any = found(reference, _ANY, count)
        return samples if isinstance(samples, list) else []

    return take


def writer_of(writer: Any) -> Callable[[bytes, int], int]:
    """Writes a message, whose size is a multiple of four, with its time: 0, or a negative code of DDS."""
    from cyclonedds import _clayer

    return partial(_clayer.ddspy_write_ts, writer._ref)


def listen(entity: Any, listener: Any) -> None:
    """From now on `listener` hears of an entity, which must outlive it. Its own method copies listeners."""
    entity._set_listener(entity._ref, listener._ref)


def delete(entity: Any) -> None:
    """End an entity now, with everything that it has made, even if others still hold the object."""
    if entity._entities.pop(entity._ref, None) is not None:
        entity._delete(entity._ref)


def describe_code(code: int) -> str:
    """The meaning of an error code of DDS."""
    from cyclonedds.core import DDSException

    name, text = DDSException.error_message_mapping.get(code, ("", f"error {code}"))
    return f"{text.removesuffix('.')} ({name.removeprefix('DDS_RETCODE_').lower()})" if name else text
