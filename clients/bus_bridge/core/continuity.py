"""The numbers of one publisher's messages: which comes next, which may repeat, and which were lost. Pure.

Used by the ways out (`export`), where taps come and go, and by the ways in (`imports`), where the engine's
readers do. The states say what a gap in the numbers means, and what a number that is not above the last one
means. A way in may also get other numbers for the same messages: in a ring of buses a publisher's messages
come by another bridge, which counts from 1, when the first way is gone. Messages that came before are
recognized by their time then.
"""

from collections.abc import Mapping
from enum import Enum
from typing import NamedTuple

from bus_bridge.batch import Batch, Loose, Sample

__all__ = [
    "TRANSITIONS",
    "Classified",
    "Continuity",
    "ContinuityError",
    "ContinuityEvent",
    "ContinuityState",
    "Listeners",
]


class ContinuityState(Enum):
    """What is known of the number of the next message."""

    __hash__ = object.__hash__  # Enum's own is a call in Python

    BEGINNING = "beginning"
    """The next message may have any number above the last one. Nobody misses those before it."""
    FOLLOWING = "following"
    """The next message has the next number. Those that are missing were lost."""
    RETURNING = "returning"
    """As FOLLOWING, after an interruption: whoever was there before has missed those that are missing."""
    RESTORING = "restoring"
    """As RETURNING, but this end has lost what late joiners get. So the history comes once more, and its
    messages are no repetitions."""


class ContinuityEvent(Enum):
    """What happens to it."""

    __hash__ = object.__hash__

    RECEIVE = "receive"
    """A message with a number comes."""
    RESUME = "resume"
    """Before all messages: an earlier way of the publisher ended at the last number."""
    RESTORE = "restore"
    """The same, and the history is needed once more."""
    INTERRUPT = "interrupt"
    """Messages stop, and come again from now on."""
    RESTART = "restart"
    """Messages come from now on for somebody who was not there before."""
    RENUMBER = "renumber"
    """Messages have other numbers from now on."""


_State, _Event = ContinuityState, ContinuityEvent

TRANSITIONS: Mapping[ContinuityState, Mapping[ContinuityEvent, ContinuityState]] = {
    _State.BEGINNING: {
        _Event.RECEIVE: _State.FOLLOWING,
        _Event.RESUME: _State.RETURNING,
        _Event.RESTORE: _State.RESTORING,
        _Event.INTERRUPT: _State.BEGINNING,
        _Event.RESTART: _State.BEGINNING,
        _Event.RENUMBER: _State.BEGINNING,
    },
    _State.FOLLOWING: {
        _Event.RECEIVE: _State.FOLLOWING,
        _Event.INTERRUPT: _State.RETURNING,
        _Event.RESTART: _State.BEGINNING,
        _Event.RENUMBER: _State.BEGINNING,
    },
    _State.RETURNING: {
        _Event.RECEIVE: _State.FOLLOWING,
        _Event.INTERRUPT: _State.RETURNING,
        _Event.RESTART: _State.BEGINNING,
        _Event.RENUMBER: _State.BEGINNING,
    },
    _State.RESTORING: {
        _Event.RECEIVE: _State.FOLLOWING,
        _Event.INTERRUPT: _State.RESTORING,
        _Event.RENUMBER: _State.BEGINNING,
    },
}
"""What follows, by state and event; what is not in it must not happen."""


class ContinuityError(Exception):
    """Something happened that can't happen in that state: a bug of the bridge."""


class Classified(NamedTuple):
    """What a batch is."""

    batch: Batch | None
    """The messages that are new."""
    repeated: int
    """Messages that had come before."""
    lost: int
    """Numbers that are missing though nothing was interrupted."""
    missed: int
    """Numbers that are missing after an interruption."""


