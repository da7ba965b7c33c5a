"""Writes the same frames to connections, as fast as each accepts them, and discards all input."""

import select
from collections.abc import Callable, Iterable
from time import monotonic
from typing import NamedTuple

from benchmarks.adapters.hostile.raw import Client, control
from benchmarks.adapters.hostile.tally import Tally

_LOOK_S = 0.1
_HEARTBEAT_S = 2.0
_READ_BYTES = 1 << 18


class Feed(NamedTuple):
    """`block` makes the next data for `client`: whole frames with `things` requests."""

    client: Client
    block: Callable[[], bytes]
    things: int


def repeated(client: Client, frame: bytes, times: int) -> Feed:
    """A feed with the same frame, again and again."""
    block = frame * times
    return Feed(client, lambda: block, times)


class Pump:
    """Feeds clients. Reads at most `read_bytes` at a time from clients of `feeds` and from `listeners`.

    `sleepers` never read. They and the listeners send pings often enough, so busd keeps them connected.
    """

    def __init__(
        self,
        feeds: Iterable[Feed],
        *,
        listeners: Iterable[Client] = (),
        sleepers: Iterable[Client] = (),
        read_bytes: int = _READ_BYTES,
    ) -> None:
        self._feeds = {feed.client.fileno(): feed for feed in feeds}
        self._rests = dict.fromkeys(self._feeds, memoryview(b""))
        heard = [*listeners]
        self._readers = {one.fileno(): one for one in heard}
        self._readers |= {number: feed.client for number, feed in self._feeds.items()}
        self._quiet = [*heard, *sleepers]
        self._read_bytes = read_bytes
        self._heartbeat_s = 0.0

    def run(self, tally: Tally) -> None:
        """Run until the tally ends it. Raises ConnectionError if busd disconnects a client."""
        with select.epoll() as poll:
            for number in self._readers:
                feeds = select.EPOLLOUT if number in self._feeds else 0
                poll.register(number, select.EPOLLIN | feeds)
            goes_on = True
            while goes_on:
                written = 0
                for number, events in poll.poll(_LOOK_S):
                    if events & ~select.EPOLLOUT:
                        self._readers[number].forget(self._read_bytes)
                    if events & select.EPOLLOUT:
                        written += self._write(number)
                self._keep_alive()
                goes_on = tally.add(written)

    def _write(self, number: int) -> int:
        feed, rest = self._feeds[number], self._rests[number]
        begun = 0
        if not rest:
            rest, begun = memoryview(feed.block()), feed.things
        self._rests[number] = rest[feed.client.write_some(rest) :]
        return begun

    def _keep_alive(self) -> None:
        if monotonic() > self._heartbeat_s:
            self._heartbeat_s = monotonic() + _HEARTBEAT_S
            for client in self._quiet:
                client.write_some(_PING)


_PING = control("ping", number=0)
