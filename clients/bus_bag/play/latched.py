"""The latched state of a moment: the messages for a late joiner of transient local topics at that time. Pure.

A player that begins in the middle of a bag publishes them first: for example a map and the fixed transforms.
The state also reveals repetitions in a bag of several files: each further file begins with the state of that
moment, so it can be played alone.
"""

from collections import OrderedDict
from collections.abc import Iterator, Mapping
from typing import Generic, NamedTuple, TypeVar

__all__ = ["Identity", "LatchedState"]

M = TypeVar("M")


class Identity(NamedTuple):
    """The identity of a message within its topic: the same if a message was recorded twice."""

    publish_time: int
    """Nanoseconds since 1970."""
    sequence: int
    """The publisher's number; 0 if the file has none. So the content is part of the identity, too."""
    data: bytes
    """The encoded message."""


class LatchedState(Generic[M]):
    """The last messages of each transient local topic. `depths` has the number to keep for each such
    topic."""

    def __init__(self, depths: Mapping[str, int]) -> None:
        self._depths = depths
        self._kept: dict[str, OrderedDict[Identity, M]] = {topic: OrderedDict() for topic in depths}

    def __iter__(self) -> Iterator[M]:
        """All kept messages, topic by topic, the oldest first."""
        for kept in self._kept.values():
            yield from kept.values()

    def add(self, topic: str, identity: Identity, message: M) -> bool:
        """Keep the next message of a topic. Returns False if it is kept already: then it is a repetition."""
        kept = self._kept[topic]
        if identity in kept:
            return False
        kept[identity] = message
        if len(kept) > self._depths[topic]:
            kept.popitem(last=False)
        return True
