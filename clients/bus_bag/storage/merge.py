"""Merges items from several places in the order of time. Pure.

A place (a chunk of a file, a file of a bag) is opened when its first time is reached. So only one place is in
memory if places don't overlap.
"""

from collections.abc import Callable, Iterable, Iterator
from heapq import heappop, heappush
from typing import Generic, NamedTuple, TypeVar

from bus_bag.storage.bag_file import BagMessage, Order

__all__ = ["Place", "merge", "timed"]

T = TypeVar("T")


class Place(NamedTuple, Generic[T]):
    """A source of items: its first time, and a function that returns its items in order, each with its
    time."""

    start: int
    open: Callable[[], Iterator[tuple[int, T]]]


def merge(places: Iterable[Place[T]]) -> Iterator[T]:
    """All items in the order of time. Items of the same time keep the order of their places, and the order
    within a place."""
    waiting = sorted(enumerate(places), key=lambda one: (one[1].start, one[0]), reverse=True)
    heads: list[tuple[int, int, T, Iterator[tuple[int, T]]]] = []

    def push(number: int, things: Iterator[tuple[int, T]]) -> None:
        for time, thing in things:
            heappush(heads, (time, number, thing, things))
            return

    while heads or waiting:
        while waiting and (not heads or waiting[-1][1].start <= heads[0][0]):
            number, place = waiting.pop()
            push(number, place.open())
        if not heads:
            continue
        _, number, thing, things = heappop(heads)
        yield thing
        if heads or waiting:
            push(number, things)
        else:
            for _, rest in things:
                yield rest


def timed(messages: Iterator[BagMessage], by: Order) -> Iterator[tuple[int, BagMessage]]:
    """Messages with the time that `by` selects."""
    if by == "log_time":
        return ((message.log_time, message) for message in messages)
    return ((message.publish_time, message) for message in messages)
