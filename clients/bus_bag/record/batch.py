"""Messages of one topic that were taken together: one by one, or back to back in one buffer. Pure."""

from collections.abc import Iterator
from itertools import islice
from operator import itemgetter
from struct import Struct
from typing import TypeAlias

from bus.subscription import MessageInfo, Pack

__all__ = ["Batch", "Packed", "Sample", "log_time_of", "size_of"]

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
        self.log_time = pack.received_timestamp if log_time is None else log_time
        """The time of reception of all messages."""
        self.publisher_gid = pack.publisher_gid
        """Empty if they are from several publishers."""

    def __len__(self) -> int:
        return self.count

    def samples(self, newest: int | None = None) -> list[Sample]:
        """The messages one by one: all, or only the `newest`."""
        first = 0 if newest is None else max(0, self.count - newest)
        return list(islice(self._samples(first), first, None))

    def _samples(self, first: int) -> Iterator[Sample]:
        """All messages; those before `first` without their payload."""
        data, at = self.data, 0
        for index in range(self.count):
            number, publish_time, size = _HEAD.unpack_from(data, at)
            at += _HEAD.size
            payload = data[at : at + size] if index >= first else b""
            at += size
            yield payload, MessageInfo(publish_time, self.log_time, number, 0, self.publisher_gid)


Batch: TypeAlias = list[Sample] | Packed


def size_of(batch: Batch) -> int:
    """Bytes of the payloads."""
    return batch.size if isinstance(batch, Packed) else sum(map(len, map(_payload, batch)))


def log_time_of(batch: Batch) -> int:
    """The log time of the first message; there is one."""
    return batch.log_time if isinstance(batch, Packed) else batch[0][1].received_timestamp
