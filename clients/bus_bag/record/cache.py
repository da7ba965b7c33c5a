"""What was taken and is yet to be written, by topic. Pure.

When there is no room, the topic with most bytes waiting loses its oldest: a camera, not the transforms.
"""

from collections import deque
from typing import Generic, TypeVar

__all__ = ["Cache"]

T = TypeVar("T")

_FEW = 64
"""So many places of what was lost are not worth a look at all others."""


class _Entry(Generic[T]):
    """`batch` is None once it was lost."""

    __slots__ = ("batch", "bytes", "count", "topic")

    def __init__(self, topic: str, batch: T, count: int, size: int) -> None:
        self.topic = topic
        self.batch: T | None = batch
        self.count = count
        self.bytes = size


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
        self._gone = 0  # entries in `_order` that were lost
        self._bytes_by_topic: dict[str, int] = {}
        self.bytes = 0
        """All that waits."""
        self.lost: dict[str, int] = {}
        """Topic -> messages that were lost here."""

    def __bool__(self) -> bool:
        return self.bytes > 0 or len(self._order) > self._gone

    def put(self, topic: str, batch: T, count: int, size: int) -> None:
        """Add a batch of `count` messages with `size` bytes in all; where there is no room, lose others."""
        entry = _Entry(topic, batch, count, size)
        self._order.append(entry)
        entries = self._topics.get(topic)
        if entries is None:
            entries = self._topics[topic] = deque()
            self._bytes_by_topic[topic] = 0
        entries.append(entry)
        self._bytes_by_topic[topic] += size
        self.bytes += size
        while self.bytes > self._limit and len(self._order) - self._gone > 1:
            self._lose()

    def take(self) -> tuple[str, T, int] | None:
        """The oldest batch: its topic, itself, how many messages; None where nothing waits."""
        while self._order:
            entry = self._order.popleft()
            if entry.batch is None:
                self._gone -= 1
                continue
            self._topics[entry.topic].popleft()
            self._forget(entry)
            return entry.topic, entry.batch, entry.count
        return None

    def clear(self) -> dict[str, int]:
        """Throw away all that waits; returns topic -> messages."""
        thrown: dict[str, int] = {}
        while (taken := self.take()) is not None:
            thrown[taken[0]] = thrown.get(taken[0], 0) + taken[2]
        return thrown

    def _lose(self) -> None:
        if self._is_circular:
            while self._order[0].batch is None:
                self._order.popleft()
                self._gone -= 1
            topic = self._order[0].topic
        else:
            topic = max(self._bytes_by_topic, key=self._bytes_by_topic.__getitem__)
        entry = self._topics[topic].popleft()
        entry.batch = None
        self._gone += 1
        self.lost[topic] = self.lost.get(topic, 0) + entry.count
        self._forget(entry)
        if self._gone > _FEW and 2 * self._gone > len(self._order):
            self._order = deque(one for one in self._order if one.batch is not None)
            self._gone = 0

    def _forget(self, entry: _Entry[T]) -> None:
        self._bytes_by_topic[entry.topic] -= entry.bytes
        self.bytes -= entry.bytes
