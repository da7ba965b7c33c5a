"""A bag on the page of `bus web`: a player, and the requests of pages and viewers to it.

The player decides everything; this module translates. `storage` -> `play/program.py` -> `PlayerControl` ->
sessions of `bus_web`.
"""

import asyncio
from collections.abc import Callable, Coroutine, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bus.base.together import until_one_ends
from bus_bag import losses
from bus_bag.errors import BagError
from bus_bag.info import find_losses
from bus_bag.play.options import PlayOptions
from bus_bag.play.player import Player
from bus_bag.play.program import replay
from bus_bag.play.progress import Status as PlayerStatus
from bus_bag.play.time_line import TimeLine
from bus_bag.storage import JoinedBags
from bus_plot.loss_timeline import LossTimeline
from bus_web.playback import Losses, Playback, Recording, Request, State, Status

__all__ = ["PlayerControl", "play_on_page", "recorded_losses", "recording_of"]

_LOOK_S = 0.1
_STATUS = {
    PlayerStatus.RUNNING: Status.PLAYING,
    PlayerStatus.PAUSED: Status.PAUSED,
    PlayerStatus.BURST: Status.PLAYING,
    PlayerStatus.DELAYED: Status.READING,
    PlayerStatus.AT_END: Status.AT_END,
}


class PlayerControl(Playback):
    """Requests to a player, one after the other."""

    def __init__(self, player: Player, recording: Recording) -> None:
        self._player = player
        self._recording = recording
        self._asking = asyncio.Lock()
        self._watchers: dict[object, Callable[[], None]] = {}
        self._polling: asyncio.TimerHandle | None = None
        self._told: State | None = None
        self._jumped: Callable[[], None] | None = None
        """The callback of the present request."""
        player.on_seek = self._on_seek

    @property
    def recording(self) -> Recording:
        return self._recording

    @property
    def state(self) -> State:
        progress = self._player.progress
        at_ns = min(max(progress.bag_ns, self._recording.start_ns), self._recording.end_ns)
        return State(
            _STATUS[progress.status],
            self._player.is_paused,
            at_ns,
            progress.rate,
            progress.messages,
            self._player.seeks,
        )

    async def ask(self, request: Request, jumped: Callable[[], None] | None = None) -> str:
        async with self._asking:
            self._jumped = jumped
            try:
                return await self._ask(request)
            finally:
                self._jumped = None

    async def _ask(self, request: Request) -> str:
        player, seek_ns = self._player, request.seek_ns
        # The rate comes first: with one that is refused, the request changes nothing.
        if request.rate is not None and request.rate != player.rate and not player.set_rate(request.rate):
            return f"{request.rate:g} is not {TimeLine.RATES}"
        if request.is_paused and not player.is_paused:
            player.pause()
        if request.is_paused is False and player.is_paused:
            if seek_ns is None and self.state.status is Status.AT_END:
                seek_ns = self._recording.start_ns  # the player goes there; this waits for it
            player.resume()
        # The seek comes last, so that `jumped` finds the other wishes done. The player makes no step before
        # the `await`, so it does not play with them where it was.
        if seek_ns is not None and not await player.seek(seek_ns):
            return "the bag is no longer played"
        if request.step and not await player.play_next():
            return "no next message" if player.is_paused else "only a paused bag can be played by steps"
        return ""

    @contextmanager
    def watching(self, changed: Callable[[], None]) -> Iterator[None]:
        key = object()
        self._watchers[key] = changed
        if self._polling is None:
            self._look()
        try:
            yield
        finally:
            del self._watchers[key]
            if not self._watchers and self._polling is not None:
                self._polling.cancel()
                self._polling = None

    def _on_seek(self) -> None:
        if self._jumped is not None:
            self._jumped()
        self._tell()

    def _look(self) -> None:
        """Look for changes: keys, services and the end of the bag change the state, too."""
        self._polling = asyncio.get_running_loop().call_later(_LOOK_S, self._look)
        self._tell()

    def _tell(self) -> None:
        state = self.state
        if state != self._told:
            self._told = state
            for changed in [*self._watchers.values()]:
                changed()


def recorded_losses(bags: JoinedBags) -> Mapping[str, Losses] | None:
    """The topics with messages that recorders lost; None if no recorder has counted.

    Raises BagError if a record is broken.
    """
    records = [one for reader in bags.readers if (one := find_losses(reader))]
    if not records:
        return None
    found: dict[str, Losses] = {}
    for topics in records:
        for name, counters in sorted(topics.items()):
            if any(counters.lost.values()):
                found[name] = _joined(name, counters, found.get(name))
    return found


def _joined(name: str, one: losses.TopicLosses, earlier: Losses | None) -> Losses:
    try:
        timeline = one.timeline
    except ValueError as error:
        raise BagError(f"the record of losses of '{name}' is broken: {error}") from None
    lost, expected = sum(one.lost.values()), one.expected
    if earlier is None:
        return Losses(lost, expected, timeline)
    both = LossTimeline.of([*earlier.timeline.slots(), *timeline.slots()], earlier.timeline.earlier)
    both.add_earlier(timeline.earlier)
    return Losses(earlier.lost + lost, earlier.expected + expected, both)


def recording_of(bags: JoinedBags, paths: Sequence[Path]) -> Recording:
    """The bags opened from `paths`, as one recording. Raises BagError if they have no messages."""
    name = " + ".join(path.resolve().name for path in paths)
    if not bags.message_count:
        raise BagError(f"Nothing to play: {name} has no messages")
    recording = Recording(name, bags.starting_time, bags.starting_time + bags.duration, None)
    try:
        return recording._replace(losses=recorded_losses(bags))
    except BagError as error:  # its messages can be played nevertheless
        return recording._replace(fault=str(error))


async def play_on_page(
    bags: JoinedBags,
    recording: Recording,
    options: PlayOptions,
    serve: Callable[[Playback], Coroutine[Any, Any, None]],
    *,
    socket: str | None = None,
    domain: int | None = None,
) -> None:
    """Play the bags while `serve` serves pages that control this, until one of both ends.

    Raises BagError if no topic can be played or the bag becomes unreadable, and the errors of `serve`.
    """
    async with replay(bags, options, socket=socket, domain=domain) as now:
        if not now.topics:
            raise BagError(f"Nothing to play: no topic of {recording.name} can be played")
        control = PlayerControl(now.player, recording)
        await until_one_ends(serve(control), now.player.play())
