"""The order of the two endpoints of each far client: its reader of answers is reported before its writer of
requests. Pure.

Otherwise a server could answer a request before the reader of its client has a mirror on this bus. The answer
would be lost. Discovery finds the two endpoints in any order.
"""

from collections import defaultdict
from typing import NamedTuple

from bus_bridge.dds.graph import Found

__all__ = ["ClientPairs"]


class _Clients(NamedTuple):
    """The clients of one participant for one service, by GUID of their endpoints."""

    readers: dict[bytes, None]
    writers: dict[bytes, None]
    """Reported ones: at most as many as readers."""
    waiting: dict[bytes, Found]
    """Writers that wait for a reader."""


class ClientPairs:
    """All far clients."""

    def __init__(self) -> None:
        self._clients: defaultdict[tuple[bytes, str], _Clients] = defaultdict(lambda: _Clients({}, {}, {}))
        self._keys: dict[bytes, tuple[bytes, str]] = {}

    def added(self, found: Found, service: str) -> list[Found]:
        """Add an endpoint of a client; returns the endpoints to report now, in order."""
        gid, key = found.endpoint.gid, (found.participant, service)
        self.removed(gid)
        self._keys[gid] = key
        clients = self._clients[key]
        now = []
        if found.endpoint.kind == "subscription":
            clients.readers[gid] = None
            now.append(found)
        else:
            clients.waiting[gid] = found
        while clients.waiting and len(clients.writers) < len(clients.readers):
            first = next(iter(clients.waiting))
            now.append(clients.waiting.pop(first))
            clients.writers[first] = None
        return now

    def removed(self, gid: bytes) -> None:
        """An endpoint has gone; it need not belong to a client."""
        key = self._keys.pop(gid, None)
        if key is None:
            return
        clients = self._clients[key]
        for one in (clients.readers, clients.writers, clients.waiting):
            one.pop(gid, None)
        if not (clients.readers or clients.writers or clients.waiting):
            del self._clients[key]
