"""Plays a bag: publishes each message at its due time, and executes commands of keys and services.

Owns: the order of events. Must not know: files, types, terminals, services. Everything here runs on the event
loop, so reading or changing a state needs no lock. Only `play` waits. The states of a replay, and their
events, are in `play/state.py`.
"""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from time import monotonic_ns
from typing import NamedTuple, Protocol, Self

from bus.errors import BusError
from bus.logger import Logger
from bus_bag.play.alarm import Alarm
from bus_bag.play.lateness import Lateness
from bus_bag.play.options import PlayOptions
from bus_bag.play.progress import Progress, Status
from bus_bag.play.read_ahead import Entry, ReadAheadQueue
from bus_bag.play.seek import Seek
from bus_bag.play.state import PlayerEvent, PlayerLife, PlayerState
from bus_bag.play.time_line import TimeLine

__all__ = ["Output", "Player", "Span"]

_FOR_EVER_NS = 1 << 62
"""Pauses the time line while the bag is read."""
_TURN_NS = 5_000_000
"""Longest time of publishing due messages without yielding to the event loop."""
_STARVED = (
    "Message queue starved. Messages will be delayed. Consider increasing the --read-ahead-queue-size option."
)


class Output(Protocol):
    """The receiver of a topic's messages: a raw publisher."""

    def publish_encoded(self, payload: bytes, *, source_time_ns: int | None = None) -> bool: ...

    def wait_for_room(self) -> Awaitable[None]: ...


class Span(NamedTuple):
    """The played part of a bag, in the bag's time."""

    start: int
    end: int
    """Reception of the last message."""
    is_whole: bool
    """Whether `start` is the bag's beginning. Then there is no latched state before it."""
    until: int = -1
    """Later messages are not played; -1: no limit, 0: no messages at all."""

    def is_before(self, time: int) -> bool:
        """Whether it ends before that time."""
        return self.until == 0 or -1 < self.until < time


