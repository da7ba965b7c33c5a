"""`did you mean ...?` for misspelt names. Knows names only as texts.

Slow to import, and only needed after mistakes: import it late.
"""

import re
from collections.abc import Iterable
from difflib import get_close_matches

__all__ = ["did_you_mean", "nearest"]

_CANDIDATES = 5
_PARTS = re.compile(r"[/._-]")


def nearest(name: str, among: Iterable[str], cutoff: float = 0.6) -> str | None:
    """The name most like `name`; None if no name is near enough.

    `cutoff` (0 any, 1 the same) is for the names as a whole. Their parts, between slashes, dots and
    underscores, must be near too: long names that share most parts are alike, and mean different things.
    """
    found = get_close_matches(name, list(among), _CANDIDATES, cutoff)
    return next((one for one in found if _is_near(name, one)), None)


def did_you_mean(name: str, among: Iterable[str], cutoff: float = 0.6) -> str:
    """The end of an error's text: `; did you mean 'talker'?`, or nothing."""
    near = nearest(name, among, cutoff)
    return f"; did you mean '{near}'?" if near else ""


def _is_near(name: str, other: str) -> bool:
    """Whether each part equals the other's or is a slip of it; or one name has all parts of the other in a
    row."""
    ours, theirs = (_PARTS.split(one.casefold()) for one in (name, other))
    if len(ours) == len(theirs):
        return all(map(_is_slip, ours, theirs))
    short, long = sorted((ours, theirs), key=len)
    short = [one for one in short if one]
    places = range(len(long) - len(short) + 1)
    if any(all(map(_is_slip, short, long[at : at + len(short)])) for at in places):
        return True
    return _is_slip("".join(ours), "".join(theirs))


def _is_slip(one: str, other: str) -> bool:
    """Whether at most a third of the letters (one is always allowed) are changed, left out, added or
    swapped."""
    most = max(1, max(len(one), len(other)) // 3)
    return abs(len(one) - len(other)) <= most and _distance(one, other) <= most


def _distance(one: str, other: str) -> int:
    """The distance of Damerau and Levenshtein, with swaps of neighbours."""
    before: list[int] = []
    row = list(range(len(other) + 1))
    for i, letter in enumerate(one, 1):
        before, above, row = row, before, [i]
        for j, wanted in enumerate(other, 1):
            steps = min(before[j] + 1, row[-1] + 1, before[j - 1] + (letter != wanted))
            if i > 1 and j > 1 and letter == other[j - 2] and one[i - 2] == wanted:
                steps = min(steps, above[j - 2] + 1)
            row.append(steps)
    return row[-1]