class Continuity:
    """Nothing but `on` changes the state."""

    __slots__ = ("_copies", "_copies_until_ns", "last", "state")

    def __init__(self) -> None:
        self.state = ContinuityState.BEGINNING
        self.last = 0
        """The number of the last message that came; 0 for none."""
        self._copies = 0
        """After other numbers: how many messages, published up to `_copies_until_ns`, may come once more."""
        self._copies_until_ns = 0

    def on(self, event: ContinuityEvent) -> None:
        """`event` happens. Raises ContinuityError where it can't."""
        state = TRANSITIONS[self.state].get(event)
        if state is None:
            raise ContinuityError(f"a way is {self.state.value!r}: {event.value!r} can't happen to it")
        self.state = state

    def resume(self, last: int, *, restores: bool) -> None:
        """An earlier way ended at the number `last`. `restores`: the history is needed once more."""
        self.on(_Event.RESTORE if restores else _Event.RESUME)
        self.last = last

    def renumber(self, copies: int, until_ns: int) -> None:
        """The messages to come have other numbers than those before. `copies` messages at most, published
        until `until_ns`, had come before. If the history is needed, they are none."""
        if self.state is not _State.RESTORING:
            self._copies, self._copies_until_ns = copies, until_ns
        self.on(_Event.RENUMBER)
        self.last = 0

    def follows(self, batch: Batch) -> bool:
        """Whether the messages go on where the last ones ended, each once, as they nearly always do. Then
        they count as received; otherwise `classify` or `jump` says what they are."""
        if batch.first_number != self.last + 1 or not batch.is_consecutive or self._copies:
            return False
        self.last = batch.last_number
        if self.state is not _State.FOLLOWING:
            self.on(_Event.RECEIVE)
        return True

    def jump(self, batch: Batch) -> Classified:
        """As `classify`, for messages whose numbers are known to rise, the first above `last`."""
        gap = batch.last_number - self.last - batch.count
        state = self.state
        self.on(_Event.RECEIVE)
        self.last = batch.last_number
        if state is _State.FOLLOWING:
            return Classified(batch, 0, gap, 0)
        return Classified(batch, 0, 0, 0 if state is _State.BEGINNING else gap)

    def classify(self, batch: Batch) -> Classified:
        """What messages in any order are. Those without a number are new."""
        found: list[Sample] = []
        repeated = lost = missed = 0
        for sample in batch:
            number = sample.number
            if self._copies and sample.source_time_ns <= self._copies_until_ns:
                self._copies -= 1
                self.last = number
                if self.state is not _State.FOLLOWING:
                    self.on(_Event.RECEIVE)
                repeated += 1
                continue
            self._copies = 0
            if number:
                state = self.state
                if state is _State.RESTORING:
                    self.last = min(self.last, number - 1)
                if number <= self.last:
                    repeated += 1
                    continue
                if state is _State.FOLLOWING:
                    lost += number - self.last - 1
                elif state is not _State.BEGINNING:
                    missed += number - self.last - 1
                self.last = number
                if state is not _State.FOLLOWING:
                    self.on(_Event.RECEIVE)
            found.append(sample)
        return Classified(batch if len(found) == batch.count else Loose.some(found), repeated, lost, missed)


class Listeners:
    """Subscriptions that had the last message of a way in, by gid. Only for them is lost what comes to nobody
    until the way is back: others were not there.

    While busd is away there are no matches, and the same subscriptions come back with it.
    """

    __slots__ = ("_last", "before", "now")

    def __init__(self) -> None:
        self.before: frozenset[bytes] = frozenset()
        """Those that had what came last before the matches changed."""
        self.now: frozenset[bytes] = frozenset()
        """Those that are matched."""
        self._last = 0

    def change(self, now: frozenset[bytes], last: int) -> None:
        """The matches may have changed; the last message so far had the number `last`."""
        if last != self._last and self.now:
            self.before = self.now
        self._last = last
        self.now = now

    def resume(self, before: frozenset[bytes], last: int) -> None:
        """An earlier way ended at the number `last`, which these had."""
        self.before, self._last = before, last

    def forget(self) -> None:
        """The messages to come have other numbers: what is missing before them can't be known."""
        self.before, self._last = frozenset(), 0

    @property
    def are_back(self) -> bool:
        """Whether one of those that had the last message is there."""
        return bool(self.before & self.now)