class Player:
    """Plays messages from `queue` to `outputs`, by topic. Use it with `async with`.

    `clock` is called with the time of the bag before each message that asks for it.
    """

    def __init__(
        self,
        queue: ReadAheadQueue,
        outputs: Mapping[str, Output],
        span: Span,
        options: PlayOptions,
        logger: Logger,
        clock: Callable[[int], None] | None = None,
    ) -> None:
        self.lateness = Lateness()
        self.messages = 0
        """Messages published so far, without messages of the latched state."""
        self.seeks = 0
        """Seeks so far whose target the time line has reached."""
        self._queue = queue
        self._outputs = outputs
        self._span = span
        self._options = options
        self._logger = logger
        self._clock = clock
        self._time = TimeLine(span.start, monotonic_ns(), options.rate, is_paused=options.is_paused)
        self._time.jump(span.start, monotonic_ns(), _FOR_EVER_NS)
        self._alarm = Alarm()
        self._life = PlayerLife()
        self._begun = asyncio.Event()
        """Set when playing has begun or ended."""
        self._seek: Seek | None = None
        self._reading = asyncio.Lock()
        self._turn_ns = 0
        self.on_message: Callable[[], None] | None = None
        """Called after each message."""
        self.on_seek: Callable[[], None] | None = None
        """Called when the time line has jumped by a seek, before the messages from there."""

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *exc_info: object) -> None:
        self._alarm.close()

    # --- commands

    @property
    def is_paused(self) -> bool:
        return self._time.is_paused

    @property
    def rate(self) -> float:
        return self._time.rate

    @property
    def bag_time(self) -> int:
        """The current time in the bag."""
        return self._time.bag_time(monotonic_ns())

    @property
    def shown_time(self) -> int:
        """The current time in the bag, at most its end: it runs on while messages are late."""
        return min(self.bag_time, max(self._span.end, self._span.start))

    @property
    def progress(self) -> Progress:
        """The current position, for the line of progress."""
        span = self._span
        return Progress(self.bag_time, span.start, span.end, self.rate, self.messages, self._status)

    @property
    def _status(self) -> Status:
        if self._life.state is PlayerState.BURSTING:
            return Status.BURST
        if self._seek is not None:
            return Status.DELAYED
        if self._life.state is PlayerState.AT_END:
            return Status.AT_END
        if self.is_paused:
            return Status.PAUSED
        return Status.DELAYED if self._time.is_delayed(monotonic_ns()) else Status.RUNNING

    def pause(self) -> None:
        self._time.pause(monotonic_ns())
        self._logger.info("Pausing play.")
        self._alarm.wake()

    def resume(self) -> None:
        """End a pause. At the end of a replay that stays there: play it again from the beginning."""
        if self._life.state is PlayerState.AT_END and self._seek is None:
            self._seek = Seek(self._span.start)
        self._time.resume(monotonic_ns())
        self._logger.info("Resuming play.")
        self._alarm.wake()

    def toggle_paused(self) -> None:
        (self.resume if self.is_paused else self.pause)()

    def hold(self) -> Callable[[], None]:
        """Pause without a log line; returns a function that ends this pause."""
        if self._time.is_paused:
            return lambda: None
        self._time.pause(monotonic_ns())

        def go_on() -> None:
            self._time.resume(monotonic_ns())
            self._alarm.wake()

        return go_on

    def set_rate(self, rate: float) -> bool:
        """Change the rate; returns False if `rate` is not valid."""
        is_set = self._time.set_rate(rate, monotonic_ns())
        if is_set:
            self._logger.info(f"Set rate to {rate:g}")
        else:
            self._logger.warning(f"Failed to set rate to invalid value {rate:g}")
        self._alarm.wake()
        return is_set

    def stop(self) -> None:
        """End `play`."""
        if self._life.state is not PlayerState.ENDED:
            self._logger.info("Stopping playback.")
            self._life.on(PlayerEvent.STOP)
            self._alarm.wake()

    async def seek(self, time_ns: int) -> bool:
        """Continue at that time of the bag, with its latched state first; False if nothing is being played.

        A time before the beginning counts as the beginning; a time after the end as the end, if the replay
        stays there. Cancellation does not prevent the seek.
        """
        if self._life.state is PlayerState.ENDED:
            self._logger.warning("Called seek, but player is not playing.")
            return False
        target = max(time_ns, self._span.start)
        if self._options.stays_at_end:
            target = min(target, self._span.end)
        if self._seek is None:
            self._seek = Seek(target)
        else:
            self._seek.target = target
        self._alarm.wake()
        return await self._seek.wait()

    async def play_next(self) -> bool:
        """Publish the next message during a pause; False without a pause, or without a message."""
        if self._life.state is PlayerState.ENDED:
            self._logger.warning("Called play next, but player is not playing.")
            return False
        if not self.is_paused:
            self._logger.warning("Called play next, but not in paused state.")
            return False
        await self._begun.wait()
        async with self._reading:
            is_played = await self._play_next()
        self._alarm.wake()  # it may have been the last message
        return is_played

    async def burst(self, count: int) -> int:
        """Publish `count` messages at once during a pause; 0: all remaining ones. Returns their number."""
        if not self.is_paused:
            self._logger.warning("Burst can only be used when in the paused state.")
            return 0
        played = 0
        await self._begun.wait()
        async with self._reading:
            self._life.on(PlayerEvent.BURST)
            try:
                while (not count or played < count) and await self._play_next():
                    played += 1
            finally:
                self._life.on(PlayerEvent.BURST_END)
                self._alarm.wake()
        self._logger.info(f"Burst {played} messages.")
        return played

    # --- playing

    async def play(self) -> bool:
        """Play from the beginning to the end, or in a loop; False if it has been called before.

        A loop without messages ends.

        Raises BagError if the bag becomes unreadable. Cancellation ends it between two messages.
        """
        if self._life.has_begun:
            self._logger.warning("Trying to play() while in playback, dismissing request.")
            return False
        self._life.on(PlayerEvent.PLAY)
        self._logger.info(f"Playback until timestamp: {self._span.until}")
        try:
            while True:
                before = self.messages, self.seeks
                await self._begin()
                self._begun.set()
                await self._play_to_the_end()
                if not self._life.may_publish or not self._options.is_looping:
                    return True
                if before == (self.messages, self.seeks):
                    self._logger.warning("There is no message to play, so the loop ends.")
                    return True
        finally:
            self._life.on(PlayerEvent.END)
            self._begun.set()
            if self._seek is not None:
                self._seek.end(is_there=False)

    async def _begin(self) -> None:
        delay = self._options.delay
        if delay:
            self._logger.info(f"Sleep {delay} ns")
        start = self._span.start
        await self._go_to(start, None if self._span.is_whole else start, delay)

    async def _go_to(self, time_ns: int, start: int | None, delay: int = 0, *, is_seek: bool = False) -> None:
        """Read the messages from there on, then start the time line there."""
        async with self._reading:
            self._queue.start_at(start)
            self._time.jump(time_ns, monotonic_ns(), _FOR_EVER_NS)
            if is_seek:
                self._life.on(PlayerEvent.JUMP)
                self.seeks += 1
                if self.on_seek is not None:
                    self.on_seek()
            await self._queue.wait(is_full=True)
            while (entry := self._queue.peek()) is not None and entry.is_state:
                await self._publish(self._queue.pop())
            self._time.jump(time_ns, monotonic_ns(), delay)
            self._life.on(PlayerEvent.READY)

    async def _play_to_the_end(self) -> None:
        """Publish until there is no message left and no pause, or until `stop`."""
        while self._life.may_publish:
            if self._seek is not None:
                await self._do_seek(self._seek)
                continue
            if self._stays and self._has_played_all:
                self._time.pause(monotonic_ns())
                self._life.on(PlayerEvent.LAST)
            if self.is_paused:
                await self._alarm.wait(None)
                continue
            entry = self._queue.peek()
            if entry is None and not self._queue.has_ended:
                self._logger.warning(_STARVED, throttle_duration_sec=1.0)
                await self._queue.wait()
                continue
            if entry is None or self._span.is_before(entry.time):
                return
            due_ns, now_ns = self._time.due(entry.time), monotonic_ns()
            if due_ns is not None and due_ns > now_ns:
                if self._is_gap(entry.time, now_ns):
                    self._time.skip_to(entry.time, now_ns)
                    continue
                await self._alarm.wait(due_ns)
                self._turn_ns = monotonic_ns()
                continue
            if self._reading.locked():  # a burst that `resume` has overtaken
                async with self._reading:
                    continue
            self._queue.pop()
            await self._publish(entry)
            if due_ns is not None and entry.time >= self._span.start:
                self.lateness.add(now_ns - due_ns)

    @property
    def _stays(self) -> bool:
        """Whether it may stay at the end now."""
        is_asked = self._options.stays_at_end and not self._options.is_looping
        return is_asked and self._life.state is PlayerState.PLAYING

    @property
    def _has_played_all(self) -> bool:
        """Whether no message is left to play. Raises BagError if the bag becomes unreadable."""
        entry = self._queue.peek()
        return self._queue.has_ended if entry is None else self._span.is_before(entry.time)

    def _is_gap(self, time_ns: int, now_ns: int) -> bool:
        """Whether the time until the next message, at `time_ns`, is to be skipped."""
        most = self._options.skipped_gap
        return most is not None and time_ns - self._time.bag_time(now_ns) > most

    async def _do_seek(self, seek: Seek) -> None:
        self._seek = None
        is_there = False
        try:
            await self._go_to(seek.target, seek.target, is_seek=True)
            is_there = True
        finally:
            seek.end(is_there=is_there)

    async def _play_next(self) -> bool:
        while (entry := self._queue.peek()) is None and not self._queue.has_ended:
            await self._queue.wait()
        if (
            entry is None
            or not self._life.may_publish
            or not self.is_paused
            or self._span.is_before(entry.time)
        ):
            return False
        self._queue.pop()
        await self._publish(entry)
        self._time.jump(entry.time, monotonic_ns())
        return True

    async def _publish(self, entry: Entry) -> None:
        if self._clock is not None and self._options.has_clock_before(entry.topic):
            self._clock(entry.time)
        output = self._outputs[entry.topic]
        source_time_ns = entry.publish_time or None
        try:
            while not output.publish_encoded(entry.payload, source_time_ns=source_time_ns):
                await output.wait_for_room()
        except BusError as error:
            text = f"Failed to publish message on '{entry.topic}' topic. \nError: {error}"
            self._logger.error(text, throttle_duration_sec=1.0)
        if entry.is_state:
            return
        self.messages += 1
        if self.on_message is not None:
            self.on_message()
        if (now_ns := monotonic_ns()) - self._turn_ns > _TURN_NS:
            await asyncio.sleep(0)
            self._turn_ns = now_ns
