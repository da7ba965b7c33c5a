"""Which messages of several queues belong together, by their stamps in nanoseconds.

A queue has what waits, by its stamp, in the order of arrival. Pure: no messages, no clock, no threads.
"""

from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["bound", "drop_older", "match_approximately", "match_exactly"]

Queues = Sequence[dict[int, Any]]


def bound(queue: dict[int, Any], limit: int) -> None:
    """Forget the oldest by stamp, until no more than `limit` wait."""
    while len(queue) > limit:
        del queue[min(queue)]


def drop_older(queues: Queues, stamp: int) -> None:
    """Forget all that is older than `stamp`."""
    for queue in queues:
        for older in [one for one in queue if one < stamp]:
            del queue[older]


def match_exactly(queues: Queues, stamp: int) -> bool:
    """Whether each queue has a message with the stamp of the one that has just come.

    Others need no look: what was complete left when its last message came.
    """
    return all(stamp in queue for queue in queues)


def match_approximately(queues: Queues, index: int, stamp: int, slop: int) -> tuple[int, ...] | None:
    """The stamps, one of each queue, of the set that the message `stamp` completes; None: not yet.

    It has just come into queue `index`. A set matches if its newest and its oldest are less than `slop`
    apart. Of several the one counts whose message in the first queue is nearest to `stamp`; of those, the
    one that is nearest in the second queue, and so on. Of two equally near, the one that came first.
    """
    if stamp not in queues[index]:
        return None  # the queue was full, and this message the oldest
    candidates = [
        [stamp] if place == index else _by_distance(queue, stamp, slop) for place, queue in enumerate(queues)
    ]
    return _complete(candidates, 0, (stamp, stamp), slop, set()) if all(candidates) else None


def _by_distance(queue: Mapping[int, Any], stamp: int, slop: int) -> list[int]:
    near = [one for one in queue if abs(one - stamp) <= slop]
    return sorted(near, key=lambda one: abs(one - stamp))


def _complete(
    candidates: list[list[int]],
    place: int,
    span: tuple[int, int],
    slop: int,
    dead: set[tuple[int, tuple[int, int]]],
) -> tuple[int, ...] | None:
    """The first choice from `place` on whose stamps, with those from `span[0]` to `span[1]`, match.

    `dead` remembers from where there is none, which keeps the search short however many messages wait.
    """
    if place == len(candidates):
        return ()
    for one in candidates[place]:
        oldest, newest = wider = min(span[0], one), max(span[1], one)
        if newest - oldest >= slop or (place, wider) in dead:
            continue
        rest = _complete(candidates, place + 1, wider, slop, dead)
        if rest is not None:
            return (one, *rest)
        dead.add((place, wider))
    return None
