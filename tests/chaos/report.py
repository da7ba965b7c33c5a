"""The totals of a run, in figures."""

from collections import Counter
from dataclasses import dataclass, field


@dataclass
class Tally:
    """Totals over the run. For killed actors, their reports at the last quiet moment."""

    seed: int
    deeds: Counter[str] = field(default_factory=Counter)
    storms: int = 0
    actors: int = 0
    cuts: int = 0
    farewells: int = 0
    published: int = 0
    delivered: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    suffered: Counter[str] = field(default_factory=Counter)
    checks: Counter[str] = field(default_factory=Counter)
    graph_s: list[float] = field(default_factory=list)

    def lines(self) -> list[str]:
        times = sorted(self.graph_s) or [0.0]
        return [
            f"seed {self.seed}: {self.storms} storms, {self.actors} actors",
            f"messages: {self.published:,} published, {self.delivered:,} delivered and looked at",
            f"dropped: {_counts(self.dropped)}",
            f"deeds: {_counts(self.deeds)}; {self.cuts} connections cut after a random byte",
            f"subscriptions' processes that slept while a publisher left in order: {self.farewells}",
            f"failed for want of descriptors or memory: {_counts(self.suffered)}",
            f"held: {_counts(self.checks)}",
            f"graph true after a storm: {times[len(times) // 2]:.2f} s median, {times[-1]:.2f} s at most",
        ]


def _counts(counts: Counter[str]) -> str:
    return ", ".join(f"{count:,} {what}" for what, count in counts.most_common()) or "nothing"
