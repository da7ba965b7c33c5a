"""Messages that publishers keep for late joiners, kept for viewers that come later than others. Pure.

Bounded in bytes, for all topics together. If there is no room, the publisher with most kept bytes loses its
oldest message. So a publisher that keeps much takes no room from publishers that keep little.
"""

import heapq
from collections import deque
from collections.abc import Container
from typing import NamedTuple

from bus.subscription import MessageInfo

__all__ = ["MOST_BYTES", "Kept", "One"]

MOST_BYTES = 64 << 20
_EACH = 500
"""Bytes that a message costs besides its payload."""


class One(NamedTuple):
    """An encoded message. Frames made from it for viewers are not kept: they go with the viewers."""

    payload: bytes
    info: MessageInfo
    number: int


class _Queue:
    __slots__ = ("bytes", "messages")

    def __init__(self) -> None:
        self.messages: deque[One] = deque()
        self.bytes = 0


class Kept:
    """The last messages of publishers by topic and gid."""

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._most_bytes = most_bytes
        self._queues: dict[tuple[str, bytes], _Queue] = {}
        self._topics: dict[str, set[bytes]] = {}
        self.bytes = 0
        """How much is kept, of all topics."""
        self.dropped = 0
        """How many messages were dropped because there was no room."""

    def put(self, topic: str, gid: bytes, one: One, depth: int) -> None:
        """Keep a message. Its publisher keeps `depth` messages, of which this is the newest."""
        queue = self._queues.setdefault((topic, gid), _Queue())
        self._topics.setdefault(topic, set()).add(gid)
        queue.messages.append(one)
        self._count(queue, _cost(one))
        while len(queue.messages) > depth:
            self._count(queue, -_cost(queue.messages.popleft()))
        if self.bytes > self._most_bytes:
            self._make_room()

    def of_topic(self, topic: str) -> list[One]:
        """The kept messages of a topic, in the order in which they came."""
        found = [one for gid in self._topics.get(topic, ()) for one in self._queues[topic, gid].messages]
        return sorted(found, key=lambda one: one.number)

    def retain(self, topic: str, gids: Container[bytes]) -> None:
        """Keep only the messages of these publishers of a topic."""
        for gid in [one for one in self._topics.get(topic, ()) if one not in gids]:
            self._forget(topic, gid)

    def _make_room(self) -> None:
        """For more than one message, since the largest have to be searched for."""
        largest_first = [(-queue.bytes, key) for key, queue in self._queues.items()]
        heapq.heapify(largest_first)
        while self.bytes > self._most_bytes * 3 // 4:
            key = largest_first[0][1]
            queue = self._queues[key]
            self._count(queue, -_cost(queue.messages.popleft()))
            self.dropped += 1
            if queue.messages:
                heapq.heapreplace(largest_first, (-queue.bytes, key))
            else:
                heapq.heappop(largest_first)
                self._forget(*key)

    def _forget(self, topic: str, gid: bytes) -> None:
        queue = self._queues.pop((topic, gid))
        self.bytes -= queue.bytes
        self._topics[topic].discard(gid)
        if not self._topics[topic]:
            del self._topics[topic]

    def _count(self, queue: _Queue, size: int) -> None:
        queue.bytes += size
        self.bytes += size


def _cost(one: One) -> int:
    return len(one.payload) + _EACH
