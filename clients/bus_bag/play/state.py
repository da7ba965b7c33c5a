"""The life of a replay as a table: its states, the events, and which state follows. Pure.

Whether the time of the bag stands still is no state here: it can be paused in each of them (`TimeLine`).
"""

from collections.abc import Mapping
from enum import Enum

from bus_bag.life import Life

__all__ = ["TRANSITIONS", "PlayerEvent", "PlayerLife", "PlayerState"]


class PlayerState(Enum):
    """Where a replay stands."""

    __hash__ = object.__hash__  # Enum's own is a call in Python

    NEW = "new"
    CANCELED = "canceled"
    """It was asked to end before it began: it will begin and end at once."""
    STARTING = "starting"
    """The first messages are read, and the state of latched topics is published."""
    PLAYING = "playing"
    """Messages are published when they are due, or by steps in a pause; also while a loop begins anew."""
    BURSTING = "bursting"
    """In a pause: messages are published at once."""
    STOPPING = "stopping"
    """It was asked to end: no further message is published."""
    ENDED = "ended"


class PlayerEvent(Enum):
    """What can happen to it."""

    __hash__ = object.__hash__

    PLAY = "play"
    READY = "ready"
    """The beginning of the bag is read, and the time runs from there."""
    BURST = "burst"
    BURST_END = "burst end"
    STOP = "stop"
    """Somebody asks it to end."""
    END = "end"
    """All was played, or it was stopped, or canceled, or the bag can't be read on."""


TRANSITIONS: Mapping[PlayerState, Mapping[PlayerEvent, PlayerState]] = {
    PlayerState.NEW: {
        PlayerEvent.PLAY: PlayerState.STARTING,
        PlayerEvent.STOP: PlayerState.CANCELED,
    },
    PlayerState.CANCELED: {
        PlayerEvent.PLAY: PlayerState.STOPPING,
        PlayerEvent.STOP: PlayerState.CANCELED,
    },
    PlayerState.STARTING: {
        PlayerEvent.READY: PlayerState.PLAYING,
        PlayerEvent.STOP: PlayerState.STOPPING,
        PlayerEvent.END: PlayerState.ENDED,
    },
    PlayerState.PLAYING: {
        PlayerEvent.READY: PlayerState.PLAYING,  # once more, in a loop
        PlayerEvent.BURST: PlayerState.BURSTING,
        PlayerEvent.STOP: PlayerState.STOPPING,
        PlayerEvent.END: PlayerState.ENDED,
    },
    PlayerState.BURSTING: {
        PlayerEvent.BURST_END: PlayerState.PLAYING,
        PlayerEvent.STOP: PlayerState.STOPPING,
        PlayerEvent.END: PlayerState.ENDED,
    },
    PlayerState.STOPPING: {
        PlayerEvent.READY: PlayerState.STOPPING,
        PlayerEvent.BURST: PlayerState.STOPPING,
        PlayerEvent.BURST_END: PlayerState.STOPPING,
        PlayerEvent.STOP: PlayerState.STOPPING,
        PlayerEvent.END: PlayerState.ENDED,
    },
    PlayerState.ENDED: {
        # A burst may have waited for the beginning, or goes on until its next message.
        PlayerEvent.BURST: PlayerState.ENDED,
        PlayerEvent.BURST_END: PlayerState.ENDED,
        PlayerEvent.STOP: PlayerState.ENDED,
    },
}
"""What follows, by state and event; what is not in it must not happen."""


class PlayerLife(Life[PlayerState, PlayerEvent]):
    """The state of one replay."""

    def __init__(self) -> None:
        super().__init__(TRANSITIONS, PlayerState.NEW)

    @property
    def has_begun(self) -> bool:
        """Whether `play` was called."""
        return self.state is not PlayerState.NEW and self.state is not PlayerState.CANCELED

    @property
    def may_publish(self) -> bool:
        """Whether messages are still to be published."""
        return self.state is not PlayerState.STOPPING and self.state is not PlayerState.ENDED
