"""Reads one far publisher through the engine while a subscription on this bus wants its messages.

Owns the engine's reader, and the losses of earlier readers. Must not know the receiver of messages.
"""

import asyncio
from collections.abc import Callable, Mapping
from enum import Enum

from bus.endpoint.core import summed
from bus.schema import MessageSchema
from bus_bridge.batch import Batch
from bus_bridge.engine import Engine, FarEndpoint, Reader
from bus_bridge.errors import in_words

__all__ = ["TRANSITIONS", "FarReading", "ReadingError", "ReadingEvent", "ReadingState"]

_LINGER_S = 2.0
"""Time of reading after the last subscription has gone: after a restart of busd, it comes back soon."""
_RETRY_S = 2.0


class ReadingState(Enum):
    """Whether the publisher is being read."""

    IDLE = "idle"
    """No subscription wants its messages."""
    READING = "reading"
    LINGERING = "lingering"
    """It is still read for a short time although no subscription wants its messages any more."""
    FAILED = "failed"
    """A subscription wants its messages, but the engine could not read it. A retry follows."""
    CLOSED = "closed"


class ReadingEvent(Enum):
    """Events that change the state."""

    WANT = "want"
    """A subscription is matched."""
    UNWANT = "unwant"
    """No subscription is matched."""
    FAIL = "fail"
    """The engine can't read it."""
    STOP = "stop"
    """It has lingered long enough, or the far publisher was away and is back."""
    CLOSE = "close"
    """The publisher or the bridge ends."""


_State, _Event = ReadingState, ReadingEvent

TRANSITIONS: Mapping[ReadingState, Mapping[ReadingEvent, ReadingState]] = {
    _State.IDLE: {
        _Event.WANT: _State.READING,
        _Event.UNWANT: _State.IDLE,
        _Event.STOP: _State.IDLE,
        _Event.CLOSE: _State.CLOSED,
    },
    _State.READING: {
        _Event.WANT: _State.READING,
        _Event.UNWANT: _State.LINGERING,
        _Event.FAIL: _State.FAILED,
        _Event.STOP: _State.IDLE,
        _Event.CLOSE: _State.CLOSED,
    },
    _State.LINGERING: {
        _Event.WANT: _State.READING,
        _Event.UNWANT: _State.LINGERING,
        _Event.STOP: _State.IDLE,
        _Event.CLOSE: _State.CLOSED,
    },
    _State.FAILED: {
        _Event.WANT: _State.READING,
        _Event.UNWANT: _State.IDLE,
        _Event.STOP: _State.IDLE,
        _Event.CLOSE: _State.CLOSED,
    },
    _State.CLOSED: dict.fromkeys(ReadingEvent, _State.CLOSED),
}
"""The next state, by state and event. An event that is missing in the row of a state must not happen in
it."""


class ReadingError(Exception):
    """An event that is not possible in the current state: a bug in the bridge."""


class FarReading:
    """The reading of `endpoint`.

    `on_begin` is called before each reader is made, and `retry` for a new attempt after a failed one.
    `on_trouble` gets an explanation of the failure.
    """

    def __init__(
        self,
        engine: Engine,
        endpoint: FarEndpoint,
        schema: MessageSchema,
        on_batch: Callable[[Batch], None],
        on_begin: Callable[[], object],
        retry: Callable[[], object],
        on_trouble: Callable[[str], object],
    ) -> None:
        self.endpoint = endpoint
        self.state = ReadingState.IDLE
        self._engine = engine
        self._schema = schema
        self._on_batch = on_batch
        self._on_begin = on_begin
        self._retry = retry
        self._on_trouble = on_trouble
        self._restores = False
        self._reader: Reader | None = None
        """Not None in the states READING and LINGERING."""
        self._lost_before: dict[str, int] = {}
        """Messages that earlier readers lost, by reason."""
        self._timer: asyncio.TimerHandle | None = None

    @property
    def lost(self) -> dict[str, int]:
        """Messages that the engine received and lost, by reason."""
        return summed(self._lost_before, {} if self._reader is None else self._reader.lost)

    @property
    def is_flowing(self) -> bool:
        return self._reader is not None

    def resume(self, lost_before: dict[str, int], *, restores: bool) -> None:
        """Continue an earlier reading of the publisher, which lost these messages. Call this first.

        `restores`: messages that the publisher keeps are needed again.
        """
        self._lost_before = lost_before
        self._restores = restores

    def want(self, is_wanted: bool) -> None:
        """Update whether a subscription is matched."""
        self._on(ReadingEvent.WANT if is_wanted else ReadingEvent.UNWANT)
        if self.state is ReadingState.READING and self._reader is None:
            self._begin()
        elif self.state is ReadingState.LINGERING:
            self._timer = asyncio.get_running_loop().call_later(_LINGER_S, self.stop)

    def taken(self, size: int) -> None:
        """Tell the reader that `size` bytes of payload were published or dropped."""
        if self._reader is not None:
            self._reader.taken(size)

    def stop(self) -> None:
        """Stop reading until a subscription is matched again."""
        self._on(ReadingEvent.STOP)
        self._end()

    def close(self) -> None:
        """End the reading."""
        self._on(ReadingEvent.CLOSE)
        self._end()

    def _on(self, event: ReadingEvent) -> None:
        """Handle `event` and stop the timer of the former state. Raises ReadingError if it is not possible in
        this state."""
        state = TRANSITIONS[self.state].get(event)
        if state is None:
            way = f"the reading of '{self.endpoint.topic}'"
            raise ReadingError(f"{way} is {self.state.value!r}: {event.value!r} can't happen to it")
        self.state = state
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _begin(self) -> None:
        self._on_begin()
        try:
            self._reader = self._engine.read(
                self.endpoint, self._schema, self._on_batch, restores=self._restores
            )
            self._restores = False
        except Exception as error:
            self._on(ReadingEvent.FAIL)
            self._on_trouble(in_words(error))
            self._timer = asyncio.get_running_loop().call_later(_RETRY_S, self._retry)

    def _end(self) -> None:
        reader, self._reader = self._reader, None
        if reader is not None:
            self._lost_before = summed(self._lost_before, reader.lost)
            reader.close()
