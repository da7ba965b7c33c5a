"""The types that processes have declared, with their descriptions.

Owns the tables, and the accounts of each process and user for them. Must not know the users of a type.
"""

from collections import Counter

from busd.core.entities import MessageType, Peer
from busd.core.work import TELL, Work

__all__ = ["TypeTable"]


class TypeTable:
    """A description stays as long as any peer has declared the type. The first one counts."""

    def __init__(self) -> None:
        self.trusted: dict[MessageType, bytes] = {}
        self.of_guests: dict[MessageType, bytes] = {}
        """Descriptions by guests; a guest might lie."""
        self._declarers: Counter[MessageType] = Counter()
        """How many peers have declared a type."""

    def add(self, peer: Peer, kind: MessageType, schema: bytes, *, is_trusted: bool) -> None:
        """`peer` has declared a type."""
        held = (self.trusted if is_trusted else self.of_guests).setdefault(kind, schema)
        peer.types[kind] = len(held)
        self._declarers[kind] += 1
        for holder in (peer, peer.user):
            holder.schema_bytes += len(held)

    def forget(self, peer: Peer) -> Work:
        """Remove the descriptions of types that only `peer` had declared."""
        while peer.types:
            kind, size = peer.types.popitem()
            for holder in (peer, peer.user):
                holder.schema_bytes -= size
            self._declarers[kind] -= 1
            if not self._declarers[kind]:
                del self._declarers[kind]
                self.trusted.pop(kind, None)
                self.of_guests.pop(kind, None)
            yield TELL

    def find(self, kind: MessageType) -> bytes | None:
        """The description of a type: a guest's counts only if there is no other."""
        return self.trusted.get(kind) or self.of_guests.get(kind)
