"""The native core in Python: used if the native core was not built, and tests compare the two.

Owns: frames, their motion, and the walk from one frame to another, as in ROS 2's tf2. A static frame has one
transform for all times. Any other frame has the transforms of the last seconds; times in between are
interpolated. A frame may change its parent. Must not know: messages, texts, ROS.
"""

import math
from bisect import bisect_right
from operator import attrgetter
from threading import Lock
from typing import Final, NamedTuple

from bus_tf2.core.rotation import (
    IDENTITY,
    Quaternion,
    Transform,
    Vector,
    dot,
    inverted,
    multiply,
    normal,
    rotate,
    slerp,
)

__all__ = ["FrameTree"]

MAX_DEPTH: Final = 1000
"""A longer path counts as a loop."""
MAX_SAMPLES: Final = 100_000
"""Limit of samples for one frame; the oldest are dropped first."""

# Reasons to refuse a transform: a set of bits.
IS_NAN, IS_DENORMALIZED, IS_OLD = 1, 2, 4
# Reasons why a look-up has no answer.
UNKNOWN, LOOP, UNCONNECTED, NO_DATA, ONE_VALUE, FUTURE, PAST = range(1, 8)

_SMALLEST: Final = 2.2250738585072014e-308
_NO_TIME: Final = (1 << 63) - 1
_stamp = attrgetter("stamp_ns")

Answer = tuple[int, float, float, float, float, float, float, float]
Failure = tuple[int, int, int]
"""The reason; for missing data also the requested time and the nearest available time."""


class _Sample(NamedTuple):
    stamp_ns: int
    parent: int
    translation: Vector
    rotation: Quaternion


