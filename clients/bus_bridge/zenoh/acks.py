"""Acks to a far publisher's bridge: the newest part that has arrived, and the newest that this bus has taken.

An ack is sent when the far side asks for it. A lossless publisher waits for acks, so its bridge also gets one
after many bytes were taken, or a moment after the first of them.
"""

import asyncio

from bus_bridge.zenoh import records
from bus_bridge.zenoh.arrival import Arrival, Untaken
from bus_bridge.zenoh.session import Session

__all__ = ["Acks"]

_BYTES = 1 << 20
_PAUSE_S = 0.01


class Acks:
    """Acks for the parts of `arrival`, sent to `key`."""

    def __init__(self, session: Session, key: str, arrival: Arrival) -> None:
        self.is_due = False
        """The far side has asked. Call `send` when the parts before its question have been handled."""
        self._session = session
        self._key = key
        self._arrival = arrival
        self._untaken = Untaken()
        self._unsent_bytes = 0
        self._timer: asyncio.TimerHandle | None = None

    def arrived(self, number: int, size: int) -> None:
        """Handle a part of a lossless publisher that has arrived with `size` bytes of messages."""
        self._untaken.add(number, size)

    def taken(self, size: int) -> None:
        """Handle `size` more bytes of messages that this bus has taken."""
        self._untaken.take(size)
        self._unsent_bytes += size
        if self._unsent_bytes >= _BYTES:
            self.send()
        elif self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(_PAUSE_S, self.send)

    def send(self) -> None:
        self.close()
        self._unsent_bytes, self.is_due = 0, False
        ack = records.write_pair(self._arrival.last, self._untaken.last_taken())
        self._session.put(self._key, ack)

    def close(self) -> None:
        """Cancel the ack that is due."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
