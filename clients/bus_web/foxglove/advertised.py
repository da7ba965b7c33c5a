"""Channels or services advertised to a client under ids, and the changes to send next. Pure."""

from collections.abc import Mapping
from itertools import count
from typing import Generic, NamedTuple, TypeVar

__all__ = ["Advertised", "Entry"]

K = TypeVar("K")
T = TypeVar("T")


class Entry(NamedTuple, Generic[K, T]):
    """A channel or a service that the client knows."""

    id: int
    kind: K
    """Its type, or its types."""
    format: T
    """The format in which its messages are announced."""


class Advertised(Generic[K, T]):
    """Channels or services by name. An id is given once."""

    def __init__(self) -> None:
        self._numbers = count(1)
        self._entries: dict[str, Entry[K, T]] = {}
        self._names: dict[int, str] = {}

    @property
    def entries(self) -> Mapping[str, Entry[K, T]]:
        return self._entries

    def name_of(self, id: int) -> str | None:
        """None if the id was never sent to the client, or has gone."""
        return self._names.get(id)

    def gone(self, now: Mapping[str, K]) -> list[str]:
        """Names that no longer exist, or have another kind: `remove` them."""
        return [name for name, known in self._entries.items() if now.get(name) != known.kind]

    def missing(self, now: Mapping[str, K]) -> list[str]:
        """Names that the client does not know yet: `add` them."""
        return [name for name in now if name not in self._entries]

    def add(self, name: str, kind: K, format: T) -> int:
        """Returns its id for the client."""
        id = next(self._numbers)
        self._entries[name] = Entry(id, kind, format)
        self._names[id] = name
        return id

    def remove(self, name: str) -> int:
        """Returns its id, which must be sent to the client."""
        id = self._entries.pop(name).id
        del self._names[id]
        return id
