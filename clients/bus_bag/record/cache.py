"""Taken messages that wait to be written, by topic. Pure.

If there is no room, the topic with most waiting bytes loses its oldest messages: a camera, not the
transforms. Messages of lossless topics are never lost here: while the cache is half full, the recorder takes
no more of them.
"""

from collections import deque
from typing import Generic, TypeVar

import msgspec

__all__ = ["Cache"]

T = TypeVar("T")

_FEW = 64
"""Up to this number, dropped entries stay in the order: to remove them costs a pass over all entries."""


class _Entry(msgspec.Struct, Generic[T]):
    """A batch of `count` messages with `size` bytes, from second `at_s`; None once it was dropped."""

    topic: str
    batch: T | None
    count: int
    bytes: int
    may_be_lost: bool
    at_s: int


class Cache(Generic[T]):
    """Batches in the order of arrival, with `limit` bytes in total. A larger batch is accepted alone, with
    entries that have no bytes.
    Batches that may not be lost are accepted above the limit, too.

    `is_circular`: drops the oldest batch of all topics, so the cache keeps the newest batches.
    """

    def __init__(self, limit: int, *, is_circular: bool = False) -> None:
        self._limit = limit
        self._is_circular = is_circular
        self._order: deque[_Entry[T]] = deque()
        self._topics: dict[str, deque[_Entry[T]]] = {}
        """The batches that may be lost."""
        self._bytes_by_topic: dict[str, int] = {}
        """Their bytes."""
        self._losable_bytes = 0
        """Their sum."""
        self.waiting = 0
        """Number of waiting batches. `_order` also has batches that were dropped."""
        self.bytes = 0
        """Bytes of all waiting batches."""
        self.lost: dict[tuple[str, int], int] = {}
        """Topic and second of the messages -> number of messages dropped here."""

    def put(
        self, topic: str, batch: T, count: int, size: int, *, may_be_lost: bool = True, at_s: int = 0
    ) -> None:
        """Add a batch of `count` messages with `size` bytes in all. Without room, drop others."""
        entry = _Entry(topic, batch, count, size, may_be_lost, at_s)
        self._order.append(entry)
        self.bytes += size
        self.waiting += 1
        if may_be_lost:
            entries = self._topics.get(topic)
            if entries is None:
                entries = self._topics[topic] = deque()
                self._bytes_by_topic[topic] = 0
            entries.append(entry)
            self._bytes_by_topic[topic] += size
            self._losable_bytes += size
        while self.bytes > self._limit and self.bytes > size > 0 and self._losable_bytes:
            self._lose()

    def take(self) -> tuple[str, T, int]:
        """Remove and return the oldest batch: its topic, itself, its number of messages. Raises IndexError if
        empty."""
        while (batch := (entry := self._order.popleft()).batch) is None:
            pass
        topic = entry.topic
        if entry.may_be_lost:
            self._topics[topic].popleft()
            self._bytes_by_topic[topic] -= entry.bytes
            self._losable_bytes -= entry.bytes
        self.bytes -= entry.bytes
        self.waiting -= 1
        return topic, batch, entry.count

    def peek(self) -> T | None:
        """The oldest batch; None if empty."""
        return next((entry.batch for entry in self._order if entry.batch is not None), None)

    def clear(self) -> dict[tuple[str, int], int]:
        """Drop all waiting messages; returns their numbers as in `lost`."""
        thrown: dict[tuple[str, int], int] = {}
        for entry in self._order:
            if entry.batch is not None and entry.count:
                _count(thrown, entry)
        while self.waiting:
            self.take()
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
        _count(self.lost, entry)
        self._bytes_by_topic[topic] -= entry.bytes
        self._losable_bytes -= entry.bytes
        self.bytes -= entry.bytes
        self.waiting -= 1
        gone = len(self._order) - self.waiting
        if gone > _FEW and gone > self.waiting:
            self._order = deque(one for one in self._order if one.batch is not None)


def _count(counts: dict[tuple[str, int], int], entry: _Entry[T]) -> None:
    place = entry.topic, entry.at_s
    counts[place] = counts.get(place, 0) + entry.count
