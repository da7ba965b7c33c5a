"""The subscriptions of one event loop that busd does not know yet, and the publishers that wait for them.

A program makes a subscription without waiting for busd, and publishes. The message must reach it, also from
an older publisher of the same loop. So publishers on its topic hold their messages meanwhile. Clients of
services and actions hold their requests in the same way. Must not know nodes and the bus.
"""

from asyncio import AbstractEventLoop
from collections import Counter
from typing import ClassVar, Protocol
from weakref import WeakSet, WeakValueDictionary

__all__ = ["Openings"]


class _Publisher(Protocol):
    """The interface of a publisher. Each `hold` is followed by one `release`."""

    def hold(self) -> None: ...
    def release(self) -> None: ...


class Openings:
    """The openings of one event loop; `of` returns them."""

    _all: ClassVar["WeakValueDictionary[int, Openings]"] = WeakValueDictionary()
    """The key is the id of the loop, to which each refers."""

    def __init__(self, loop: AbstractEventLoop) -> None:
        self._loop = loop
        self._opening: Counter[str] = Counter()
        self._publishers: dict[str, WeakSet[_Publisher]] = {}

    @classmethod
    def of(cls, loop: AbstractEventLoop) -> "Openings":
        """The openings of `loop`, as long as a user keeps them."""
        found = cls._all.get(id(loop))
        if found is None:
            found = cls._all[id(loop)] = cls(loop)
        return found

    def add_publisher(self, topic: str, publisher: _Publisher) -> None:
        """From now on, `publisher` holds its messages while a subscription to `topic` is opening."""
        self._publishers.setdefault(topic, WeakSet()).add(publisher)
        for _ in range(self._opening[topic]):
            publisher.hold()

    def remove_publisher(self, topic: str, publisher: _Publisher) -> None:
        """Undo `add_publisher`; the holds of the publisher no longer count."""
        publishers = self._publishers.get(topic)
        if publishers is not None:
            publishers.discard(publisher)
            if not publishers:
                del self._publishers[topic]

    def begin(self, topic: str) -> None:
        """A subscription to `topic` is opening, until `end`."""
        self._opening[topic] += 1
        for publisher in tuple(self._publishers.get(topic, ())):
            publisher.hold()

    def end(self, topic: str) -> None:
        """A subscription to `topic` is open, or never will be."""
        self._opening[topic] -= 1
        if not self._opening[topic]:
            del self._opening[topic]
        for publisher in tuple(self._publishers.get(topic, ())):
            publisher.release()
