"""The matches of one endpoint, and the calls that wait until there are enough of them."""

import asyncio
from collections.abc import Callable

import msgspec

from bus.errors import BusError
from bus.qos import QoSProfile

__all__ = ["Match", "Matches"]


class Match(msgspec.Struct, frozen=True):
    """The other side of a match of a publisher or subscription.

    For example:

        print([match.node for match in publisher.matches])
    """

    node: str
    """Its node's full name."""
    gid: bytes
    """Its gid, 16 bytes that no other endpoint has."""
    qos: QoSProfile
    """Its QoS."""
    route: str
    """How messages travel: `shm` or `socket`; `bridge` if the subscription is on another bus."""


class Matches(dict[int, Match]):
    """The matches, by the broker's number of the other endpoint. No count and no event includes `taps`."""

    def __init__(self) -> None:
        self.taps: dict[int, Match] = {}
        self.total = 0
        """Number of all matches until now."""
        self._waiters: list[tuple[int, asyncio.Future[None]]] = []

    def find(self, other: int) -> Match | None:
        """The match with an endpoint or a tap."""
        return self.get(other) or self.taps.get(other)

    def reroute(self, other: int, route: str) -> None:
        """Change a match to another route, chosen by the broker."""
        for table in (self, self.taps):
            if other in table:
                table[other] = msgspec.structs.replace(table[other], route=route)

    async def wait(self, number: int, count_ready: Callable[[], int]) -> None:
        """Wait until `count_ready` returns at least `number`. Raises the error of `end`."""
        if count_ready() >= number:
            return
        waiter = asyncio.get_running_loop().create_future()
        entry = (number, waiter)
        self._waiters.append(entry)
        try:
            await waiter
        finally:
            if entry in self._waiters:
                self._waiters.remove(entry)

    def release(self, count_ready: Callable[[], int]) -> None:
        """End waits with enough matches, after more have become ready."""
        for number, waiter in self._waiters:
            if count_ready() >= number and not waiter.done():
                waiter.set_result(None)

    def end(self, reason: BusError) -> None:
        """End, because the endpoint is closed: waits raise `reason`."""
        for _, waiter in self._waiters:
            if not waiter.done():
                waiter.set_exception(reason)
        self._waiters.clear()
        self.clear()
        self.taps.clear()
