"""The last messages of a filter, to be looked up by their stamps."""

from collections import deque
from typing import Any

from bus_ros.message_filters import stamps
from bus_ros.message_filters.simple_filter import SimpleFilter
from bus_ros.rclpy.time import Time

__all__ = ["Cache"]


class Cache(SimpleFilter):
    """Keeps the `cache_size` messages that came last, and puts each out as it comes.

    They stand in the order in which they came, whatever their stamps. A message without a header is left
    out, with a warning, or with `allow_headerless` kept with the time of its arrival. May be read from any
    thread.
    """

    def __init__(self, f: SimpleFilter, cache_size: int = 1, allow_headerless: bool = False) -> None:
        super().__init__()
        self.cache_size = cache_size
        self.allow_headerless = allow_headerless
        self._kept: deque[tuple[Time, Any]] = deque(maxlen=cache_size)
        self.connectInput(f)

    def connectInput(self, f: SimpleFilter) -> None:
        self.incoming_connection = f.registerCallback(self.add)

    def add(self, msg: Any) -> None:
        stamp = stamps.header_stamp(msg)
        if stamp is None:
            if not self.allow_headerless:
                stamps.warn_of_headerless("message_filters_cache", "can not use message filters messages")
                return
            stamp = stamps.now()
        self._kept.append((stamp, msg))
        self.signalMessage(msg)

    @property
    def cache_msgs(self) -> list[Any]:
        return [msg for _, msg in list(self._kept)]

    @property
    def cache_times(self) -> list[Time]:
        return [time for time, _ in list(self._kept)]

    def getInterval(self, from_stamp: Time, to_stamp: Time) -> list[Any]:
        """The messages between two times, which both count; raises AssertionError where the end is first."""
        if from_stamp > to_stamp:
            raise AssertionError(f"the interval ends at {to_stamp}, before it begins at {from_stamp}")
        return [msg for time, msg in list(self._kept) if from_stamp <= time <= to_stamp]

    def getElemAfterTime(self, stamp: Time) -> Any:
        """The first that came of those at that time or later, or None."""
        return next((msg for time, msg in list(self._kept) if time >= stamp), None)

    def getElemBeforeTime(self, stamp: Time) -> Any:
        """The last that came of those at that time or earlier, or None."""
        return next((msg for time, msg in reversed(list(self._kept)) if time <= stamp), None)

    def getLatestTime(self) -> Time | None:
        """The time of the message that came last, or None."""
        times = self.cache_times
        return times[-1] if times else None

    getLastestTime = getLatestTime
    """As Jazzy spells it."""

    def getOldestTime(self) -> Time | None:
        """The time of the message that came first, or None."""
        times = self.cache_times
        return times[0] if times else None

    def getLast(self) -> Any:
        """The first that came of those not older than the last that came, or None."""
        latest = self.getLatestTime()
        return None if latest is None else self.getElemAfterTime(latest)
