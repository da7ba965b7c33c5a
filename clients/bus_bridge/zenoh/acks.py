"""When a far publisher's bridge learns how far this one is: an ack says which part has arrived, and which was
taken by this bus.

An ack goes when it is asked for. Of a lossless publisher, whose bridge waits for what is taken, it also goes
after so many bytes, or a moment after the first of them.
"""

import asyncio

from bus_bridge.zenoh import records
from bus_bridge.zenoh.arrival import Arrival, Untaken
from bus_bridge.zenoh.session import Session

__all__ = ["Acks"]

_BYTES = 1 << 20
_PAUSE_S = 0.01


class Acks:
    """Of the parts of `arrival`, sent to `key`."""

    def __init__(self, session: Session, key: str, arrival: Arrival) -> None:
        self.is_due = False
        """The far side has asked: `send` is to follow what its question came behind."""
        self._session = session
        self._key = key
        self._arrival = arrival
        self._untaken = Untaken()
        self._unsent_bytes = 0
        self._timer: asyncio.TimerHandle | None = None

    def arrived(self, number: int, size: int) -> None:
        """A part of a lossless publisher has come, whose messages have so many bytes."""
        self._untaken.add(number, size)

    def taken(self, size: int) -> None:
        """This bus has taken so many bytes of messages more."""
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
        """None goes by itself any more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
