"""What is to be measured: no more than the command line says. Knows no processes."""

import msgspec

from bus.qos import QoSProfile
from bus_cli.bench.task import Go

__all__ = ["Plan"]


class Plan(msgspec.Struct, frozen=True, kw_only=True):
    """Each of `sizes` at each of `paces` (messages/s; 0: as fast as it goes)."""

    verb: str
    type_name: str
    sizes: tuple[int, ...]
    paces: tuple[float, ...]
    count: int
    """For each publisher; 0: as many as fit into `seconds`."""
    seconds: float
    warm_up_s: float
    publishers: int
    subscribers: int
    route: str | None
    qos: QoSProfile

    def warm_up(self, pace: float) -> Go | None:
        """What comes first and does not count; None without warm-up."""
        return _go(0, self.warm_up_s, pace) if self.warm_up_s else None

    def measured(self, pace: float) -> Go:
        """What counts."""
        return _go(self.count, self.seconds, pace)


def _go(count: int, seconds: float, pace: float) -> Go:
    if pace and not count:
        count = max(1, round(pace * seconds))
    return Go(count=count, seconds=seconds)
