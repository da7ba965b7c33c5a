"""The age of messages from another machine, even if its clock is wrong by an hour. Pure.

The difference of the two clocks is unknown. But the fastest of all recent messages took almost no time. So
the age of a message is its delay relative to the fastest one.
"""

__all__ = ["Lateness"]

_WINDOW_NS = 30_000_000_000
_STEP_NS = 100_000_000
"""Largest normal step backwards between the times of a publisher's messages. A larger step means that its
clock was set."""


class Lateness:
    """Ages of messages with times of one far clock. It may be set and may drift, so only the last half minute
    counts.

    `now_ns` comes from a clock that is never set. It has no relation to the far clock.
    """

    def __init__(self) -> None:
        self._least_ns: int | None = None  # in the current window, which began at `_since_ns`
        self._before_ns: int | None = None  # in the previous window
        self._since_ns = 0

    def note(self, now_ns: int, source_ns: int, before_ns: int = 0) -> None:
        """Record a message. If messages arrive together, the newest one is enough.

        `before_ns`: the source time of its publisher's previous message; 0 if there was none.
        """
        if source_ns < before_ns - _STEP_NS:  # the far clock was set back, so the least lateness is wrong
            self._least_ns = self._before_ns = None
        if now_ns - self._since_ns > _WINDOW_NS:
            is_next = now_ns - self._since_ns <= 2 * _WINDOW_NS
            self._before_ns = self._least_ns if is_next else None
            self._least_ns, self._since_ns = None, now_ns
        lateness_ns = now_ns - source_ns
        if self._least_ns is None or lateness_ns < self._least_ns:
            self._least_ns = lateness_ns

    def age_ns(self, now_ns: int, source_ns: int) -> int:
        """The age of a message that was recorded, or that arrived together with a recorded one."""
        least_ns = min((one for one in (self._least_ns, self._before_ns) if one is not None), default=None)
        return 0 if least_ns is None else max(0, now_ns - source_ns - least_ns)
