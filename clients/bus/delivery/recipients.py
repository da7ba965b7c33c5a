"""The subscriptions that a publisher reaches by socket, including lost ones that may come back.

busd keeps nothing when it dies, and samples on their way to a disconnected process are lost. So a lossless
publisher keeps every sample until all lossless subscriptions have acknowledged it:

- A lost lossless subscription has a *place* here for a while. The publisher uses no credit above the place.
  When the subscription is back, only it gets the samples that it missed.
- After a restart of busd, nothing new leaves before the subscriptions of the last busd are back. The
  publisher waits RETURN_S for lossless ones, a second for other reliable ones, and only while its depth has
  room. So nothing is lost if busd restarts and the publisher is back first.

A publisher with a history needs none of this: returning subscriptions get its history.
"""

from collections.abc import Callable
from enum import Enum
from typing import TYPE_CHECKING

from bus.delivery.allowance import QUEUE_BYTES
from bus.delivery.port import RETURN_S, Owner, Port, Timer
from bus.qos import Durability, QoSProfile, Reliability
from bus.wire import messages as m
from bus.wire.bounds import MOST_PLACES
from bus.wire.runs import Account, Run, RunQueue, data_head

if TYPE_CHECKING:  # few publishers are lossless
    from bus.delivery.window import CreditWindow

_SHORT_RETURN_S = 1.0
"""Like RETURN_S, for subscriptions that are not lossless."""

_GRACE_S = 0.1
"""Extra time before a place is dropped, in which a loop that stood still reads messages received
meanwhile."""


class Wait(Enum):
    """Time for which the publisher waits for a subscription after the broker was lost."""

    NONE = "none"
    SHORT = "short"
    LONG = "long"
    """The subscription and the publisher are lossless."""


class _Place:
    """The point at which a lost lossless subscription will continue."""

    __slots__ = ("other", "seq", "timer")

    def __init__(self, seq: int, other: int, timer: Timer | None) -> None:
        self.seq = seq
        """The subscription has taken all samples up to this number."""
        self.other = other
        """The subscription's number at the present broker; 0: an earlier broker lost it."""
        self.timer = timer

    def cancel(self) -> None:
        if self.timer is not None:
            self.timer.cancel()


