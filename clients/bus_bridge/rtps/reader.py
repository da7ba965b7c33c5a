"""A reader, and its far writers: samples in, in order and each once; it asks for missing ones. Pure.

Owns: the numbers of each far writer, samples that are ahead of a missing one, acknowledgments. Must not know:
addresses, datagrams, clocks: times come from the caller, submessages go to `send`.
"""

from collections.abc import Callable
from typing import Final, NamedTuple

from bus_bridge.rtps.fragments import Partial
from bus_bridge.rtps.ids import PREFIX_BYTES
from bus_bridge.rtps.lives import READER_TRANSITIONS, ReaderEvent, ReaderState
from bus_bridge.rtps.messages import (
    MOST_IN_SET,
    Data,
    DataFragments,
    Gap,
    Heartbeat,
    HeartbeatFragment,
    write_acknack,
    write_nack_fragments,
)
from bus_bridge.rtps.parameters import Order, Parameters
from bus_bridge.rtps.room import Room
from bus_bridge.rtps.serials import Serial, Serials
from bus_bridge.rtps.writer import Send

__all__ = ["Arrived", "Reader"]

_FIRST_PAUSE_NS: Final = 10_000_000
_LONGEST_PAUSE_NS: Final = 1_000_000_000
_PATIENCE_NS: Final = 5_000_000_000
"""The reader gives up a sample if no fragment comes for so long; a reliable writer sends it again."""
_MOST_PARTIAL: Final = 16
"""Samples of one writer that arrive in fragments at the same time."""
_MOST_ASKED_PARTIAL: Final = 4


class Arrived(NamedTuple):
    """A sample, as it came."""

    writer: bytes
    """The GUID of its writer."""
    number: int
    payload: bytes | None
    """With its encapsulation. None: only news, in `inline`."""
    inline: Parameters
    order: Order
    """The byte order of `inline`."""
    time_ns: int
    """Time of publication, wall clock; 0 if the writer did not say."""


class _Far:
    """A matched far writer."""

    def __init__(self, guid: bytes, room: Room, now_ns: int, floor: int, *, reliable: bool) -> None:
        self.guid = guid
        self.room = room
        self.reliable = reliable
        self.low = 0
        """All numbers up to this one are done with."""
        self.last = 0
        """The last number that the writer has, as far as is known."""
        self.ahead: dict[int, Arrived | None] = {}
        """Numbers above a missing one; None: no sample has this number."""
        self.partial: dict[int, Partial] = {}
        self.state = ReaderState.JOINING
        self.serials = Serials()
        """Of its heartbeats."""
        self.requests = floor
        """The serial of the last ACKNACK or NACK_FRAG to it."""
        self.asks = 0
        """ACKNACKs to it."""
        self.pause_ns = _FIRST_PAUSE_NS
        self.due_ns = now_ns
        self.asked_ns = now_ns - _FIRST_PAUSE_NS

    def on(self, event: ReaderEvent) -> None:
        self.state = READER_TRANSITIONS[self.state][event]

    def forget(self, number: int) -> None:
        """Discard whatever has arrived of that number."""
        arrived = self.ahead.pop(number, None)
        if arrived is not None:
            self.room.give_back(len(arrived.payload or b""))
        partial = self.partial.pop(number, None)
        if partial is not None:
            partial.discard()

    def clear(self) -> None:
        for number in [*self.ahead, *self.partial]:
            self.forget(number)


