"""The life of a recorder or player as a table: states, events, and the next state for each. Pure."""

from collections.abc import Mapping
from enum import Enum
from typing import Generic, TypeVar

__all__ = ["Life", "LifeError"]

S = TypeVar("S", bound=Enum)
E = TypeVar("E", bound=Enum)


class LifeError(Exception):
    """An event that is not possible in the current state: a bug."""


class Life(Generic[S, E]):
    """The state of one object, beginning with `first`. Only `on` changes it.

    `transitions`: the next state, by state and event. An event that is missing must not happen.
    """

    __slots__ = ("_transitions", "state")

    def __init__(self, transitions: Mapping[S, Mapping[E, S]], first: S) -> None:
        self._transitions = transitions
        self.state = first

    def on(self, event: E) -> S:
        """Handle `event`; returns the next state. Raises LifeError if it is not possible."""
        following = self._transitions[self.state].get(event)
        if following is None:
            kind = type(self.state).__name__
            raise LifeError(f"{kind}: {event.value!r} can't happen in the state {self.state.value!r}")
        self.state = following
        return following
