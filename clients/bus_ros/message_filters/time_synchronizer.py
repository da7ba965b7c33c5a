"""Sets of messages, one of each filter, with the same stamp or nearly the same."""

import threading
from collections.abc import Iterable
from typing import Any

from bus_ros.message_filters import matching, stamps
from bus_ros.message_filters.simple_filter import SimpleFilter
from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.time import Time

__all__ = ["ApproximateTimeSynchronizer", "TimeSynchronizer"]


class TimeSynchronizer(SimpleFilter):
    """Puts out one message of each filter in `fs` once all have one with the same stamp.

    `queue_size`: at most so many messages of each filter wait for the others. Above it, the oldest by stamp
    is dropped. Messages older than a set that was put out still wait: sets may come out of order. Callbacks
    are called for one set at a time, in the thread that brought its last message; a callback that blocks
    holds up the others. Raises ValueError for a `queue_size` below 1.
    """

    def __init__(self, fs: Iterable[SimpleFilter], queue_size: int) -> None:
        super().__init__()
        if queue_size < 1:
            raise ValueError(f"queue_size must be at least 1, not {queue_size}")
        self.queue_size = queue_size
        # A callback may itself put a message into one of the filters.
        self.lock = threading.RLock()
        self.connectInput(fs)

    def connectInput(self, fs: Iterable[SimpleFilter]) -> None:
        inputs = list(fs)
        self.queues: list[dict[int, Any]] = [{} for _ in inputs]
        self.input_connections = [
            one.registerCallback(self.add, queue, index)
            for index, (one, queue) in enumerate(zip(inputs, self.queues, strict=True))
        ]

    def add(self, msg: Any, my_queue: dict[int, Any], my_queue_index: int | None = None) -> None:
        stamp = stamps.header_stamp(msg)
        if stamp is None:
            raise AttributeError(
                f"{type(msg).__name__} has no header.stamp: it can't be synchronized by time"
            )
        self._take(msg, stamp.nanoseconds, my_queue)

    def _take(self, msg: Any, stamp: int, queue: dict[int, Any]) -> None:
        with self.lock:
            queue[stamp] = msg
            matching.bound(queue, self.queue_size)
            found = self._match(stamp, next(place for place, one in enumerate(self.queues) if one is queue))
            if found is not None:
                self.signalMessage(*(one.pop(part) for one, part in zip(self.queues, found, strict=True)))

    def _match(self, stamp: int, index: int) -> tuple[int, ...] | None:
        """The stamps of the set that this message completes."""
        return (stamp,) * len(self.queues) if matching.match_exactly(self.queues, stamp) else None


class ApproximateTimeSynchronizer(TimeSynchronizer):
    """Puts out one message of each filter in `fs` as soon as their stamps are less than `slop` seconds apart.

    A message is matched with the nearest messages of the others on its arrival. A message without a header is
    left out, with a warning. With `allow_headerless`, its stamp is the time of its arrival;
    `sync_arrival_time` does this for all messages. For the rest see TimeSynchronizer.
    """

    def __init__(
        self,
        fs: Iterable[SimpleFilter],
        queue_size: int,
        slop: float,
        allow_headerless: bool = False,
        sync_arrival_time: bool = False,
    ) -> None:
        super().__init__(fs, queue_size)
        self.slop = Duration(seconds=slop)
        self.allow_headerless = allow_headerless
        self.sync_arrival_time = sync_arrival_time

    def add(self, msg: Any, my_queue: dict[int, Any], my_queue_index: int | None = None) -> None:
        stamp = self._stamp(msg)
        if stamp is not None:
            self._take(msg, stamp.nanoseconds, my_queue)

    def _stamp(self, msg: Any) -> Time | None:
        found = None if self.sync_arrival_time else stamps.header_stamp(msg)
        if found is not None:
            return found
        if self.sync_arrival_time or self.allow_headerless:
            return stamps.now()
        stamps.warn_of_headerless("message_filters_approx", "can not use message filters for messages")
        return None

    def _match(self, stamp: int, index: int) -> tuple[int, ...] | None:
        return matching.match_approximately(self.queues, index, stamp, self.slop.nanoseconds)
