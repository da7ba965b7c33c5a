"""Messages of far writers that arrived before a reader was chosen for them: limited, and losses are counted,
except those of the earliest writers if there are too many. Pure."""

from collections import Counter, deque
from collections.abc import Hashable, Iterator, Mapping, Sequence
from typing import Generic, TypeVar

from bus.vocabulary import DropReason

__all__ = ["Arrived", "Early"]

_MOST_HANDLES = 10_000
"""A limit for forged writers, of which each has few messages. It is far above a bridge's own limit."""
_MOST_MESSAGES = 1 << 20
"""A limit for short messages: each takes about 150 bytes besides its CDR."""

Arrived = tuple[bytes, int]
"""A message, and its time of publication."""

K = TypeVar("K", bound=Hashable)
V = TypeVar("V", bound=tuple[bytes, *tuple[int, ...]])


class _Kept(Generic[V]):
    def __init__(self) -> None:
        self.messages: deque[V] = deque()
        self.lost: Counter[DropReason] = Counter()


class Early(Generic[K, V]):
    """Messages by handle of their writer, or by its GUID.

    At most `depth` messages of each writer (None: no limit), and at most `max_bytes` and a million messages
    of all writers. Above that, a new message replaces the oldest one of the same writer. Of 10,000 writers,
    the messages of the earliest one make room for a new one's.
    """

    def __init__(self, depth: int | None, max_bytes: int) -> None:
        self._depth = depth
        self._max_bytes = max_bytes
        self._bytes = self._count = 0
        self._by_handle: dict[K, _Kept[V]] = {}

    def __iter__(self) -> Iterator[K]:
        """The handles of writers with waiting messages."""
        return iter(self._by_handle)

    def __len__(self) -> int:
        """The number of waiting messages."""
        return self._count

    def put(self, handle: K, one: V) -> bool:
        """Add a message; returns whether it is the first of its writer."""
        kept = self._by_handle.get(handle)
        is_first = kept is None
        if kept is None:
            if len(self._by_handle) >= _MOST_HANDLES:
                self.pop(next(iter(self._by_handle)))
            kept = self._by_handle[handle] = _Kept()
        messages, size = kept.messages, len(one[0])
        messages.append(one)
        self._bytes += size
        self._count += 1
        while messages:
            if self._bytes > self._max_bytes or self._count > _MOST_MESSAGES:
                reason = DropReason.MEMORY_LIMIT
            elif self._depth is not None and len(messages) > self._depth:
                reason = DropReason.REPLACED
            else:
                break
            self._bytes -= len(messages.popleft()[0])
            self._count -= 1
            kept.lost[reason] += 1
        return is_first

    def pop(self, handle: K) -> tuple[Sequence[V], Mapping[DropReason, int]]:
        """Remove the messages of a writer; returns them in order, and the number of lost ones by reason."""
        kept = self._by_handle.pop(handle, None)
        if kept is None:
            return (), {}
        self._bytes -= sum([len(one[0]) for one in kept.messages])
        self._count -= len(kept.messages)
        return kept.messages, kept.lost

    def clear(self) -> None:
        self._by_handle.clear()
        self._bytes = self._count = 0
