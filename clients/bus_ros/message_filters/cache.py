"""The last messages of a filter, for look-ups by their stamps."""

from collections import deque
from typing import Any

from bus_ros.message_filters import stamps
from bus_ros.message_filters.simple_filter import SimpleFilter
from bus_ros.rclpy.time import Time

__all__ = ["Cache"]


class Cache(SimpleFilter):
    """Keeps the last `cache_size` messages, and passes each on as it arrives.

    They are in order of arrival, whatever their stamps. A message without a header is left out, with a
    warning. With `allow_headerless` it is kept with the time of its arrival. May be read from any thread.
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
        """The messages between two times, inclusive; raises AssertionError if the end is first."""
        if from_stamp > to_stamp:
            raise AssertionError(f"the interval ends at {to_stamp}, before it begins at {from_stamp}")
        return [msg for time, msg in list(self._kept) if from_stamp <= time <= to_stamp]

    def getElemAfterTime(self, stamp: Time) -> Any:
        """The first arrived message with that time or later, or None."""
        return next((msg for time, msg in list(self._kept) if time >= stamp), None)

    def getElemBeforeTime(self, stamp: Time) -> Any:
        """The last arrived message with that time or earlier, or None."""
        return next((msg for time, msg in reversed(list(self._kept)) if time <= stamp), None)

    def getLatestTime(self) -> Time | None:
        """The time of the last arrived message, or None."""
        times = self.cache_times
        return times[-1] if times else None

    getLastestTime = getLatestTime
    """Jazzy's spelling."""

    def getOldestTime(self) -> Time | None:
        """The time of the first arrived message, or None."""
        times = self.cache_times
        return times[0] if times else None

    def getLast(self) -> Any:
        """The first arrived message that is not older than the last arrived one, or None."""
        latest = self.getLatestTime()
        return None if latest is None else self.getElemAfterTime(latest)
