"""The transient local history of each publisher, as the recorder has seen it. Pure.

Each further file of a split begins with it, so the file can be played alone. After a pause, a recording
writes the state that changed during the pause.
"""

from collections import deque
from collections.abc import Mapping
from typing import Generic, NamedTuple, TypeVar

__all__ = ["MOST_BYTES", "MOST_MESSAGES", "Latched", "LatchedState"]

T = TypeVar("T")

MOST_MESSAGES = 1000
MOST_BYTES = 64 << 20
"""Most bytes kept of one publisher; the newest message is always kept."""

RETURN_NS = 10_000_000_000
"""Time after which a missing publisher does not come back."""


class Latched(NamedTuple, Generic[T]):
    """A message for late joiners."""

    topic: str
    publisher: bytes
    message: T
    is_written: bool


class _Kept(Generic[T]):
    """The messages that one publisher keeps, each with its size, and whether it was written."""

    __slots__ = ("bytes", "depth", "gone_ns", "messages")

    def __init__(self) -> None:
        self.depth = 1
        self.messages: deque[tuple[T, int, bool]] = deque()
        self.bytes = 0
        self.gone_ns: int | None = None

    def trim(self) -> None:
        while len(self.messages) > 1 and (len(self.messages) > self.depth or self.bytes > MOST_BYTES):
            self.bytes -= self.messages.popleft()[1]

    def mark_written(self) -> None:
        self.messages = deque((message, size, True) for message, size, _ in self.messages)


class LatchedState(Generic[T]):
    """The last messages of each publisher that keeps messages for late joiners."""

    def __init__(self) -> None:
        self._kept: dict[tuple[str, bytes], _Kept[T]] = {}
        self.has_unwritten = False

    def depth(self, topic: str, publisher: bytes) -> int:
        """The number of messages that this publisher keeps; 0 if it keeps none."""
        kept = self._kept.get((topic, publisher))
        return 0 if kept is None else kept.depth

    def set_publishers(self, topic: str, depths: Mapping[bytes, int], now_ns: int) -> None:
        """Set the present publishers of `topic` that keep messages: gid -> depth (0: all). Others are gone.

        A publisher that is gone only for a moment, because busd restarts, counts as present all the time.
        """
        for publisher, depth in depths.items():
            kept = self._kept.setdefault((topic, publisher), _Kept())
            kept.depth, kept.gone_ns = min(depth or MOST_MESSAGES, MOST_MESSAGES), None
            kept.trim()
        for key in [one for one in self._kept if one[0] == topic and one[1] not in depths]:
            gone_ns = self._kept[key].gone_ns
            if gone_ns is None:
                self._kept[key].gone_ns = now_ns
            elif now_ns - gone_ns > RETURN_NS:
                del self._kept[key]

    def add(self, topic: str, publisher: bytes, message: T, size: int, *, is_written: bool) -> None:
        """Add that publisher's newest message, of `size` bytes."""
        kept = self._kept[topic, publisher]
        kept.messages.append((message, size, is_written))
        self.has_unwritten |= not is_written
        kept.bytes += size
        kept.trim()

    def forget(self, topic: str, publisher: bytes, message: T) -> None:
        """Keep that message no longer, if it is kept."""
        kept = self._kept.get((topic, publisher))
        if kept is not None:
            kept.messages = deque(one for one in kept.messages if one[0] is not message)
            kept.bytes = sum(size for _, size, _ in kept.messages)

    def state(self, now_ns: int) -> list[Latched[T]]:
        """The messages that a late joiner would get now, in order for each publisher."""
        for key, kept in tuple(self._kept.items()):
            if kept.gone_ns is not None and now_ns - kept.gone_ns > RETURN_NS:
                del self._kept[key]
        return self._all()

    def take_unwritten(self) -> list[Latched[T]]:
        """The messages not written so far. From now on they count as written."""
        found = [one for one in self._all() if not one.is_written]
        self.mark_written()
        return found

    def mark_written(self) -> None:
        """From now on, all messages count as written."""
        for kept in self._kept.values():
            kept.mark_written()
        self.has_unwritten = False

    def _all(self) -> list[Latched[T]]:
        return [
            Latched(topic, publisher, message, is_written)
            for (topic, publisher), kept in self._kept.items()
            for message, _, is_written in kept.messages
        ]