class _Frame:
    """A frame's history. `samples` are sorted by time; of equal times, the newer sample comes later."""

    __slots__ = ("authority", "is_child", "is_static", "name", "samples")

    def __init__(self, name: str) -> None:
        self.name = name
        self.authority: str | None = None
        self.samples: list[_Sample] = []
        self.is_child = False
        """Its place was set at least once: it has a history, which may be empty."""
        self.is_static = False

    def latest_ns(self) -> int:
        return 0 if self.is_static or not self.samples else self.samples[-1].stamp_ns

    def newest_parent(self) -> int | None:
        return self.samples[-1].parent if self.samples else None

    def keep(self, new: _Sample, cache_ns: int) -> int:
        samples = self.samples
        if self.is_static:
            samples.clear()
        if samples:
            horizon_ns = samples[-1].stamp_ns - cache_ns
            old = 0
            while samples[old].stamp_ns < horizon_ns:
                old += 1
            del samples[:old]
            if new.stamp_ns < horizon_ns:
                return IS_OLD
        at = bisect_right(samples, new.stamp_ns, key=_stamp)
        before = at
        while before and samples[before - 1].stamp_ns == new.stamp_ns:
            before -= 1
            if samples[before] == new:
                return 0
        if len(samples) == MAX_SAMPLES:
            if not at:
                return 0
            del samples[0]
            at -= 1
        samples.insert(at, new)
        return 0

    def at(self, time_ns: int) -> _Sample | Failure:
        samples = self.samples
        if not samples:
            return NO_DATA, time_ns, 0
        oldest, newest = samples[0], samples[-1]
        if self.is_static or time_ns in (0, newest.stamp_ns):
            return newest
        if len(samples) == 1:
            return ONE_VALUE, time_ns, newest.stamp_ns
        if time_ns == oldest.stamp_ns:
            return oldest
        if time_ns > newest.stamp_ns:
            return FUTURE, time_ns, newest.stamp_ns
        if time_ns < oldest.stamp_ns:
            return PAST, time_ns, oldest.stamp_ns
        after_at = bisect_right(samples, time_ns, key=_stamp)
        before, after = samples[after_at - 1], samples[after_at]
        if before.parent != after.parent:
            return before
        ratio = (time_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
        (x, y, z), (to_x, to_y, to_z), rest = before.translation, after.translation, 1.0 - ratio
        translation = (rest * x + ratio * to_x, rest * y + ratio * to_y, rest * z + ratio * to_z)
        rotation = slerp(before.rotation, after.rotation, ratio)
        return _Sample(before.stamp_ns, before.parent, translation, rotation)


class FrameTree:
    """Frames, each at a place in its parent's coordinates. Times are nanoseconds.

    Thread-safe: each call is one whole operation.
    """

    def __init__(self, cache_ns: int) -> None:
        if cache_ns < 0:
            raise ValueError("cache_ns is below zero")
        self._cache_ns = cache_ns
        self._frames: list[_Frame] = []
        self._numbers: dict[str, int] = {}
        self._lock = Lock()

    def insert(  # noqa: PLR0913
        self,
        child: str,
        parent: str,
        stamp_ns: int,
        x: float,
        y: float,
        z: float,
        qx: float,
        qy: float,
        qz: float,
        qw: float,
        authority: str,
        is_static: bool,
        /,
    ) -> int:
        """Take a transform in, of `child` in `parent`. Returns 0, or the bits of the reasons why it is
        refused.
        """
        length = dot((qx, qy, qz, qw), (qx, qy, qz, qw))
        refused = IS_NAN if any(map(math.isnan, (x, y, z, length))) else 0
        if not (length >= _SMALLEST and math.isfinite(length)):
            refused |= IS_DENORMALIZED
        if refused:
            return refused
        rotation = normal((qx, qy, qz, qw))
        with self._lock:
            frame = self._frames[self._number_or_new(child)]
            new = _Sample(stamp_ns, self._number_or_new(parent), (x, y, z), rotation)
            if frame.is_static is not is_static:
                frame.samples.clear()
                frame.is_static = is_static
            frame.is_child = True
            status = frame.keep(new, self._cache_ns)
            if not status:
                frame.authority = authority
            return status

    def lookup(self, target: str, source: str, time_ns: int, /) -> Answer | Failure:
        """The transform that takes coordinates in `source` into `target`. `time_ns`: 0 for the latest common.

        Returns its time, the translation's x, y, z and the rotation's x, y, z, w; or a failure.
        """
        with self._lock:
            to, of = self._numbers.get(target), self._numbers.get(source)
            if target == source:
                latest_ns = 0 if to is None else self._frames[to].latest_ns()
                return (time_ns or latest_ns, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
            if to is None or of is None:
                return UNKNOWN, 0, 0
            if not time_ns:
                common = self._common_ns(to, of)
                if not isinstance(common, int):
                    return common
                time_ns = common
            found = self._walk(to, of, time_ns)
        if len(found) == 3:
            return found
        translation, rotation = found
        return (time_ns, *translation, *normal(rotation))

    def latest(self, target: str, source: str, /) -> int | Failure:
        """The latest time at which all transforms between the two are known; 0 if all of them are static."""
        with self._lock:
            to, of = self._numbers.get(target), self._numbers.get(source)
            if to is None or of is None:
                return UNKNOWN, 0, 0
            return self._frames[to].latest_ns() if to == of else self._common_ns(to, of)

    def parent(self, name: str, time_ns: int, /) -> str | None:
        """A frame's parent at a time; None if it is not known."""
        with self._lock:
            number = self._numbers.get(name)
            found = None if number is None else self._frames[number].at(time_ns)
            return self._frames[found.parent].name if isinstance(found, _Sample) else None

    def rows(self) -> list[tuple[str, str | None, str | None, int, int, int]]:
        """For each frame that has or had a parent: its name, the parent's name, the authority of the last
        transform, the number of transforms kept, the latest time and the oldest."""
        with self._lock:
            return [
                (
                    frame.name,
                    self._frames[frame.samples[-1].parent].name if frame.samples else None,
                    frame.authority,
                    len(frame.samples),
                    frame.latest_ns(),
                    0 if frame.is_static or not frame.samples else frame.samples[0].stamp_ns,
                )
                for frame in self._frames
                if frame.is_child
            ]

    def names(self) -> list[str]:
        """All frames, in the order in which they became known."""
        with self._lock:
            return [frame.name for frame in self._frames]

    def knows(self, name: str, /) -> bool:
        return name in self._numbers

    def clear(self) -> None:
        """Forget all transforms except static ones; the frames stay known."""
        with self._lock:
            for frame in self._frames:
                if not frame.is_static:
                    frame.samples.clear()

    def _number_or_new(self, name: str) -> int:
        number = self._numbers.setdefault(name, len(self._frames))
        if number == len(self._frames):
            self._frames.append(_Frame(name))
        return number

    def _common_ns(self, target: int, source: int) -> int | Failure:
        way: list[tuple[int, int]] = []  # up from the source: time and parent of each step
        common_ns = _NO_TIME
        at = source
        while (up := self._frames[at].newest_parent()) is not None:
            way.append((self._frames[at].latest_ns(), up))
            common_ns = _earlier(common_ns, way[-1][0])
            if up == target:
                return 0 if common_ns == _NO_TIME else common_ns
            if len(way) > MAX_DEPTH:
                return LOOP, 0, 0
            at = up
        ancestors = [number for _, number in way]
        common_ns, at, depth = _NO_TIME, target, 0
        while (up := self._frames[at].newest_parent()) is not None:
            common_ns = _earlier(common_ns, self._frames[at].latest_ns())
            if up == source:
                return 0 if common_ns == _NO_TIME else common_ns
            if up in ancestors:
                for stamp_ns, _ in way[: ancestors.index(up) + 1]:
                    common_ns = _earlier(common_ns, stamp_ns)
                return 0 if common_ns == _NO_TIME else common_ns
            depth += 1
            if depth > MAX_DEPTH:
                return LOOP, 0, 0
            at = up
        return UNCONNECTED, 0, 0

    def _walk(self, target: int, source: int, time_ns: int) -> Transform | Failure:
        from_source = from_target = IDENTITY
        missing: Failure | None = None
        at = source
        for _ in range(MAX_DEPTH + 1):
            frame = self._frames[at]
            if at == target or not frame.is_child:
                break
            step = frame.at(time_ns)
            if not isinstance(step, _Sample):
                missing = step
                break
            from_source = _climb(from_source, step)
            at = step.parent
        else:
            return LOOP, 0, 0
        top, at = at, target
        for _ in range(MAX_DEPTH + 1):
            frame = self._frames[at]
            if at in (top, source) or not frame.is_child:
                break
            step = frame.at(time_ns)
            if not isinstance(step, _Sample):
                return step
            from_target = _climb(from_target, step)
            at = step.parent
        else:
            return LOOP, 0, 0
        (x, y, z), back = inverted(from_target)
        if at == top:
            turned_x, turned_y, turned_z = rotate(back, from_source[0])
            return (turned_x + x, turned_y + y, turned_z + z), multiply(back, from_source[1])
        if at == source:  # the source is above the target: the first walk's result is not needed
            return (x, y, z), back
        return missing or (UNCONNECTED, 0, 0)


def _earlier(common_ns: int, stamp_ns: int) -> int:
    return stamp_ns if stamp_ns and stamp_ns < common_ns else common_ns


def _climb(to: Transform, step: _Sample) -> Transform:
    (x, y, z), (by_x, by_y, by_z) = rotate(step.rotation, to[0]), step.translation
    return (x + by_x, y + by_y, z + by_z), multiply(step.rotation, to[1])
