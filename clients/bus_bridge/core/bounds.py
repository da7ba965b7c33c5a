"""Limits for each far bus: numbers of things, frequency of changes. Pure: times come from the caller."""

from typing import Annotated

import msgspec
from msgspec import Meta

__all__ = ["Bounds", "News"]

_Count = Annotated[int, Meta(ge=1, le=2**20)]


class Bounds(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The most that one far bus may have here. The bridge stops listening to a bus that asks for more."""

    buses: _Count = 256
    """Number of all far buses at one time."""
    nodes: _Count = 1000
    endpoints: _Count = 10_000
    types: _Count = 1000
    schema_bytes: Annotated[int, Meta(ge=1024, le=2**24)] = 256 * 1024
    """Bytes of the description of one type."""
    news_per_s: _Count = 2000
    """Changes (nodes and endpoints that come or go) in a second, over a longer time."""

    @property
    def news_at_once(self) -> int:
        """Changes allowed at once: enough if a bus comes, goes, and comes again with everything that it may
        have."""
        return 3 * (self.nodes + self.endpoints)


class News:
    """The rate of changes of one far bus."""

    def __init__(self, bounds: Bounds, now_s: float) -> None:
        self._rate = bounds.news_per_s
        self._most = self._left = float(bounds.news_at_once)
        self._at_s = now_s

    def is_too_much(self, now_s: float) -> bool:
        """Count one more change; returns whether the bus has exceeded its rate."""
        left = min(self._most, self._left + (now_s - self._at_s) * self._rate) - 1
        self._left = max(left, -self._rate)  # with this limit, a second without changes is enough to recover
        self._at_s = now_s
        return self._left < 0
