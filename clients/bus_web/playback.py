"""The playback of a recording, as the page and viewers see and control it. Pure.

This module only has the words between a session and a player: states and requests. The player is above
(`bus_bag.page`), and makes all decisions.
"""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from enum import Enum
from typing import NamedTuple, Protocol

import msgspec

from bus_plot.loss_timeline import LossTimeline

__all__ = ["Losses", "Playback", "Recording", "Request", "State", "Status"]


class Status(Enum):
    """The activity of the player."""

    PLAYING = "playing"
    PAUSED = "paused"
    READING = "reading"
    """It reads the messages from its present position on."""
    AT_END = "at end"


class State(NamedTuple):
    """The player now."""

    status: Status
    is_paused: bool
    """It can be paused and read at the same time."""
    at_ns: int
    """The position: a time of the recording's clock."""
    rate: float
    messages: int
    """Messages published so far."""
    seeks: int
    """Seeks so far. After one, the position is new, and messages from there follow."""


class Request(msgspec.Struct, frozen=True, kw_only=True):
    """The wishes of a client; None: no wish. In this order: the rate, a pause or its end, the seek, the step.

    With a rate that is not valid, nothing is done. The end of a pause at the recording's end is a seek to its
    start, too.
    """

    seek_ns: int | None = None
    rate: float | None = None
    is_paused: bool | None = None
    step: bool = False
    """Publish the next message; only while paused."""


class Losses(NamedTuple):
    """Messages of a topic that the recorder lost."""

    lost: int
    expected: int
    """Lost and recorded messages."""
    timeline: LossTimeline


class Recording(NamedTuple):
    """What does not change while it is played. Times are nanoseconds of its clock."""

    name: str
    start_ns: int
    end_ns: int
    losses: Mapping[str, Losses] | None
    """The topics that lost messages; None if the recorder did not count."""
    fault: str = ""
    """The reason why the recorder's counts can't be read."""


class Playback(Protocol):
    """A player and its recording."""

    @property
    def recording(self) -> Recording: ...

    @property
    def state(self) -> State: ...

    async def ask(self, request: Request, jumped: Callable[[], None] | None = None) -> str:
        """Pass a request on to the player; returns its refusal, or an empty text.

        Requests are done in the order of their calls. `jumped` is called when the position is the one sought,
        before messages from there; the rate and the pause are the new ones, too.
        """

    def watching(self, changed: Callable[[], None]) -> AbstractContextManager[None]:
        """In the block, `changed` is called after each seek, and ten times a second after other changes."""
