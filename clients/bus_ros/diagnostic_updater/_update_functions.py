"""Tasks that watch the rate of an event, and the age of its stamps."""

import threading
from typing import Any

from bus_ros.diagnostic_updater._diagnostic_status_wrapper import DiagnosticStatusWrapper
from bus_ros.diagnostic_updater._diagnostic_updater import DiagnosticTask
from bus_ros.rclpy.clock import ROSClock
from bus_ros.rosidl import message_class

__all__ = [
    "FrequencyStatus",
    "FrequencyStatusParam",
    "Heartbeat",
    "TimeStampStatus",
    "TimeStampStatusParam",
]

_DiagnosticStatus: Any = message_class("diagnostic_msgs/msg/DiagnosticStatus")
_OK, _WARN, _ERROR = _DiagnosticStatus.OK, _DiagnosticStatus.WARN, _DiagnosticStatus.ERROR


class FrequencyStatusParam:
    """Limits for FrequencyStatus.

    `freq_bound`: a dict with `min` and, unless there is no limit, `max`, in Hz; later changes of it count.
    `tolerance`: permitted deviation, as a fraction. `window_size`: number of updates over which events are
    counted; ValueError for 0.
    """

    def __init__(self, freq_bound: dict[str, float], tolerance: float = 0.1, window_size: int = 5) -> None:
        if window_size < 1:
            raise ValueError(f"window_size must be at least 1, not {window_size}")
        self.freq_bound = freq_bound
        self.tolerance = tolerance
        self.window_size = window_size


class FrequencyStatus(DiagnosticTask):
    """Warns if an event happens too often or too rarely; an error if it never happens."""

    def __init__(
        self, params: FrequencyStatusParam, name: str = "FrequencyStatus", clock: Any = None
    ) -> None:
        super().__init__(name)
        self.params = params
        self.lock = threading.Lock()
        self._clock = clock or ROSClock()
        self.clear()

    def clear(self) -> None:
        """Restart counting."""
        with self.lock:
            self.count = 0
            self.times = [self._now()] * self.params.window_size
            self.seq_nums = [0] * self.params.window_size
            self.hist_indx = 0

    def tick(self) -> None:
        """Count the event."""
        with self.lock:
            self.count += 1

    def run(self, stat: DiagnosticStatusWrapper) -> DiagnosticStatusWrapper:
        with self.lock:
            events, window = self._next_window()
        low, high = self.params.freq_bound["min"], self.params.freq_bound.get("max")
        least = low * (1 - self.params.tolerance)
        most = None if high is None else high * (1 + self.params.tolerance)
        frequency = events / window if window > 0 else float("inf") if events else 0.0
        if not events:
            stat.summary(_ERROR, "No events recorded.")
        elif frequency < least:
            stat.summary(_WARN, "Frequency too low.")
        elif most is not None and frequency > most:
            stat.summary(_WARN, "Frequency too high.")
        else:
            stat.summary(_OK, "Desired frequency met")
        stat.add("Events in window", events)
        stat.add("Events since startup", self.count)
        stat.add("Duration of window (s)", f"{window:f}")
        stat.add("Actual frequency (Hz)", f"{frequency:f}")
        if low == high:
            stat.add("Target frequency (Hz)", f"{low:f}")
        if low > 0:
            stat.add("Minimum acceptable frequency (Hz)", f"{least:f}")
        if most is not None:
            stat.add("Maximum acceptable frequency (Hz)", f"{most:f}")
        return stat

    def _next_window(self) -> tuple[int, float]:
        """The number of events since the oldest update in the window, and the seconds since then."""
        now, place = self._now(), self.hist_indx
        events, window = self.count - self.seq_nums[place], now - self.times[place]
        self.seq_nums[place], self.times[place] = self.count, now
        self.hist_indx = (place + 1) % self.params.window_size
        return events, window

    def _now(self) -> float:
        return float(self._clock.now().nanoseconds * 1e-9)


class TimeStampStatusParam:
    """Permitted ages of a stamp on arrival, in seconds; a negative age is in the future."""

    def __init__(self, min_acceptable: float = -1, max_acceptable: float = 5) -> None:
        self.max_acceptable = max_acceptable
        self.min_acceptable = min_acceptable


class TimeStampStatus(DiagnosticTask):
    """Errors for stamps that are too old, too far in the future, or zero."""

    zero_seen: bool
    deltas_valid: bool
    max_delta: float
    min_delta: float

    def __init__(
        self,
        params: TimeStampStatusParam | None = None,
        name: str = "Timestamp Status",
        clock: Any = None,
    ) -> None:
        super().__init__(name)
        self.params = params or TimeStampStatusParam()
        self.lock = threading.Lock()
        self._clock = clock or ROSClock()
        self.early_count = 0
        self.late_count = 0
        self.zero_count = 0
        self._forget()

    def tick(self, stamp: Any) -> None:
        """Check the stamp of an event: seconds, or a Time."""
        seconds = stamp if isinstance(stamp, int | float) else stamp.nanoseconds * 1e-9
        with self.lock:
            if seconds == 0:
                self.zero_seen = True
                return
            delta = self._clock.now().nanoseconds * 1e-9 - seconds
            self.max_delta = max(delta, self.max_delta) if self.deltas_valid else delta
            self.min_delta = min(delta, self.min_delta) if self.deltas_valid else delta
            self.deltas_valid = True

    def run(self, stat: DiagnosticStatusWrapper) -> DiagnosticStatusWrapper:
        with self.lock:
            stat.summary(_OK, "Timestamps are reasonable.")
            if not self.deltas_valid:
                stat.summary(_WARN, "No data since last update.")
            else:
                self._judge(stat)
            stat.add("Earliest timestamp delay:", f"{self.min_delta:f}")
            stat.add("Latest timestamp delay:", f"{self.max_delta:f}")
            stat.add("Earliest acceptable timestamp delay:", f"{self.params.min_acceptable:f}")
            stat.add("Latest acceptable timestamp delay:", f"{self.params.max_acceptable:f}")
            stat.add("Late diagnostic update count:", self.late_count)
            stat.add("Early diagnostic update count:", self.early_count)
            stat.add("Zero seen diagnostic update count:", self.zero_count)
            self._forget()
        return stat

    def _judge(self, stat: DiagnosticStatusWrapper) -> None:
        if self.min_delta < self.params.min_acceptable:
            stat.summary(_ERROR, "Timestamps too far in future seen.")
            self.early_count += 1
        if self.max_delta > self.params.max_acceptable:
            stat.summary(_ERROR, "Timestamps too far in past seen.")
            self.late_count += 1
        if self.zero_seen:
            stat.summary(_ERROR, "Zero timestamp seen.")
            self.zero_count += 1

    def _forget(self) -> None:
        self.zero_seen = self.deltas_valid = False
        self.max_delta = self.min_delta = 0.0


class Heartbeat(DiagnosticTask):
    """OK, as long as the node is spun."""

    def __init__(self) -> None:
        super().__init__("Heartbeat")

    def run(self, stat: DiagnosticStatusWrapper) -> DiagnosticStatusWrapper:
        stat.summary(_OK, "Alive")
        return stat
