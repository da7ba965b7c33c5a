"""The life of a replay as a table: its states, the events, and the next state for each. Pure.

A pause is not a state here, because each state can be paused (`TimeLine`).
"""

from collections.abc import Mapping
from enum import Enum

from bus_bag.life import Life

__all__ = ["TRANSITIONS", "PlayerEvent", "PlayerLife", "PlayerState"]


class PlayerState(Enum):
    """States of a replay."""

    __hash__ = object.__hash__  # the one of Enum is a Python function, which is slower

    NEW = "new"
    CANCELED = "canceled"
    """`stop` was called before the start: it will begin and end at once."""
    STARTING = "starting"
    """It reads the first messages, and publishes the state of latched topics."""
    PLAYING = "playing"
    """It publishes messages at their due times, or by steps in a pause; also while a loop begins again,
    or while it reads the messages from the target of a seek."""
    BURSTING = "bursting"
    """It publishes messages at once, in a pause."""
    AT_END = "at the end"
    """Every message is published, and it waits in a pause for a seek, a resume or `stop`."""
    STOPPING = "stopping"
    """`stop` was called: it publishes no further message."""
    ENDED = "ended"


class PlayerEvent(Enum):
    """Events that change the state."""

    __hash__ = object.__hash__

    PLAY = "play"
    READY = "ready"
    """The messages from the beginning, or from the target of a seek, are read; the time line runs there."""
    JUMP = "jump"
    """The time line is at the target of a seek; the messages from there are not read yet."""
    BURST = "burst"
    BURST_END = "burst end"
    LAST = "last"
    """No message is left, and the replay stays at its end."""
    STOP = "stop"
    """A key, service or signal asks for the end."""
    END = "end"
    """Everything was played, or it was stopped or canceled, or the bag became unreadable."""


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
        PlayerEvent.READY: PlayerState.PLAYING,  # again, in a loop or by a seek
        PlayerEvent.JUMP: PlayerState.PLAYING,
        PlayerEvent.BURST: PlayerState.BURSTING,
        PlayerEvent.LAST: PlayerState.AT_END,
        PlayerEvent.STOP: PlayerState.STOPPING,
        PlayerEvent.END: PlayerState.ENDED,
    },
    PlayerState.BURSTING: {
        PlayerEvent.BURST_END: PlayerState.PLAYING,
        PlayerEvent.STOP: PlayerState.STOPPING,
        PlayerEvent.END: PlayerState.ENDED,
    },
    PlayerState.AT_END: {
        PlayerEvent.JUMP: PlayerState.PLAYING,
        PlayerEvent.BURST: PlayerState.AT_END,  # of no messages
        PlayerEvent.BURST_END: PlayerState.AT_END,
        PlayerEvent.STOP: PlayerState.STOPPING,
        PlayerEvent.END: PlayerState.ENDED,
    },
    PlayerState.STOPPING: {
        PlayerEvent.READY: PlayerState.STOPPING,
        PlayerEvent.JUMP: PlayerState.STOPPING,
        PlayerEvent.BURST: PlayerState.STOPPING,
        PlayerEvent.BURST_END: PlayerState.STOPPING,
        PlayerEvent.STOP: PlayerState.STOPPING,
        PlayerEvent.END: PlayerState.ENDED,
    },
    PlayerState.ENDED: {
        # A burst may have waited for the beginning, or may continue until its next message.
        PlayerEvent.BURST: PlayerState.ENDED,
        PlayerEvent.BURST_END: PlayerState.ENDED,
        PlayerEvent.STOP: PlayerState.ENDED,
    },
}
"""The next state, by state and event. An event that is missing must not happen."""


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
        """Whether it may publish further messages."""
        return self.state is not PlayerState.STOPPING and self.state is not PlayerState.ENDED
