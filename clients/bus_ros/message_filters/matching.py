"""Selects the messages of several queues that belong together, by their stamps in nanoseconds.

A queue has waiting entries by stamp, in order of arrival. Pure: no messages, no clock, no threads.
"""

from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["bound", "match_approximately", "match_exactly"]

Queues = Sequence[dict[int, Any]]


def bound(queue: dict[int, Any], limit: int) -> None:
    """Drop the oldest by stamp, until at most `limit` wait."""
    while len(queue) > limit:
        del queue[min(queue)]


def match_exactly(queues: Queues, stamp: int) -> bool:
    """Whether each queue has a message with the stamp of the newly arrived one.

    Other stamps need no check: a complete set left when its last message arrived.
    """
    return all(stamp in queue for queue in queues)


def match_approximately(queues: Queues, index: int, stamp: int, slop: int) -> tuple[int, ...] | None:
    """The stamps of the set that the message `stamp` completes, one of each queue; None: none yet.

    The message has just arrived in queue `index`. A set matches if its newest and its oldest are less than
    `slop` apart. Among several sets, the stamp in the first queue decides: the nearest to `stamp` counts. If
    these are equal, the stamp in the second queue decides, and so on. If two stamps are equally near, the
    first to arrive counts.
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
    """The first choice of stamps from `place` on that match together with `span[0]` to `span[1]`.

    `dead` remembers places and spans without a match. It keeps the search short, however many messages wait.
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
