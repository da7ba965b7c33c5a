"""Comparisons of our systems with others, or with the best of them. Knows cases by names and outcomes."""

from collections.abc import Iterable, Mapping

from benchmarks.cases import Outcome
from benchmarks.figures import best, ratios
from benchmarks.report import Comparison, compare


def against(
    outcomes: Mapping[str, Outcome],
    ours: str,
    theirs: str,
    key: str,
    *,
    at_most: float | None = None,
    at_least: float | None = None,
    what: str = "",
    label: str = "",
) -> list[Comparison]:
    """The ratio of `key` of the case `ours` to `theirs`; empty if one of them has no figure.

    `what`: the figure in words, if the key is not clear. `label`: the name of the other one; by default its
    series.
    """
    if ours not in outcomes or theirs not in outcomes:
        return []
    values = ratios(outcomes[ours].repetitions, outcomes[theirs].repetitions, key)
    name = f"{ours} / {label or outcomes[theirs].series or theirs}, {what or key}"
    return compare(name, values, at_most=at_most, at_least=at_least)


def against_best(
    outcomes: Mapping[str, Outcome],
    ours: str,
    theirs: Iterable[str],
    key: str,
    *,
    at_most: float | None = None,
    at_least: float | None = None,
    what: str = "",
) -> list[Comparison]:
    """`against` the best of `theirs`; the comparison's name contains the name of the best.

    The best has the least median if the goal is an `at_most`, otherwise the greatest. Missing and failed
    cases, and cases with `lost` messages, don't take part. So there may be nothing to compare.
    """
    others = [outcomes[name] for name in theirs if name in outcomes]
    whole = {
        other.name: other.repetitions
        for other in others
        if not other.failure and not any(one.get("lost") for one in other.repetitions)
    }
    found = best(whole, key, is_least=at_least is None)
    if not found:
        return []
    label = f"best rival ({outcomes[found].series or found})"
    return against(outcomes, ours, found, key, at_most=at_most, at_least=at_least, what=what, label=label)
