"""Messages of several places in one order. Pure.

A place (a chunk of a file, a file of a bag) is opened when the order comes to where it begins, so that of
places that don't overlap only one is in memory.
"""

from collections.abc import Callable, Iterable, Iterator
from heapq import heappop, heappush
from typing import NamedTuple, TypeVar

from bus_bag.storage.values import BagMessage, Order

__all__ = ["Place", "merge"]

T = TypeVar("T")


class Place(NamedTuple):
    """Where messages are: from when on, and how to read them in order."""

    start: int
    open: Callable[[], Iterator[BagMessage]]


def merge(places: Iterable[Place], by: Order) -> Iterator[BagMessage]:
    """All messages by time; those of one time as their places stand, and within a place as they come."""
    waiting = sorted(enumerate(places), key=lambda one: (one[1].start, one[0]), reverse=True)
    heads: list[tuple[int, int, BagMessage, Iterator[BagMessage]]] = []
    is_by_log_time = by == "log_time"

    def push(number: int, messages: Iterator[BagMessage]) -> None:
        for message in messages:
            time = message.log_time if is_by_log_time else message.publish_time
            heappush(heads, (time, number, message, messages))
            return

    while heads or waiting:
        while waiting and (not heads or waiting[-1][1].start <= heads[0][0]):
            number, place = waiting.pop()
            push(number, place.open())
        if not heads:
            continue
        _, number, message, messages = heappop(heads)
        yield message
        if heads or waiting:
            push(number, messages)
        else:
            yield from messages
