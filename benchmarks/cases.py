"""Repetitions of what is to be compared, in turns, and what came of each."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from benchmarks.figures import Spread
from benchmarks.harness import Failure

Figures = dict[str, float]


class Case(NamedTuple):
    """One line of a table: `measure` does it once; `missing` says why it can't be done here.

    In a picture it is the point of `series` (a system, and how it is used) at `at` of the section's axis.
    `rounds`: it takes part in the first so many repetitions only; 0: in all.
    """

    name: str
    measure: Callable[[], Figures]
    missing: str = ""
    series: str = ""
    at: float = 0.0
    rounds: int = 0


@dataclass
class Outcome:
    """What the repetitions of a case gave, and why there are no more of them where it failed."""

    name: str
    repetitions: list[Figures] = field(default_factory=list)
    failure: str = ""
    missing: str = ""
    series: str = ""
    at: float = 0.0

    def spreads(self) -> dict[str, Spread]:
        """Each figure over the repetitions that have it."""
        keys = dict.fromkeys(key for one in self.repetitions for key in one)
        return {key: Spread.of(one[key] for one in self.repetitions if key in one) for key in keys}


def interleave(
    cases: Sequence[Case], repetitions: int, tell: Callable[[str], None] = lambda _: None
) -> dict[str, Outcome]:
    """All cases once, then all once more from the last to the first, and so on.

    So what the machine does meanwhile falls on all of them alike. A case that failed is not tried again: one
    that hangs would cost its time limit each time.
    """
    outcomes = {
        case.name: Outcome(case.name, missing=case.missing, series=case.series, at=case.at) for case in cases
    }
    for number in range(repetitions):
        for case in cases if number % 2 == 0 else cases[::-1]:
            outcome = outcomes[case.name]
            if outcome.failure or outcome.missing or number >= (case.rounds or repetitions):
                continue
            tell(f"{number + 1} of {repetitions}: {case.name}")
            try:
                outcome.repetitions.append(case.measure())
            except Failure as error:
                outcome.failure = str(error)
    return outcomes
