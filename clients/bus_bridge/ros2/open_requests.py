"""Requests of ROS 2 to the servers of one service on this bus: each goes to the bus once.

Owns: their numbers on the bus, and by which of our servers in ROS 2 they can be answered. Must not know: the
bus, payloads.

A client in ROS 2 sends a request to each of our servers of the service. On this bus, the topic of requests
leads to each server too. Otherwise with two servers, each would carry out a request twice.
"""

from collections import OrderedDict
from typing import Final, NamedTuple

from bus_bridge.ros2.calls import RequestId, Server

__all__ = ["OpenRequest", "OpenRequests"]

_MOST: Final = 10_000
_MOST_ENDED: Final = 1000

Key = tuple[bytes, int]


class OpenRequest(NamedTuple):
    """A request without an answer."""

    request: RequestId
    servers: dict[Server, None]
    """Our servers that have received it."""

    def answer(self, cdr: bytes) -> None:
        """Answer it by one of the servers."""
        is_answered = False
        for server in self.servers:
            if is_answered:
                server.drop(self.request)
            else:
                is_answered = server.answer(self.request, cdr)

    def drop(self) -> None:
        """There will be no answer."""
        for server in self.servers:
            server.drop(self.request)


class OpenRequests:
    """All requests to one service."""

    def __init__(self) -> None:
        self._last = 0
        self._by_key: dict[Key, OpenRequest] = {}
        self._keys: dict[RequestId, Key] = {}
        self._ended: OrderedDict[RequestId, None] = OrderedDict()
        """The last ended requests: another server may receive one later."""

    def __len__(self) -> int:
        return len(self._by_key)

    def add(self, request: RequestId, server: Server) -> Key | None:
        """Note a request that a server has received. Returns the client and the number for the bus, or None
        if it is open already or has ended."""
        if (key := self._keys.get(request)) is not None:
            self._by_key[key].servers[server] = None
            return None
        if request in self._ended:
            server.drop(request)
            return None
        self._last += 1
        key = self._keys[request] = request.writer, self._last
        self._by_key[key] = OpenRequest(request, {server: None})
        return key

    def pop(self, key: Key) -> OpenRequest | None:
        """A request that ends now; None if it is not known."""
        found = self._by_key.pop(key, None)
        if found is not None:
            del self._keys[found.request]
            self._ended[found.request] = None
            if len(self._ended) > _MOST_ENDED:
                self._ended.popitem(last=False)
        return found

    def pop_oldest(self) -> OpenRequest | None:
        """The oldest request, if there are too many."""
        return self.pop(next(iter(self._by_key))) if len(self._by_key) > _MOST else None

    def pop_of(self, server: Server) -> list[OpenRequest]:
        """A server is closed: the requests that no other one can answer."""
        last = []
        for key, one in list(self._by_key.items()):
            if server in one.servers:
                del one.servers[server]
                if not one.servers:
                    last.append(self.pop(key) or one)
        return last