class Recipients:
    """The recipients of publisher `owner`. `first_unsent()`: the first number not yet sent to any broker."""

    def __init__(
        self, port: Port, owner: Owner, window: "CreditWindow | None", first_unsent: Callable[[], int]
    ) -> None:
        self._port = port
        self._owner = owner
        self._window = window
        self._first_unsent = first_unsent
        has_history = owner.qos.durability is Durability.TRANSIENT_LOCAL
        self._longest_wait = Wait.LONG if window is not None else Wait.SHORT
        if has_history or owner.qos.reliability is not Reliability.RELIABLE:
            self._longest_wait = Wait.NONE
        self._kept: RunQueue | None = None
        """Runs that were handed over and perhaps not taken yet."""
        if self._longest_wait is Wait.LONG:
            self._kept = RunQueue(0, Account(QUEUE_BYTES))
        self._matches: dict[int, tuple[bytes, Wait]] = {}  # by the broker's number
        self._places: dict[bytes, _Place] = {}  # by the gid of the subscription, the oldest first
        self._level = 0  # the broker's last credit; a place below it holds the window back
        self.awaited: dict[bytes, Wait] = {}
        """Subscriptions of an earlier broker, by gid: nothing new leaves before they are back."""
        self._wait_timer: Timer | None = None  # for the awaited
        self._may_return = False  # matches of an earlier broker may be made again
        self._return: Timer | None = None  # the end of that
        self.on_all_back: Callable[[], object] = int
        """Called when no recipient is awaited any more."""
        self.on_fewer: Callable[[], object] = int
        """Called when a lost subscription does not count any more."""

    @property
    def are_there(self) -> bool:
        """Whether any subscription reads by socket, or may do so again."""
        return bool(self._matches or self._places) or self._may_return

    @property
    def places(self) -> tuple[bytes, ...]:
        """The gids of lost subscriptions that may come back and must miss nothing."""
        return tuple(self._places)

    # --- samples

    def keep(self, run: Run) -> None:
        """Keep a copy of a run that is handed over, for subscriptions that may be lost."""
        if self._kept is not None:
            self._kept.push(run)
            self._kept.drop_over_quota(spare=1)

    def credit(self, seq: int) -> None:
        """Note that all subscriptions that must acknowledge have taken the samples up to `seq`."""
        self._level = seq
        if self._places:
            seq = min(seq, *[place.seq for place in self._places.values()])
        kept = self._kept
        while kept is not None and kept.runs and kept.runs[0].first_seq + kept.runs[0].count - 1 <= seq:
            kept.forget_head()
        if self._window is not None:
            self._window.credit(seq)

    # --- matches

    def matched(
        self, other: int, gid: bytes, qos: QoSProfile, *, by_socket: bool, last_seq: int | None = None
    ) -> None:
        """Add a matched subscription; this is its route if `by_socket`.

        `last_seq`: it was lost and is back, has taken all samples up to this number, and waits for the rest.
        """
        wait = self._wait_after_loss(qos)
        was_lost = gid in self._places or self._is_matched(gid)
        if by_socket:
            self._matches[other] = gid, wait
        if wait is Wait.NONE:
            return
        if last_seq is not None:
            if was_lost:
                self._repeat(other, last_seq)
            self._port.send_about(self._owner, m.CaughtUp(publisher=self._owner.id, subscription=other))
            self._level = min(self._level, last_seq)  # the broker's credit, too, continues from there
        place = self._places.pop(gid, None)
        if gid in self.awaited and by_socket and wait is Wait.LONG and last_seq is None:
            self._repeat(other, 0)
            if place is not None:  # until the new broker gives credit, resent samples may not have arrived
                self._level = min(self._level, place.seq)
        if place is not None:
            place.cancel()
            self.credit(self._level)
        if self.awaited.pop(gid, None) is not None and not self.awaited:
            self.go_on()

    def unmatched(self, other: int) -> bool:
        """Remove a match; returns whether it was one by socket."""
        return self._matches.pop(other, None) is not None

    def keep_place(self, other: int, keep_s: float) -> None:
        """Note a lost subscription, which may return within `keep_s`; 0: it will not."""
        gid, wait = self._matches.pop(other, (b"", Wait.NONE))
        if not keep_s:
            for gid in [gid for gid, place in self._places.items() if place.other == other]:
                self._forget_place(gid, self._places[gid])
        elif wait is Wait.LONG and not self._is_matched(gid):
            place = self._places[gid] = _Place(self._level, other, None)
            place.timer = self._port.later(keep_s, self._time_is_up, gid, place)
            self._bound_places()

    # --- brokers

    def disconnected(self) -> None:
        """Note that the broker is gone, with all its matches."""
        self._cancel_timers()
        self._may_return |= bool(self._matches or self._places)
        for gid, place in self._places.items():
            self.awaited[gid] = Wait.LONG
            place.other = 0
            place.cancel()
        for gid, wait in self._matches.values():
            if wait is not Wait.NONE:
                self.awaited[gid] = wait
            if wait is Wait.LONG:
                self._places[gid] = _Place(self._level, 0, None)
        self._matches.clear()
        self._bound_places()

    def declared(self) -> None:
        """Start the timers that bound all waits, because a broker knows the publisher now."""
        later = self._port.later
        for gid, place in self._places.items():
            place.timer = later(RETURN_S, self._time_is_up, gid, place)
        if self.awaited:
            self._wait_timer = later(_SHORT_RETURN_S, self._wait_for_lossless)
        if self._may_return:
            self._return = later(RETURN_S, self._returned)

    def go_on(self) -> None:
        """Stop waiting: all awaited subscriptions are back, or were away too long."""
        if self._wait_timer is not None:
            self._wait_timer.cancel()
        self.awaited.clear()
        self.on_all_back()

    def end(self) -> None:
        """Nothing more will be sent."""
        self._cancel_timers()
        for place in self._places.values():
            place.cancel()
        self._places.clear()

    # --- inside

    def _wait_after_loss(self, qos: QoSProfile) -> Wait:
        if qos.reliability is not Reliability.RELIABLE:
            return Wait.NONE
        if self._longest_wait is Wait.LONG and not qos.is_lossless:
            return Wait.SHORT
        return self._longest_wait

    def _is_matched(self, gid: bytes) -> bool:
        """Whether a lossless subscription with this gid is matched, perhaps by its last connection."""
        return (gid, Wait.LONG) in self._matches.values()

    def _bound_places(self) -> None:
        while len(self._places) > MOST_PLACES:
            oldest = next(iter(self._places))
            self._forget_place(oldest, self._places[oldest])

    def _time_is_up(self, gid: bytes, place: _Place) -> None:
        place.timer = self._port.later(_GRACE_S, self._forget_place, gid, place)

    def _forget_place(self, gid: bytes, place: _Place) -> None:
        """Drop the place of a subscription that was away too long, or will not return."""
        if self._places.get(gid) is place:
            place.cancel()
            del self._places[gid]
            self.credit(self._level)
            self.on_fewer()

    def _repeat(self, other: int, last_seq: int) -> None:
        """Resend kept samples after `last_seq` to a subscription: perhaps they were not passed on."""
        assert self._kept is not None
        first_unsent, owner = self._first_unsent(), self._owner
        for run in self._kept.runs:
            if run.first_seq >= first_unsent:
                break
            if run.first_seq + run.count - 1 > last_seq:
                rest = run if run.first_seq > last_seq else run.after(last_seq)
                head = data_head(owner.id, rest.first_seq, rest.count, len(rest.body), only_for=other)
                self._port.send_about(owner, head + rest.body)

    def _wait_for_lossless(self) -> None:
        """Wait only for lossless subscriptions from now on: the others were away too long."""
        self.awaited = {gid: one for gid, one in self.awaited.items() if one is Wait.LONG}
        if self.awaited:
            self._wait_timer = self._port.later(RETURN_S - _SHORT_RETURN_S, self.go_on)
        else:
            self.go_on()

    def _returned(self) -> None:
        self._may_return = False
        self.on_fewer()

    def _cancel_timers(self) -> None:
        for timer in (self._wait_timer, self._return):
            if timer is not None:
                timer.cancel()
