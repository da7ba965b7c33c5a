"""The work of a periodic timer for all libraries, and the times of its calls. Must not know any library."""

from time import monotonic_ns, process_time
from typing import Any, Literal

import msgspec

_WARM_UP_NS = 300_000_000


class Ticks(msgspec.Struct, frozen=True):
    """A timer with `rate` calls a second, watched for `seconds`. `loop`: for programs of asyncio."""

    rate: float
    seconds: float
    way: Literal["", "bus", "call_later"] = ""
    loop: Literal["", "asyncio", "uvloop"] = ""

    @property
    def period_ns(self) -> int:
        """Nanoseconds from one call to the next."""
        return round(1e9 / self.rate)


class Calls(msgspec.Struct, frozen=True):
    """The calls came at `at_ns` of the monotonic clock; the first was due at `due_ns`, and one each period
    after it.

    `cpu_s`: CPU time of the whole process from the first call to the last.
    """

    due_ns: int
    at_ns: list[int]
    cpu_s: float


class Watch:
    """Records the calls of a timer whose first call is due at `due_ns` of the monotonic clock."""

    def __init__(self, ticks: Ticks, due_ns: int) -> None:
        self._due_ns = due_ns
        self._begin_ns = due_ns + _WARM_UP_NS
        self._end_ns = self._begin_ns + round(ticks.seconds * 1e9)
        self._at_ns: list[int] = []
        self._begin_s = 0.0

    def note(self) -> bool:
        """Record a call. Returns whether it is the last call that counts."""
        now_ns = monotonic_ns()
        if now_ns < self._begin_ns:
            return False
        if not self._at_ns:
            self._begin_s = process_time()
        self._at_ns.append(now_ns)
        return now_ns >= self._end_ns

    def calls(self) -> dict[str, Any]:
        """The fields of `Calls`, after the last call."""
        return {"due_ns": self._due_ns, "at_ns": self._at_ns, "cpu_s": process_time() - self._begin_s}
