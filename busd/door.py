"""Connections that wait until they are heard, because too many of their user came lately.

What they send waits in their sockets. Their end does not: who hangs up shall not keep the place of another.
"""

import asyncio
import select

from busd.peer import PeerConnection

__all__ = ["Door"]


class Door:
    """`close` it when nobody is let in any more."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._waiting: dict[int, tuple[PeerConnection, asyncio.TimerHandle]] = {}
        # One of its own: the loop's would tell of bytes to read as well, again and again.
        self._epoll = select.epoll()
        self._loop.add_reader(self._epoll.fileno(), self._look)

    def hold(self, connection: PeerConnection, seconds: float) -> None:
        """Let a new connection wait for so long."""
        number = connection.fileno()
        self._epoll.register(number, select.EPOLLRDHUP)
        timer = self._loop.call_later(seconds, self._forget, number)
        self._waiting[number] = connection, timer
        connection.pause(seconds)  # last, for what is read after it may close the socket, and its number

    def close(self) -> None:
        if not self._epoll.closed:
            for number in tuple(self._waiting):
                self._forget(number)
            self._loop.remove_reader(self._epoll.fileno())
            self._epoll.close()

    def _look(self) -> None:
        for number, _ in self._epoll.poll(0):
            self._forget(number).let_go()

    def _forget(self, number: int) -> PeerConnection:
        self._epoll.unregister(number)
        connection, timer = self._waiting.pop(number)
        timer.cancel()
        return connection
