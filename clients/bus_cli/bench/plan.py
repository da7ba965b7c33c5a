"""The measurements to make, as the command line asks for them. Knows no processes."""

import msgspec

from bus.qos import QoSProfile
from bus_cli.bench.task import Go

__all__ = ["Plan"]


class Plan(msgspec.Struct, frozen=True, kw_only=True):
    """Measure each of `sizes` at each of `paces` (messages/s; 0: at full speed)."""

    verb: str
    type_name: str
    sizes: tuple[int, ...]
    paces: tuple[float, ...]
    count: int
    """Number of messages of each publisher; 0: as many as possible in `seconds`."""
    seconds: float
    warm_up_s: float
    publishers: int
    subscribers: int
    route: str | None
    qos: QoSProfile

    def warm_up(self, pace: float) -> Go | None:
        """The Go of the warm-up, which does not count; None without a warm-up."""
        return _go(0, self.warm_up_s, pace) if self.warm_up_s else None

    def measured(self, pace: float) -> Go:
        """The Go of the measurement."""
        return _go(self.count, self.seconds, pace)


def _go(count: int, seconds: float, pace: float) -> Go:
    if pace and not count:
        count = max(1, round(pace * seconds))
    return Go(count=count, seconds=seconds)
