"""The life of busd: its states, the events that may happen in each of them, and the state that follows.

Owns the table and nothing else. The actions at a change of state are in `busd.server.server`.
"""

from collections.abc import Mapping
from enum import Enum

__all__ = ["TRANSITIONS", "Life", "LifeError", "LifeEvent", "LifeState"]


class LifeState(Enum):
    """State of busd."""

    __hash__ = object.__hash__  # Enum's own is a call in Python

    SERVING = "serving"
    """Programs connect and are served."""
    STOPPING = "stopping"
    """busd no longer listens. Peers have some time to finish sending and to read waiting data."""
    HURRIED = "hurried"
    """The same, but this time is over: busd closes all connections."""
    RESTARTING = "restarting"
    """As STOPPING, but programs that connect wait for the next busd, which gets the listening socket."""
    STOPPED = "stopped"
    """All connections are closed, and the program ends."""
    HANDING_OVER = "handing over"
    """All connections are closed, and the next busd begins."""


class LifeEvent(Enum):
    """What happens to busd."""

    __hash__ = object.__hash__

    STOP = "stop"
    """A program asks for the end, or busd has been idle for too long."""
    RESTART = "restart"
    """A program asks for a restart."""
    INTERRUPT = "interrupt"
    """A signal asks for the end; the second one asks for it at once."""
    DRAIN = "drain"
    """The last connection is closed."""


TRANSITIONS: Mapping[LifeState, Mapping[LifeEvent, LifeState]] = {
    LifeState.SERVING: {
        LifeEvent.STOP: LifeState.STOPPING,
        LifeEvent.RESTART: LifeState.RESTARTING,
        LifeEvent.INTERRUPT: LifeState.STOPPING,
    },
    LifeState.STOPPING: {
        LifeEvent.STOP: LifeState.STOPPING,
        LifeEvent.RESTART: LifeState.STOPPING,
        LifeEvent.INTERRUPT: LifeState.HURRIED,
        LifeEvent.DRAIN: LifeState.STOPPED,
    },
    LifeState.HURRIED: {
        LifeEvent.STOP: LifeState.HURRIED,
        LifeEvent.RESTART: LifeState.HURRIED,
        LifeEvent.INTERRUPT: LifeState.HURRIED,
        LifeEvent.DRAIN: LifeState.STOPPED,
    },
    LifeState.RESTARTING: {
        LifeEvent.STOP: LifeState.STOPPING,
        LifeEvent.RESTART: LifeState.RESTARTING,
        LifeEvent.INTERRUPT: LifeState.STOPPING,
        LifeEvent.DRAIN: LifeState.HANDING_OVER,
    },
    LifeState.STOPPED: {
        LifeEvent.STOP: LifeState.STOPPED,
        LifeEvent.RESTART: LifeState.STOPPED,
        LifeEvent.INTERRUPT: LifeState.STOPPED,
    },
    LifeState.HANDING_OVER: {
        LifeEvent.STOP: LifeState.STOPPED,
        LifeEvent.RESTART: LifeState.HANDING_OVER,
        LifeEvent.INTERRUPT: LifeState.STOPPED,
    },
}
"""The next state, by state and event. An event that a state's row lacks must not happen there."""


class LifeError(Exception):
    """Something happened to busd that can't happen in its state: a bug of busd."""


class Life:
    """The life of one busd. Nothing but `on` changes the state."""

    __slots__ = ("state",)

    def __init__(self) -> None:
        self.state = LifeState.SERVING

    def on(self, event: LifeEvent) -> LifeState:
        """`event` happens; returns the state that follows. Raises LifeError if it can't happen now."""
        state = TRANSITIONS[self.state].get(event)
        if state is None:
            raise LifeError(f"busd is {self.state.value!r}: {event.value!r} can't happen to it")
        self.state = state
        return state

    @property
    def is_ending(self) -> bool:
        """Whether busd lets no process in any more."""
        return self.state is not LifeState.SERVING

    @property
    def is_restarting(self) -> bool:
        """Whether another busd is to take over the listening socket."""
        return self.state is LifeState.RESTARTING or self.state is LifeState.HANDING_OVER
