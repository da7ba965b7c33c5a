"""Messages of one topic that were taken together: one by one, or back to back in one buffer. Pure.

A batch carries its count, its bytes and its log time from here to the file, so nothing computes them twice.
"""

from operator import itemgetter
from struct import Struct
from typing import TypeAlias

from bus import shm
from bus.subscription import MessageInfo, Pack

__all__ = ["Batch", "Packed", "Sample", "Samples"]

Sample: TypeAlias = tuple[bytes, MessageInfo]
"""A payload and its info."""

_HEAD = Struct("<QQI")
"""The head of each message in a buffer: its number, its publish time, its size. A false time may be below
zero; it is not negative here, nor in a file."""
_payload = itemgetter(0)


class Packed:
    """Messages back to back, as `Subscription.take_packed` takes them. A message costs next to nothing
    here."""

    __slots__ = ("count", "data", "log_time", "publisher_gid", "size")

    def __init__(self, pack: Pack, log_time: int | None = None) -> None:
        self.data = pack.data
        self.count = pack.messages
        self.size = pack.payload_bytes
        """Bytes of the payloads."""
        self.log_time = pack.received_timestamp if log_time is None else log_time
        """The time of reception of all messages."""
        self.publisher_gid = pack.publisher_gid
        """Empty if they are from several publishers."""

    def samples(self, newest: int | None = None) -> list[Sample]:
        """The messages one by one: all, or only the `newest`."""
        data, at, left = self.data, 0, self.count
        if newest is not None and newest < left:
            at = shm.native.scan_packed(data, 0, left - newest)[1]
            left = newest
        found: list[Sample] = []
        for _ in range(left):
            number, publish_time, size = _HEAD.unpack_from(data, at)
            at += _HEAD.size
            info = MessageInfo(publish_time, self.log_time, number, 0, self.publisher_gid)
            found.append((data[at : at + size], info))
            at += size
        return found


class Samples:
    """Messages one by one, at least one."""

    __slots__ = ("_samples", "count", "log_time", "size")

    def __init__(self, samples: list[Sample]) -> None:
        self._samples = samples
        self.count = len(samples)
        self.size = sum(map(len, map(_payload, samples)))
        """Bytes of the payloads."""
        self.log_time = samples[0][1].received_timestamp
        """The time of reception of the first message."""

    def samples(self) -> list[Sample]:
        """The messages."""
        return self._samples


Batch: TypeAlias = Samples | Packed
