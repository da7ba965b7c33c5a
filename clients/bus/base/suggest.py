"""`did you mean ...?` for misspelt names. Knows names as texts only.

Slow to import, and needed for mistakes only: import it late.
"""

from collections.abc import Iterable
from difflib import get_close_matches

__all__ = ["did_you_mean", "nearest"]


def nearest(name: str, among: Iterable[str], cutoff: float = 0.6) -> str | None:
    """The name most like `name`; None where none is as like as `cutoff` (0 any, 1 the same) asks."""
    near = get_close_matches(name, list(among), 1, cutoff)
    return near[0] if near else None


def did_you_mean(name: str, among: Iterable[str], cutoff: float = 0.6) -> str:
    """The end of an error's text: `; did you mean 'talker'?`, or nothing."""
    near = nearest(name, among, cutoff)
    return f"; did you mean '{near}'?" if near else ""
