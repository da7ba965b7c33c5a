"""The time of a bag during the replay: the due time of each moment of the bag on the monotonic clock.

Pure: the present time is an argument. All times are nanoseconds. Times of the bag are the times of its
messages; times of the machine are times of `time.monotonic_ns`.

One point that both clocks share, and a rate, define the line. The due time of a message only depends on them.
So the replay doesn't drift, however late single messages are. Each change of the rate, and each end of a
pause, moves the point. Only `jump` makes the time of the bag jump.
"""

__all__ = ["TimeLine"]

_LEAST_RATE, _MOST_RATE = 1e-9, 1e9
"""With a rate outside, a due time may be outside the range of numbers."""


class TimeLine:
    """Starts at `now_ns`, with the moment `bag_ns` of the bag, unless it `is_paused`.

    Raises ValueError for a rate that `is_rate` refuses.
    """

    RATES = "a rate from 1e-9 to 1e9"
    """The valid rates in words."""

    def __init__(self, bag_ns: int, now_ns: int, rate: float = 1.0, *, is_paused: bool = False) -> None:
        if not self.is_rate(rate):
            raise ValueError(f"a rate of {rate!r}")
        self.rate: float = rate
        """Seconds of the bag in a second."""
        self._bag_ns = bag_ns
        self._point_ns = now_ns
        self._hold_ns: int | None = 0 if is_paused else None

    @staticmethod
    def is_rate(rate: float) -> bool:
        """Whether `rate` is valid: not nan, and in the range."""
        return _LEAST_RATE <= rate <= _MOST_RATE

    @property
    def is_paused(self) -> bool:
        """Whether the bag's time stands still."""
        return self._hold_ns is not None

    def is_delayed(self, now_ns: int) -> bool:
        """Whether it still waits before its start."""
        return self._hold_ns is None and now_ns < self._point_ns

    def bag_time(self, now_ns: int) -> int:
        """The moment of the bag at `now_ns`."""
        if self._hold_ns is not None or now_ns <= self._point_ns:
            return self._bag_ns
        return self._bag_ns + round((now_ns - self._point_ns) * self.rate)

    def due(self, bag_ns: int) -> int | None:
        """The past or future time at which that moment of the bag is due; None while the bag is paused."""
        if self._hold_ns is not None:
            return None
        return self._point_ns + round((bag_ns - self._bag_ns) / self.rate)

    def pause(self, now_ns: int) -> None:
        """Stop the time. The remaining delay of a start comes after the pause."""
        if self._hold_ns is None:
            self._settle(now_ns)
            self._hold_ns = self._point_ns - now_ns

    def resume(self, now_ns: int) -> None:
        """Continue at the moment at which the bag was paused."""
        if self._hold_ns is not None:
            self._point_ns = now_ns + self._hold_ns
            self._hold_ns = None

    def set_rate(self, rate: float, now_ns: int) -> bool:
        """Change the rate; returns False without a change if `rate` is not valid."""
        if not self.is_rate(rate):
            return False
        self._settle(now_ns)
        self.rate = rate
        return True

    def jump(self, bag_ns: int, now_ns: int, delay_ns: int = 0) -> None:
        """Jump to the moment `bag_ns`, and continue there after `delay_ns` of the machine."""
        self._bag_ns = bag_ns
        if self._hold_ns is None:
            self._point_ns = now_ns + delay_ns
        else:
            self._hold_ns = delay_ns

    def skip_to(self, bag_ns: int, now_ns: int) -> None:
        """Jump ahead to the moment `bag_ns`. The remaining delay of a start stays."""
        self.jump(bag_ns, now_ns, max(0, self._point_ns - now_ns) if self._hold_ns is None else self._hold_ns)

    def _settle(self, now_ns: int) -> None:
        """Move the shared point to the present, unless it is in the future."""
        if self._hold_ns is None and now_ns > self._point_ns:
            self._bag_ns = self.bag_time(now_ns)
            self._point_ns = now_ns
