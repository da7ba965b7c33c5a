"""The publishers and subscriptions of one node, including those in its services and clients.

Owns: their declaration, the list of open ones, their counts, and their end with the node. Must not know:
their parts and their purpose.
"""

import asyncio
from collections.abc import Iterable
from typing import Any

import msgspec

from bus.endpoint.core import EndpointCore
from bus.errors import BusError, ConnectionClosed
from bus.link.declarations import LinkNode

__all__ = ["NodeEndpoints", "NodeStatistics"]

_LEAST_SWEPT = 16


class NodeStatistics(msgspec.Struct, frozen=True):
    """Totals of one node's open endpoints, including the endpoints of its services and of /rosout.

    For example:

        print(node.statistics().dropped)
    """

    published: int
    """Messages that its publishers took."""
    delivered: int
    """Messages that its subscriptions gave to the program."""
    dropped: int
    """Messages that its subscriptions lost, whatever the reason."""
    publishers: int
    """Publishers that are open."""
    subscriptions: int
    """Subscriptions that are open."""


class NodeEndpoints:
    """The open publishers and subscriptions of `node`."""

    def __init__(self, node: LinkNode) -> None:
        self._node = node
        self._all: list[EndpointCore[Any]] = []  # some of them may be closed
        self._sweep_at = _LEAST_SWEPT

    async def declare(self, *endpoints: EndpointCore[Any]) -> None:
        """Declare endpoints to busd, in this order and with one wait for its answers: all, or none.

        Raises busd's refusal. After a cancellation none is declared.
        """
        try:
            if len(endpoints) == 1:
                await endpoints[0].link.declare(self._node, endpoints[0])
            else:
                from bus.base.together import together  # late: few programs have services

                await together(one.link.declare(self._node, one) for one in endpoints)
            self._all += endpoints
        except BaseException as error:
            _end_open(endpoints, ConnectionClosed(f"not created: {error}"))
            raise
        if len(self._all) >= self._sweep_at:
            self._all = [one for one in self._all if one.refusal is None]
            self._sweep_at = 2 * len(self._all) + _LEAST_SWEPT

    async def close(self) -> None:
        """Close all endpoints concurrently; raises the error of one. After a cancellation, call `end`."""
        results = await asyncio.gather(*(one.close() for one in self._all), return_exceptions=True)
        for result in results:
            if isinstance(result, BaseException):
                raise result

    def end(self, reason: BusError) -> None:
        """End the endpoints that are still open, because their `close` was interrupted."""
        _end_open(self._all, reason)

    def forget_ids(self) -> None:
        """Forget the ids, which are from an earlier broker: nothing must be sent about them."""
        for endpoint in self._all:
            endpoint.id = 0

    def counts(self) -> tuple[int, int]:
        """The numbers of open publishers and subscriptions; at any time and from any thread."""
        used = self._open()
        publishers = sum(one.kind == "publisher" for one in used)
        return publishers, len(used) - publishers

    def statistics(self) -> NodeStatistics:
        """The sums over open endpoints."""
        used = self._open()
        publishers = [one.statistics() for one in used if one.kind == "publisher"]
        subscriptions = [one.statistics() for one in used if one.kind != "publisher"]
        return NodeStatistics(
            published=sum(one.published for one in publishers),
            delivered=sum(one.delivered for one in subscriptions),
            dropped=sum(sum(one.dropped.values()) for one in subscriptions),
            publishers=len(publishers),
            subscriptions=len(subscriptions),
        )

    def _open(self) -> list[EndpointCore[Any]]:
        return [one for one in tuple(self._all) if one.refusal is None]


def _end_open(endpoints: Iterable[EndpointCore[Any]], reason: BusError) -> None:
    for endpoint in endpoints:
        if endpoint.refusal is None:
            endpoint.link.forget(endpoint)
            endpoint.end(reason)
