"""Files of bags in any format: the methods to read and write them, and the values that reading returns."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Protocol, TypeAlias, runtime_checkable

import msgspec

from bus_bag.metadata import BagMetadata, TopicMetadata
from bus_bag.storage.stretches import Stretch

__all__ = [
    "BagFile",
    "BagFileWriter",
    "BagMessage",
    "Buffer",
    "Gatherer",
    "Order",
    "PackGatherer",
    "Problem",
    "Records",
    "Stamp",
    "Summary",
]

Buffer: TypeAlias = bytes | bytearray | memoryview
Order: TypeAlias = Literal["log_time", "publish_time"]
Stamp: TypeAlias = tuple[int, int, int, object, object]
"""Publish time, log time, the publisher's number, and fields that are not used here: a `MessageInfo`."""

Records: TypeAlias = Callable[[bytes, int, int, int], tuple[Buffer, bytes] | None]
"""Makes the records of a buffer of messages: see `bus_bag.core.Program.records`."""


class BagMessage(msgspec.Struct, gc=False):
    """A message of a bag. Times are nanoseconds since 1970."""

    topic: str
    log_time: int
    """Time of its reception by the recorder."""
    publish_time: int
    """Time of its publication; the same as `log_time` if the file does not have it."""
    sequence: int
    """The lower 32 bits of the publisher's number of the message; 0 if the file does not have it."""
    data: Buffer
    """The encoded message. It may be a view of a larger piece of the file, which it keeps in memory."""


class Problem(msgspec.Struct, frozen=True):
    """An unreadable part of a file that was skipped."""

    path: str
    offset: int | None
    """Position in the file, in bytes; None if it has no position."""
    text: str

    def __str__(self) -> str:
        place = "" if self.offset is None else f", at byte {self.offset}"
        return f"{self.path}{place}: {self.text}"


class Summary(msgspec.Struct):
    """The contents of a file, known without reading its messages."""

    message_count: int = 0
    starting_time: int = 0
    end_time: int = 0
    counts: dict[str, int] = {}
    """Topic -> number of messages."""


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
    """Topic -> further metadata in the file."""
    definitions: dict[str, str]
    """Type -> its definition in the language of .msg files, including definitions of all types that it
    needs."""
    problems: list[Problem]
    is_cut: bool
    """Whether it was not closed properly: its recorder was killed, or its end is missing."""
    has_index: bool
    """Whether reading can start at any time without a pass through the file."""
    records: list[tuple[str, dict[str, str]]]
    """Metadata records: name, texts."""

    @property
    def is_being_written(self) -> bool:
        """Whether a recorder has it open."""
        ...

    def metadata(self) -> BagMetadata | None: ...

    def messages(
        self, start: int | None, topics: frozenset[str] | None, by: Order
    ) -> Iterator[BagMessage]: ...

    def stretches(self, least: int, topics: frozenset[str], by: Order) -> Iterator[Stretch]:
        """Times with messages of `topics`, in any order. A stretch has no gap of more than `least`, as far as
        the index shows that: other topics of the same chunk may hide a gap."""
        ...

    def close(self) -> None: ...


class Gatherer(Protocol):
    """Gathers messages to write them together."""

    size: int
    """Bytes of the gathered messages."""

    def add(
        self, channel: int, log_time: int, publish_time: int, sequence: int, parts: Sequence[Buffer]
    ) -> int:
        """Add a message in parts; the `len` of each part is its number of bytes. Returns the bytes that it
        uses."""
        ...

    def add_many(self, channel: int, stamps: Sequence[Stamp], messages: Sequence[Buffer]) -> int:
        """Add short messages of one part each; returns the bytes that they use."""
        ...

    def close(self) -> Any:
        """Remove the gathered messages and return them for `write_chunk`. They have a `size`. None if there
        are none."""
        ...


@runtime_checkable
class PackGatherer(Gatherer, Protocol):
    """Also gathers messages in one buffer."""

    def add_packed(self, channel: int, log_time: int, data: bytes, records: Records) -> int:
        """Add messages of one topic, as `Subscription.take_packed` takes them; returns the bytes that they
        use. Returns 0 and adds nothing if `records` refuses them."""
        ...


class BagFileWriter(Protocol):
    """One file of a bag, open for writing. Not for several threads at a time, but any thread may read its
    attributes.

    Raises BagFull if nothing more fits; `write_metadata` and `close` must still be possible then. Raises
    OSError for other faults.
    """

    path: Path
    size: int
    """Bytes in the file."""
    starting_time: int
    end_time: int

    @property
    def counts(self) -> Mapping[int, int]:
        """Channel -> number of messages in the file."""
        ...

    @property
    def message_count(self) -> int: ...

    @property
    def is_open(self) -> bool: ...

    def write_schema(self, number: int, name: str, definition: str) -> None:
        """Write a type, before its first channel."""
        ...

    def write_channel(self, number: int, schema: int, topic: TopicMetadata, extra: Mapping[str, str]) -> None:
        """Write a topic, before its first message."""
        ...

    def write_chunk(self, chunk: Any) -> None:
        """Write messages gathered by a Gatherer of this storage."""
        ...

    def write_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record."""
        ...

    def close(self) -> None:
        """Complete and close the file. It is closed even if the completion fails."""
        ...
