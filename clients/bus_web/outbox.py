"""Frames queued for one client that is slower than the bus. Pure.

The outbox is bounded in bytes. If it is full, the topic with most bytes loses its oldest message. Each topic
keeps its newest message as long as possible. So a client that falls behind sees all topics as they are now.
"""

from collections import Counter, OrderedDict, deque
from typing import NamedTuple

__all__ = ["MOST_BYTES", "MOST_BYTES_OF_ALL", "Outbox", "SharedBudget"]

MOST_BYTES = 8 << 20
MOST_BYTES_OF_ALL = 32 << 20


class _Frame(NamedTuple):
    topic: str
    data: bytes


class _Queue:
    __slots__ = ("bytes", "numbers")

    def __init__(self) -> None:
        self.numbers: deque[int] = deque()
        self.bytes = 0


class SharedBudget:
    """Limit of bytes queued for all clients. Above it, the client with most loses its oldest message."""

    def __init__(self, most_bytes: int = MOST_BYTES_OF_ALL) -> None:
        self._most_bytes = most_bytes
        self._outboxes: list[Outbox] = []

    @property
    def bytes(self) -> int:
        """Bytes of the messages queued for all clients. Notices do not count: they have separate bounds, and
        can't be dropped. A large notice would cost other clients messages, and make no room."""
        return sum([outbox.bytes - outbox.notice_bytes for outbox in self._outboxes])

    def enter(self, outbox: "Outbox") -> None:
        """A client has come."""
        self._outboxes.append(outbox)

    def leave(self, outbox: "Outbox") -> None:
        """A client has gone; the frames queued for it are never sent."""
        self._outboxes.remove(outbox)

    def bound(self, growing: "Outbox", topic: str) -> None:
        """`growing` has a new message of `topic`, which stays if nothing else can go."""
        excess = self.bytes - self._most_bytes
        while excess > 0:
            largest_first = sorted(self._outboxes, key=lambda outbox: outbox.bytes, reverse=True)
            for outbox in largest_first:
                before = outbox.bytes
                if outbox.drop_one(topic if outbox is growing else ""):
                    excess -= before - outbox.bytes
                    break
            else:
                return


class Outbox:
    """Frames in the order in which they are to go. `most_bytes` may wait, or one larger frame.

    `shared`: the limit for all outboxes together, until `close`.
    """

    def __init__(self, most_bytes: int = MOST_BYTES, shared: SharedBudget | None = None) -> None:
        self._shared = shared
        if shared is not None:
            shared.enter(self)
        self._most_bytes = most_bytes
        self._frames: OrderedDict[int, _Frame] = OrderedDict()
        self._queues: dict[str, _Queue] = {}
        self._next = 0
        self.bytes = 0
        """Bytes of queued frames."""
        self.notices = 0
        """Number of queued frames without a topic."""
        self.notice_bytes = 0
        """The part of `bytes` that notices take."""
        self.dropped: Counter[str] = Counter()
        """Messages of each topic that were dropped since the client was last told (`clear` it then)."""

    def __len__(self) -> int:
        return len(self._frames)

    def notify(self, data: bytes) -> None:
        """A frame without a topic is never dropped: the caller must check `notices` first."""
        self.notices += 1
        self.notice_bytes += len(data)
        self._append("", data)

    def put(self, topic: str, data: bytes) -> None:
        """A message of a topic; older ones go if there is no room."""
        queue = self._queues.setdefault(topic, _Queue())
        queue.numbers.append(self._next)
        queue.bytes += len(data)
        self._append(topic, data)
        while self.bytes > self._most_bytes and self.drop_one(topic):
            pass
        if self._shared is not None:
            self._shared.bound(self, topic)

    def close(self) -> None:
        """The client has gone."""
        if self._shared is not None:
            self._shared.leave(self)
            self._shared = None

    def take(self) -> bytes | None:
        """The next frame to send; None if the outbox is empty."""
        if not self._frames:
            return None
        number, frame = self._frames.popitem(last=False)
        self.bytes -= len(frame.data)
        if frame.topic:
            self._leave(frame, number)
        else:
            self.notices -= 1
            self.notice_bytes -= len(frame.data)
        return frame.data

    def forget(self, topic: str) -> None:
        """Drop the topic's frames: the client no longer views it."""
        queue = self._queues.pop(topic, None)
        for number in queue.numbers if queue is not None else ():
            self.bytes -= len(self._frames.pop(number).data)

    def _append(self, topic: str, data: bytes) -> None:
        self._frames[self._next] = _Frame(topic, data)
        self._next += 1
        self.bytes += len(data)

    def drop_one(self, newest: str) -> bool:
        """Drop the oldest message of the topic with most bytes; returns whether one could go.

        The last message of the topic `newest` stays.
        """
        several = [topic for topic, queue in self._queues.items() if len(queue.numbers) > 1]
        if not several:  # each topic has only its newest; all except the last that came may go
            several = [topic for topic in self._queues if topic != newest]
        if not several:
            return False
        topic = max(several, key=lambda one: self._queues[one].bytes)
        number = self._queues[topic].numbers[0]
        frame = self._frames.pop(number)
        self.bytes -= len(frame.data)
        self._leave(frame, number)
        self.dropped[topic] += 1
        return True

    def _leave(self, frame: _Frame, number: int) -> None:
        queue = self._queues[frame.topic]
        assert queue.numbers.popleft() == number
        queue.bytes -= len(frame.data)
        if not queue.numbers:
            del self._queues[frame.topic]
