"""The life of a recorder or player as a table: states, events, and which state follows. Pure."""

from collections.abc import Mapping
from enum import Enum
from typing import Generic, TypeVar

__all__ = ["Life", "LifeError"]

S = TypeVar("S", bound=Enum)
E = TypeVar("E", bound=Enum)


class LifeError(Exception):
    """Something happened that can't happen in this state: a bug."""


class Life(Generic[S, E]):
    """The state of one thing, which is first in the state `first`. Nothing but `on` changes it.

    `transitions`: what follows, by state and event; what is not in it must not happen.
    """

    __slots__ = ("_transitions", "state")

    def __init__(self, transitions: Mapping[S, Mapping[E, S]], first: S) -> None:
        self._transitions = transitions
        self.state = first

    def on(self, event: E) -> S:
        """`event` happens; returns the state that follows. Raises LifeError if it can't happen."""
        following = self._transitions[self.state].get(event)
        if following is None:
            kind = type(self.state).__name__
            raise LifeError(f"{kind}: {event.value!r} can't happen in the state {self.state.value!r}")
        self.state = following
        return following
