"""What a file of a bag offers, whatever its format, and what reading it gives."""

from collections.abc import Iterator
from pathlib import Path
from typing import Literal, Protocol, TypeAlias

import msgspec

from bus_bag.metadata import BagMetadata, TopicMetadata

__all__ = ["BagFile", "BagMessage", "Buffer", "Order", "Problem", "Summary"]

Buffer: TypeAlias = bytes | bytearray | memoryview
Order: TypeAlias = Literal["log_time", "publish_time"]


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
    """One file of a bag, open."""

    path: Path
    summary: Summary
    topics: dict[str, TopicMetadata]
    extra: dict[str, dict[str, str]]
    """Topic -> what else the file says of it."""
    definitions: dict[str, str]
    """Type -> its definition, in the language of .msg files, with those of all that it needs."""
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
