"""Repetitions of cases for comparison, in turns, and their results."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from benchmarks.figures import Spread
from benchmarks.harness import Failure

Figures = dict[str, float]


class Case(NamedTuple):
    """One row of a table. `measure` runs it once; `missing` is the reason if it can't run here.

    In a picture, it is the point of `series` (a system and a way to use it) at `at` on the section's axis.
    `rounds`: it is in the first repetitions only, up to that number; 0: in all.
    """

    name: str
    measure: Callable[[], Figures]
    missing: str = ""
    series: str = ""
    at: float = 0.0
    rounds: int = 0


@dataclass
class Outcome:
    """The figures of a case's repetitions. If one failed, its error; there are no more repetitions then."""

    name: str
    repetitions: list[Figures] = field(default_factory=list)
    failure: str = ""
    missing: str = ""
    series: str = ""
    at: float = 0.0

    def spreads(self) -> dict[str, Spread]:
        """Each figure, over the repetitions that have it."""
        keys = dict.fromkeys(key for one in self.repetitions for key in one)
        return {key: Spread.of(one[key] for one in self.repetitions if key in one) for key in keys}


def interleave(
    cases: Sequence[Case], repetitions: int, tell: Callable[[str], None] = lambda _: None
) -> dict[str, Outcome]:
    """Run all cases once, then once more from the last to the first, and so on.

    So other load on the machine affects all cases alike. A failed case is not repeated: a case that hangs
    would cost its time limit each time.
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
