"""Files of bags, whatever their format: their methods for reading and writing, and the values that reading
gives."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Protocol, TypeAlias

import msgspec

from bus_bag.metadata import BagMetadata, TopicMetadata

__all__ = [
    "BagFile",
    "BagFileWriter",
    "BagMessage",
    "Buffer",
    "Gatherer",
    "Order",
    "Problem",
    "Stamp",
    "Summary",
]

Buffer: TypeAlias = bytes | bytearray | memoryview
Order: TypeAlias = Literal["log_time", "publish_time"]
Stamp: TypeAlias = tuple[int, int, int, object, object]
"""Publish time, log time, the publisher's number, and more that is of no matter here: a `MessageInfo`."""


class BagMessage(msgspec.Struct, gc=False):
    """A message of a bag. Times are nanoseconds since 1970."""

    topic: str
    log_time: int
    """When the recorder received it."""
    publish_time: int
    """When it was published; in files that don't say so the same as `log_time`."""
    sequence: int
    """The publisher's number of it, 32 bits of it; 0 in files that don't say so."""
    data: Buffer
    """As it is encoded. A view of a larger piece of the file, which it keeps in memory."""


class Problem(msgspec.Struct, frozen=True):
    """Something in a file that can't be read, and was passed over."""

    path: str
    offset: int | None
    """Where in the file, in bytes; None: it is not about a place."""
    text: str

    def __str__(self) -> str:
        place = "" if self.offset is None else f", at byte {self.offset}"
        return f"{self.path}{place}: {self.text}"


class Summary(msgspec.Struct):
    """What a file has, without reading its messages."""

    message_count: int = 0
    starting_time: int = 0
    end_time: int = 0
    counts: dict[str, int] = {}
    """Topic -> messages."""


class BagFile(Protocol):
    """One file of a bag, open for reading."""

    @property
    def storage(self) -> str:
        """The identifier of its storage."""
        ...

    path: Path
    summary: Summary
    topics: dict[str, TopicMetadata]
    extra: dict[str, dict[str, str]]
    """Topic -> what else the file says of it."""
    definitions: dict[str, str]
    """Type -> its definition, in the language of .msg files, with the definitions of all types that it needs.
    """
    problems: list[Problem]
    is_cut: bool
    """Whether it was not closed: its recorder was killed, or its end is missing."""
    has_index: bool
    """Whether it can be read from any time on without going through it first."""
    records: list[tuple[str, dict[str, str]]]
    """Records of texts that are no messages: name, texts."""

    @property
    def is_being_written(self) -> bool:
        """Whether a recorder has it open."""
        ...

    def metadata(self) -> BagMetadata | None: ...

    def messages(
        self, start: int | None, topics: frozenset[str] | None, by: Order
    ) -> Iterator[BagMessage]: ...

    def close(self) -> None: ...


class Gatherer(Protocol):
    """Gathers messages, which are written together."""

    size: int
    """Bytes of what it has."""

    def add(
        self, channel: int, log_time: int, publish_time: int, sequence: int, parts: Sequence[Buffer]
    ) -> int:
        """Add a message, in parts whose `len` is their number of bytes; returns the bytes that it takes."""
        ...

    def add_many(self, channel: int, stamps: Sequence[Stamp], messages: Sequence[Buffer]) -> int:
        """Add short messages of one part each; returns the bytes that they take."""
        ...

    def close(self) -> Any:
        """The gathered messages, for `write_chunk`: they have a `size`; None if nothing was. Then it begins
        anew."""
        ...


class BagFileWriter(Protocol):
    """One file of a bag, open for writing. Not for several threads at a time; but its attributes may be read
    from any.

    Raises BagFull if nothing more fits: `write_metadata` and `close` must still be possible then. OSError for
    other faults.
    """

    path: Path
    size: int
    """Bytes in the file."""
    starting_time: int
    end_time: int

    @property
    def counts(self) -> Mapping[int, int]:
        """Channel -> messages in the file."""
        ...

    @property
    def message_count(self) -> int: ...

    @property
    def is_open(self) -> bool: ...

    def write_schema(self, number: int, name: str, definition: str) -> None:
        """A type, before the first channel of it."""
        ...

    def write_channel(self, number: int, schema: int, topic: TopicMetadata, extra: Mapping[str, str]) -> None:
        """A topic, before its first message."""
        ...

    def write_chunk(self, chunk: Any) -> None:
        """What a Gatherer of this storage has gathered."""
        ...

    def write_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """A record of texts."""
        ...

    def close(self) -> None:
        """Make the file whole. It is closed even if that fails."""
        ...
