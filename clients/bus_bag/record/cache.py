"""Messages that were taken and are yet to be written, by topic. Pure.

When there is no room, the topic with most bytes waiting loses its oldest: a camera, not the transforms.
"""

from collections import deque
from typing import Generic, TypeVar

import msgspec

__all__ = ["Cache"]

T = TypeVar("T")

_FEW = 64
"""So many places of what was lost are not worth a look at all others."""


class _Entry(msgspec.Struct, Generic[T]):
    """A batch of `count` messages with so many bytes; None once it was lost."""

    topic: str
    batch: T | None
    count: int
    bytes: int


class Cache(Generic[T]):
    """Batches in the order in which they came, within `limit` bytes. A batch that is larger than that has
    room alone.

    `is_circular`: the oldest of all is lost, whatever its topic: what is kept is the newest of the whole.
    """

    def __init__(self, limit: int, *, is_circular: bool = False) -> None:
        self._limit = limit
        self._is_circular = is_circular
        self._order: deque[_Entry[T]] = deque()
        self._topics: dict[str, deque[_Entry[T]]] = {}
        self._bytes_by_topic: dict[str, int] = {}
        self.waiting = 0
        """Batches that wait. `_order` also has those that were lost meanwhile."""
        self.bytes = 0
        """Bytes of all waiting batches."""
        self.lost: dict[str, int] = {}
        """Topic -> messages that were lost here."""

    def put(self, topic: str, batch: T, count: int, size: int) -> None:
        """Add a batch of `count` messages with `size` bytes in all; if there is no room, drop others."""
        entry = _Entry(topic, batch, count, size)
        self._order.append(entry)
        entries = self._topics.get(topic)
        if entries is None:
            entries = self._topics[topic] = deque()
            self._bytes_by_topic[topic] = 0
        entries.append(entry)
        self._bytes_by_topic[topic] += size
        self.bytes += size
        self.waiting += 1
        while self.bytes > self._limit and self.waiting > 1:
            self._lose()

    def take(self) -> tuple[str, T, int]:
        """The oldest batch: its topic, itself, how many messages. Raises IndexError if none waits."""
        while (batch := (entry := self._order.popleft()).batch) is None:
            pass
        topic = entry.topic
        self._topics[topic].popleft()
        self._bytes_by_topic[topic] -= entry.bytes
        self.bytes -= entry.bytes
        self.waiting -= 1
        return topic, batch, entry.count

    def clear(self) -> dict[str, int]:
        """Drop all waiting messages; returns topic -> messages."""
        thrown: dict[str, int] = {}
        while self.waiting:
            topic, _, count = self.take()
            thrown[topic] = thrown.get(topic, 0) + count
        return thrown

    def _lose(self) -> None:
        if self._is_circular:
            while self._order[0].batch is None:
                self._order.popleft()
            topic = self._order[0].topic
        else:
            topic = max(self._bytes_by_topic, key=self._bytes_by_topic.__getitem__)
        entry = self._topics[topic].popleft()
        entry.batch = None
        self.lost[topic] = self.lost.get(topic, 0) + entry.count
        self._bytes_by_topic[topic] -= entry.bytes
        self.bytes -= entry.bytes
        self.waiting -= 1
        gone = len(self._order) - self.waiting
        if gone > _FEW and gone > self.waiting:
            self._order = deque(one for one in self._order if one.batch is not None)
