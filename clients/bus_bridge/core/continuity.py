"""Numbers of one publisher's messages: finds new, repeated and lost messages. Pure.

Routes out (`export`) use it because taps come and go. Routes in (`imports`) use it because the engine's
readers come and go. The state answers two questions: whether a gap in the numbers is a loss, and whether a
number that is not above the last one is a repetition.

The numbers of a route in may also change although the messages are the same. In a ring of buses, if the first
route to a publisher fails, its messages come through another bridge, which counts from 1. Then copies
(messages that came before) are recognized by their time.
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
    """The meaning of the next message's number."""

    __hash__ = object.__hash__  # the one of Enum is a Python function, which is slower

    BEGINNING = "beginning"
    """The next message may have any number above the last one. A gap is not a loss."""
    FOLLOWING = "following"
    """The next message has the next number. A gap is a loss."""
    RETURNING = "returning"
    """There was an interruption. A gap is a loss for subscriptions that existed before it."""
    RESTORING = "restoring"
    """Like RETURNING, but the history for late joiners was lost here and comes again. Its messages are not
    repetitions."""


class ContinuityEvent(Enum):
    """Events that change the state."""

    __hash__ = object.__hash__

    RECEIVE = "receive"
    """A message with a number arrives."""
    RESUME = "resume"
    """This route continues an earlier route of the publisher, after its last number."""
    RESTORE = "restore"
    """Like RESUME, and the history is needed again."""
    INTERRUPT = "interrupt"
    """Messages stopped, and start again now."""
    RESTART = "restart"
    """Messages start now for a new subscription."""
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
"""The next state, by state and event. An event that is missing in the row of a state must not happen in
it."""


class ContinuityError(Exception):
    """An event that is not possible in the current state: a bug in the bridge."""


class Classified(NamedTuple):
    """A batch after its numbers were checked."""

    batch: Batch | None
    """The new messages."""
    repeated: int
    """Number of messages that had arrived before."""
    lost: int
    """Number of missing messages without an interruption."""
    missed: int
    """Number of missing messages after an interruption."""


class Continuity:
    """The state of one route. Only `on` changes it."""

    __slots__ = ("_copies", "_copies_until_ns", "last", "state")

    def __init__(self) -> None:
        self.state = ContinuityState.BEGINNING
        self.last = 0
        """The number of the last message; 0 before the first one."""
        self._copies = 0
        """Number of copies that may still come, of messages published up to `_copies_until_ns`."""
        self._copies_until_ns = 0

    def on(self, event: ContinuityEvent) -> None:
        """Handle `event`. Raises ContinuityError if it is not possible in this state."""
        state = TRANSITIONS[self.state].get(event)
        if state is None:
            raise ContinuityError(f"a way is {self.state.value!r}: {event.value!r} can't happen to it")
        self.state = state

    def resume(self, last: int, *, restores: bool) -> None:
        """Continue an earlier route, which ended at the number `last`.

        `restores`: the history is needed again.
        """
        self.on(_Event.RESTORE if restores else _Event.RESUME)
        self.last = last

    def renumber(self, copies: int, until_ns: int) -> None:
        """Prepare for other numbers in the next messages.

        At most `copies` of them, published up to `until_ns`, came before. If the history is needed again, no
        message counts as a copy.
        """
        if self.state is not _State.RESTORING:
            self._copies, self._copies_until_ns = copies, until_ns
        self.on(_Event.RENUMBER)
        self.last = 0

    def follows(self, batch: Batch) -> bool:
        """Whether the batch continues the numbers without a gap or a repetition, which is the normal case.

        Then it counts as received. Otherwise call `classify` or `jump`.
        """
        if batch.first_number != self.last + 1 or not batch.is_consecutive or self._copies:
            return False
        self.last = batch.last_number
        if self.state is not _State.FOLLOWING:
            self.on(_Event.RECEIVE)
        return True

    def jump(self, batch: Batch) -> Classified:
        """Like `classify`, for rising numbers if the first number is above `last`."""
        gap = max(0, batch.last_number - self.last - batch.count)
        state = self.state
        self.on(_Event.RECEIVE)
        self.last = batch.last_number
        if state is _State.FOLLOWING:
            return Classified(batch, 0, gap, 0)
        return Classified(batch, 0, 0, 0 if state is _State.BEGINNING else gap)

    def classify(self, batch: Batch) -> Classified:
        """Check each number, in any order. A message without a number is new."""
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
    """Subscriptions that got the last message of a route in, by gid. A gap after an interruption is a loss
    for them only.

    Without busd there are no matches. When it is back, so are the same subscriptions.
    """

    __slots__ = ("_last", "before", "now")

    def __init__(self) -> None:
        self.before: frozenset[bytes] = frozenset()
        """Subscriptions that got the last message before the matches changed."""
        self.now: frozenset[bytes] = frozenset()
        """Subscriptions that are matched now."""
        self._last = 0

    def change(self, now: frozenset[bytes], last: int) -> None:
        """Update the matches; `last` is the number of the last message so far."""
        if last != self._last and self.now:
            self.before = self.now
        self._last = last
        self.now = now

    def resume(self, before: frozenset[bytes], last: int) -> None:
        """Continue an earlier route that ended at the number `last`, which the subscriptions `before`
        received."""
        self.before, self._last = before, last

    def forget(self) -> None:
        """Forget the subscriptions: the next messages have other numbers, so a gap before them can't be
        counted."""
        self.before, self._last = frozenset(), 0

    @property
    def are_back(self) -> bool:
        """Whether a subscription that got the last message is matched."""
        return bool(self.before & self.now)
