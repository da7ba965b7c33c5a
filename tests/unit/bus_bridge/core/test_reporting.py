"""Reports to the graph about mirrors, a few at a time."""

from types import SimpleNamespace
from typing import Any

from bus_bridge.core.reporting import Reporting


class Mirror:
    """A mirror of a far publisher. Its way in has lost some messages."""

    def __init__(self, losses: dict[str, int]) -> None:
        self.subscription = self.route = None
        self.way = SimpleNamespace(losses=losses, waiting=0)
        self.publisher = self
        self.told: list[dict[str, int]] = []

    def report_besides(self, *, dropped: dict[str, int]) -> None:
        self.told.append(dropped)


def test_losses_are_told_when_they_change_and_to_each_mirror() -> None:
    mirrors: list[Any] = [Mirror({})]
    reporting = Reporting([], mirrors)  # type: ignore[arg-type]
    (first,) = mirrors
    for lost in (0, 3, 3, 4):
        first.way.losses = {"lost_on_the_way": lost} if lost else {}
        reporting.report(1.0)
    assert first.told == [{"lost_on_the_way": 3}, {"lost_on_the_way": 4}]
    mirrors[:] = [Mirror(first.way.losses)]  # the mirror is made again between two looks
    reporting.report(2.0)
    assert mirrors[0].told == [{"lost_on_the_way": 4}]
