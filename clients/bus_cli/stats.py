"""Calculations of hz, bw and delay: windows over the last messages, and the rate of a topic's publishers.

Pure: times are arguments. The rules are the same as in ros2topic's verbs.
"""

import math
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from bus_plot.histogram import histogram

__all__ = ["Bandwidth", "Delays", "Flow", "Intervals", "Spread", "spread"]

_NS_PER_S = 1_000_000_000


class Spread(NamedTuple):
    """Mean, least, most and population deviation of `window` values."""

    mean: float
    least: float
    most: float
    deviation: float
    window: int


def spread(values: Iterable[float]) -> Spread:
    """The spread of at least one value."""
    known = tuple(values)
    mean = math.fsum(known) / len(known)
    deviation = math.sqrt(math.fsum((value - mean) ** 2 for value in known) / len(known))
    return Spread(mean, min(known), max(known), deviation, len(known))


class Intervals:
    """The gaps between messages in nanoseconds, and the time to print them."""

    def __init__(self, window: int) -> None:
        self._gaps: deque[int] = deque(maxlen=window)
        self._last_ns = 0
        self._printed_ns = 0

    def add(self, now_ns: int) -> None:
        """Count a message that arrived at `now_ns`."""
        if self._last_ns:
            self._gaps.append(now_ns - self._last_ns)
        self._last_ns = now_ns

    def due(self) -> Spread | None:
        """The gaps if a message has arrived a second or more after the last print; else None."""
        if not self._gaps:
            return None
        if not self._printed_ns:
            self._printed_ns = self._last_ns
            return None
        if self._last_ns < self._printed_ns + _NS_PER_S:
            return None
        self._printed_ns = self._last_ns
        return spread(self._gaps)

    def new(self) -> Spread | None:
        """The gaps if a message has arrived since the last result; else None. For tables."""
        if not self._gaps or self._last_ns == self._printed_ns:
            return None
        self._printed_ns = self._last_ns
        return spread(self._gaps)


class Bandwidth:
    """Sizes of messages in bytes, with their times."""

    def __init__(self, window: int) -> None:
        self._samples: deque[tuple[int, int]] = deque(maxlen=window)

    def add(self, now_ns: int, size: int) -> None:
        """Count a message of `size` bytes that arrived at `now_ns`."""
        self._samples.append((now_ns, size))

    def rate(self, now_ns: int) -> tuple[float, Spread] | None:
        """Bytes per second from the window's first message until now, and the sizes; None for one message."""
        if len(self._samples) < 2 or now_ns <= self._samples[0][0]:
            return None
        sizes = spread(size for _, size in self._samples)
        return sizes.mean * sizes.window * _NS_PER_S / (now_ns - self._samples[0][0]), sizes


class Delays:
    """Times from a message's stamp to its arrival, in nanoseconds. As in ros2, the first does not count."""

    def __init__(self, window: int) -> None:
        self._delays: deque[int] = deque(maxlen=window)
        self._has_begun = False
        self._is_new = False

    def add(self, delay_ns: int) -> None:
        if self._has_begun:
            self._delays.append(delay_ns)
            self._is_new = True
        self._has_begun = True

    @property
    def is_empty(self) -> bool:
        return not self._delays

    def histogram(self) -> tuple[float, float, list[int]]:
        """Half of the delays are at most the first number, 99 % at most the second; and the number of delays
        in each part of a histogram."""
        ordered = sorted(self._delays)
        last = len(ordered) - 1
        return ordered[last // 2], ordered[min(last, math.ceil(0.99 * len(ordered)) - 1)], histogram(ordered)

    def due(self) -> Spread | None:
        """The delays; None if no message has arrived since the last call."""
        if not self._is_new:
            return None
        self._is_new = False
        return spread(self._delays)


class Flow:
    """The rates at which a topic's publishers publish and one subscription receives.

    Both rates come from the numbers and stamps of received messages, from the oldest to the newest. So they
    cover the same time, and their difference is the rate of lost messages.
    """

    def __init__(self) -> None:
        self.received = 0
        self._began_ns = self._ended_ns = 0
        self._oldest: dict[bytes, int] = {}
        self._newest: dict[bytes, int] = {}

    def add(self, publisher: bytes, number: int, stamp_ns: int) -> None:
        """Count a message: the gid of its publisher, its number there, and the time of publishing."""
        if not self.received:
            self._began_ns = self._ended_ns = stamp_ns
        self.received += 1
        if stamp_ns > self._ended_ns:
            self._ended_ns = stamp_ns
        elif stamp_ns < self._began_ns:
            self._began_ns = stamp_ns
        if number > self._newest.setdefault(publisher, number):
            self._newest[publisher] = number
        elif number < self._oldest.setdefault(publisher, number):
            self._oldest[publisher] = number

    @property
    def published(self) -> int:
        """Number of messages that each publisher sent from its first to its last received one, added up."""
        return sum(newest - self._oldest[one] + 1 for one, newest in self._newest.items())

    def rates(self) -> tuple[float, float] | None:
        """Published and received messages per second; None before two different stamps are known."""
        span_ns = self._ended_ns - self._began_ns
        if not span_ns:
            return None
        return (self.published - 1) * _NS_PER_S / span_ns, (self.received - 1) * _NS_PER_S / span_ns