class Reader:
    """One reader of our participant. `deliver` gets samples in the order of each writer.

    `sample_bytes`: longer samples are passed over, and counted. `on_restart` is called with the GUID of a
    writer that has restarted with the same GUID, as Discovery Servers do: remove it then.
    """

    def __init__(
        self,
        entity: bytes,
        send: Send,
        deliver: Callable[[Arrived], None],
        *,
        sample_bytes: int = 16 << 20,
        on_restart: Callable[[bytes], object] | None = None,
    ) -> None:
        self.entity = entity
        self.lost = 0
        """Samples that a writer no longer had when they were asked for, or that were lost on the way (best
        effort)."""
        self.too_long = 0
        """Samples above `sample_bytes`."""
        self.put_off = 0
        """Samples and fragments for which there was no room. They are asked for again."""
        self._send = send
        self._deliver = deliver
        self._sample_bytes = sample_bytes
        self._on_restart = on_restart
        self._writers: dict[bytes, _Far] = {}
        self._floor = 0
        """The highest serial of requests to removed writers: a writer that is back may remember it."""

    @property
    def writers(self) -> list[bytes]:
        """GUIDs of the matched writers."""
        return list(self._writers)

    @property
    def due_ns(self) -> int | None:
        """When `act` is due; None: not before something happens."""
        due = [
            far.due_ns
            for far in self._writers.values()
            if far.partial or (far.reliable and far.state is not ReaderState.FOLLOWING)
        ]
        return min(due, default=None)

    def is_following(self, guid: bytes) -> bool:
        """Whether that writer knows this reader: it has sent a heartbeat."""
        far = self._writers.get(guid)
        return far is not None and far.state is not ReaderState.JOINING

    def newest(self, guid: bytes) -> int | None:
        """The last number that this writer has, as far as this reader knows.

        None if the writer may not know the reader yet: it has sent no heartbeat, or, with best effort, no
        sample.
        """
        far = self._writers.get(guid)
        if far is None or (far.state is ReaderState.JOINING if far.reliable else not far.last):
            return None
        return far.last

    def add_writer(self, guid: bytes, room: Room, now_ns: int, *, reliable: bool = True) -> None:
        """Match a far writer. `room` is for its samples until they are delivered."""
        if guid in self._writers:
            return
        far = self._writers[guid] = _Far(guid, room, now_ns, self._floor, reliable=reliable)
        if reliable:
            self._ask(far, now_ns)

    def remove_writer(self, guid: bytes) -> None:
        far = self._writers.pop(guid, None)
        if far is not None:
            self._floor = max(self._floor, far.requests)
            far.clear()

    def ask(self, guid: bytes, now_ns: int) -> bool:
        """Ask that writer for a heartbeat; returns False if it sends none."""
        far = self._writers.get(guid)
        if far is None or not far.reliable:
            return False
        self._acknowledge(far, [], now_ns, is_final=False)
        return True

    def data(self, guid: bytes, one: Data, time_ns: int, now_ns: int) -> None:
        """Handle a sample of that writer."""
        far = self._writers.get(guid)
        if far is not None:
            arrived = Arrived(guid, one.number, one.payload, one.inline, one.order, time_ns)
            self._arrive(far, arrived, now_ns)

    def fragments(self, guid: bytes, one: DataFragments, time_ns: int, now_ns: int) -> None:
        """Handle fragments of a sample of that writer."""
        far = self._writers.get(guid)
        if far is None or not self._is_new(far, one.number):
            return
        if one.total_bytes > self._sample_bytes:
            self.too_long += 1
            self._skip(far, one.number, now_ns)
            return
        partial = far.partial.get(one.number)
        if partial is None:
            if not self._make_place(far, one.number):
                self.put_off += 1
                return
            partial = far.partial[one.number] = Partial(one, time_ns, far.room)
            partial.touched_ns = now_ns
        while not partial.add(one, now_ns):
            if not self._make_room(far, one.number):
                self.put_off += 1
                return
        if partial.is_whole:
            del far.partial[one.number]
            whole = Arrived(guid, one.number, partial.join(), partial.inline, partial.order, partial.time_ns)
            self._arrive(far, whole, now_ns)
        elif far.reliable and far.state is ReaderState.FOLLOWING:
            far.on(ReaderEvent.MISS)
            far.pause_ns = _FIRST_PAUSE_NS
            far.due_ns = now_ns + far.pause_ns
        elif not far.reliable:
            far.due_ns = now_ns + _PATIENCE_NS

    def heartbeat(self, guid: bytes, one: Heartbeat, now_ns: int) -> None:
        """Handle a heartbeat of that writer: some numbers may be gone, others missing."""
        far = self._writers.get(guid)
        if far is None or not far.reliable:
            return
        match far.serials.judge(one.serial, now_ns):
            case Serial.OLD:
                return
            case Serial.RESTARTED if self._on_restart is not None:
                self._on_restart(guid)
                return
        far.last = max(far.last, one.last)
        self._move_to(far, one.first - 1)
        is_missing = self._is_missing(far)
        far.on(ReaderEvent.MISS if is_missing else ReaderEvent.FILL)
        if not is_missing:
            if not one.is_final:
                self._acknowledge(far, [], now_ns)
        elif now_ns - far.asked_ns >= _FIRST_PAUSE_NS:
            self._ask(far, now_ns)
        else:
            far.due_ns = far.asked_ns + _FIRST_PAUSE_NS

    def heartbeat_fragment(self, guid: bytes, one: HeartbeatFragment, now_ns: int) -> None:
        """Handle a heartbeat about the fragments of a sample: ask for missing ones."""
        far = self._writers.get(guid)
        is_missing = far is not None and far.reliable and one.number in far.partial
        if far is not None and is_missing and now_ns - far.asked_ns >= _FIRST_PAUSE_NS:
            self._ask(far, now_ns)

    def gap(self, guid: bytes, one: Gap, now_ns: int) -> None:
        """Handle a gap: no sample will come with its numbers."""
        far = self._writers.get(guid)
        if far is None or not far.reliable:
            return
        if one.first <= far.low + 1:
            self._pass_over(far, one.base - 1)
        else:
            end = min(one.base, far.low + 1 + MOST_IN_SET)
            for number in range(one.first, end):
                self._mark(far, number)
        for number in one.more:
            self._mark(far, number)
        self._slide(far, now_ns)

    def act(self, now_ns: int) -> None:
        """Ask once more for missing samples, and give up samples whose fragments don't come."""
        for far in list(self._writers.values()):
            if far.due_ns > now_ns:
                continue
            for number, partial in list(far.partial.items()):
                if now_ns - partial.touched_ns >= _PATIENCE_NS:
                    far.forget(number)
            if far.reliable and far.state is not ReaderState.FOLLOWING:
                self._ask(far, now_ns)
            else:
                far.due_ns = now_ns + _PATIENCE_NS

    # --- inside

    def _is_new(self, far: _Far, number: int) -> bool:
        """Whether nothing, or not all, of a number has arrived, and it is near enough to be kept."""
        if number <= far.low or number in far.ahead:
            return False
        return not far.reliable or number <= far.low + MOST_IN_SET

    def _arrive(self, far: _Far, arrived: Arrived, now_ns: int) -> None:
        number = arrived.number
        if not self._is_new(far, number):
            if number > far.low:
                far.last = max(far.last, number)
            return
        far.last = max(far.last, number)
        if not far.reliable:
            if far.low:
                self.lost += number - far.low - 1
            far.low = number
            for older in [one for one in far.partial if one <= number]:
                far.forget(older)
            self._deliver(arrived)
            return
        if number == far.low + 1:
            far.low = number
            far.forget(number)
            self._deliver(arrived)
            self._slide(far, now_ns)
            return
        size = len(arrived.payload or b"")
        while not far.room.take(size):
            if not self._make_room(far, number):
                self.put_off += 1
                return
        far.ahead[number] = arrived

    def _skip(self, far: _Far, number: int, now_ns: int) -> None:
        """No sample is delivered with that number."""
        self._mark(far, number)
        if far.reliable:
            self._slide(far, now_ns)

    def _mark(self, far: _Far, number: int) -> None:
        if self._is_new(far, number):
            far.forget(number)
            if far.reliable:
                far.ahead[number] = None
            else:
                far.low = number

    def _move_to(self, far: _Far, number: int) -> None:
        """The writer has nothing up to that number any more."""
        if number <= far.low:
            return
        there = sum(1 for one in far.ahead if one <= number)
        if far.state is not ReaderState.JOINING:
            self.lost += number - far.low - there
        self._pass_over(far, number)
        self._slide(far, None)

    def _pass_over(self, far: _Far, number: int) -> None:
        """Deliver what there is up to that number, and wait for no other."""
        if number <= far.low:
            return
        due = sorted(one for one in far.ahead if one <= number)
        for one in [one for one in far.partial if one <= number]:
            far.forget(one)
        far.low = number
        for one in due:
            arrived = far.ahead.get(one)
            far.forget(one)
            if arrived is not None:
                self._deliver(arrived)

    def _slide(self, far: _Far, now_ns: int | None) -> None:
        """Deliver samples that are no longer ahead of a missing one."""
        while far.low + 1 in far.ahead:
            far.low += 1
            arrived = far.ahead[far.low]
            far.forget(far.low)
            if arrived is not None:
                self._deliver(arrived)
        if now_ns is not None and far.state is ReaderState.ASKING and not self._is_missing(far):
            far.on(ReaderEvent.FILL)
            far.pause_ns = _FIRST_PAUSE_NS
            self._acknowledge(far, [], now_ns)

    def _is_missing(self, far: _Far) -> bool:
        return bool(far.partial) or far.last > far.low

    def _ask(self, far: _Far, now_ns: int) -> None:
        """Ask for what is missing; while joining, for a heartbeat."""
        top = min(far.last, far.low + MOST_IN_SET) if far.state is not ReaderState.JOINING else 0
        missing = [
            number
            for number in range(far.low + 1, top + 1)
            if number not in far.ahead and number not in far.partial
        ]
        for number in sorted(far.partial)[:_MOST_ASKED_PARTIAL]:
            partial = far.partial[number]
            is_arriving = now_ns - partial.touched_ns < _FIRST_PAUSE_NS
            if not is_arriving and (fragments := partial.missing()):
                far.requests += 1
                reader, writer = self.entity, far.guid[PREFIX_BYTES:]
                self._send(far.guid, [write_nack_fragments(reader, writer, number, fragments, far.requests)])
        far.asked_ns = now_ns
        far.due_ns = now_ns + far.pause_ns
        far.pause_ns = min(2 * far.pause_ns, _LONGEST_PAUSE_NS)
        self._acknowledge(far, missing, now_ns, is_final=False)

    def _acknowledge(self, far: _Far, missing: list[int], now_ns: int, *, is_final: bool = True) -> None:
        far.requests += 1
        far.asks += 1
        base, writer = far.low + 1, far.guid[PREFIX_BYTES:]
        if far.state is ReaderState.JOINING and far.low == 0 and far.asks % 2 == 0:
            base = 0  # only this makes Fast DDS send a heartbeat; others may want the standard's 1
        acknack = write_acknack(self.entity, writer, base, missing, far.requests, is_final=is_final)
        self._send(far.guid, [acknack])

    def _make_place(self, far: _Far, number: int) -> bool:
        """Whether one more sample may arrive in fragments; a later one gives way."""
        if len(far.partial) < _MOST_PARTIAL:
            return True
        latest = max(far.partial)
        if far.reliable and latest < number:
            return False
        far.forget(latest if far.reliable else min(far.partial))
        return True

    def _make_room(self, far: _Far, number: int) -> bool:
        """Discard the latest sample of this writer that came after `number`; returns whether there was one.

        Without that, samples that wait for this one could take its room for ever.
        """
        kept = [one for one, arrived in far.ahead.items() if arrived is not None]
        later = max((*kept, *far.partial), default=0)
        if later <= number:
            return False
        far.forget(later)
        return True
