"""Walks a table of transitions for tests: the events that lead to a state."""

from collections import deque
from collections.abc import Mapping
from typing import TypeVar

_State = TypeVar("_State")
_Event = TypeVar("_Event")


def paths(transitions: Mapping[_State, Mapping[_Event, _State]], first: _State) -> dict[_State, list[_Event]]:
    """For each state that can be reached from `first`, the events of a shortest path."""
    found: dict[_State, list[_Event]] = {first: []}
    waiting = deque([first])
    while waiting:
        state = waiting.popleft()
        for event, following in transitions[state].items():
            if following not in found:
                found[following] = [*found[state], event]
                waiting.append(following)
    return found
