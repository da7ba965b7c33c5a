"""Messages of one publisher that travel together. Pure.

A batch knows its count, its first and last number and its bytes. It computes them once, when it is made. So
no later step has to read single messages for them.
"""

from collections.abc import Iterator
from typing import NamedTuple

__all__ = ["Batch", "Loose", "Sample"]


class Sample(NamedTuple):
    """A message between its publisher and a subscription on another bus."""

    payload: bytes
    """The encoded message (MessagePack)."""
    number: int
    """The number of this message among its publisher's, from 1; 0 if the engine does not know it."""
    source_time_ns: int
    """Time of publication: wall clock of the publisher's machine."""


class Batch:
    """One or more messages, in order. Immutable."""

    __slots__ = ("count", "first_number", "is_consecutive", "last_number", "last_time_ns", "payload_bytes")

    count: int
    """Number of messages."""
    payload_bytes: int
    """Size of all payloads together."""
    first_number: int
    last_number: int
    last_time_ns: int
    """Source time of the last message."""
    is_consecutive: bool
    """Whether the numbers increase by one from message to message."""

    def __iter__(self) -> Iterator[Sample]:
        raise NotImplementedError

    def after(self, count: int) -> "Batch":
        """The batch without its first `count` messages; at least one message is left."""
        raise NotImplementedError


class Loose(Batch):
    """A batch in a list of samples, which must not be empty."""

    __slots__ = ("_samples",)

    def __init__(self, samples: list[Sample]) -> None:
        self._samples = samples
        self.count = len(samples)
        self.payload_bytes = sum([len(one[0]) for one in samples])
        self.first_number = number = samples[0][1]
        _, self.last_number, self.last_time_ns = samples[-1]
        self.is_consecutive = self.last_number - number == self.count - 1 and all(
            one[1] == due for due, one in enumerate(samples, number)
        )

    @classmethod
    def some(cls, samples: list[Sample]) -> "Loose | None":
        """None if there are no samples."""
        return cls(samples) if samples else None

    def after(self, count: int) -> "Loose":
        return Loose(self._samples[count:]) if count else self

    def __iter__(self) -> Iterator[Sample]:
        return iter(self._samples)
