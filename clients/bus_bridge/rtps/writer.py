"""A writer, and its far readers: samples out, again if a reader asks, kept until all have acknowledged. Pure.

Owns: the numbers of samples, the kept samples, heartbeats. Must not know: addresses, datagrams, clocks: times
come from the caller, submessages go to `send`.
"""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from bus_bridge.rtps.ids import PREFIX_BYTES
from bus_bridge.rtps.lives import WRITER_TRANSITIONS, WriterEvent, WriterState
from bus_bridge.rtps.messages import (
    AckNack,
    NackFragments,
    write_data,
    write_fragment,
    write_gap,
    write_heartbeat,
    write_time,
)
from bus_bridge.rtps.serials import Serial, Serials

__all__ = ["USUAL", "Change", "Keeping", "Send", "Writer"]

Send = Callable[[bytes, Sequence[bytes]], None]
"""Called with the GUID of a far reader or writer, and submessages for it that may share a datagram."""

_FIRST_PAUSE_NS: Final = 20_000_000
_LONGEST_PAUSE_NS: Final = 2_000_000_000
_REST_NS: Final = 5_000_000
"""After a repair, further requests of the same reader wait so long: its next request may be older."""
_REPAIR_BYTES: Final = 256 << 10
"""About the kernel's receive buffer: more at once would be lost again."""
_MOST_WANTED: Final = 2048
"""Samples and fragments that a reader may have asked for at one time; it asks again for others."""
_MOST_GAPS: Final = 16
"""In answer to one request."""


class Keeping(NamedTuple):
    """How much a writer keeps. Above that, it drops the oldest sample; one not yet acknowledged is lost."""

    changes: int = 1000
    payload_bytes: int = 16 << 20
    for_late_joiners: bool = False
    """Transient local: acknowledged samples stay, too."""


USUAL: Final = Keeping()


class Change(NamedTuple):
    """A kept sample."""

    number: int
    payload: bytes | None
    inline: bytes
    to: bytes | None
    """The GUID of the only reader that gets it; None: all."""
    time_ns: int
    stays: bool
    """Whether late joiners get it."""
    waits_for: set[bytes]
    """Readers that have not acknowledged it."""


class _Far:
    """A matched far reader."""

    def __init__(self, guid: bytes, start: int, told: int, floor: int, *, reliable: bool) -> None:
        self.guid = guid
        self.reliable = reliable
        self.first = start
        """The first number that it may ask for: after the numbers before the match, and after lost ones."""
        self.told = told
        """It was told of all numbers up to this one: by a sample, or by a gap."""
        self.acknowledged = start - 1
        self.unacknowledged: deque[int] = deque()
        self.state = WriterState.WAITING
        self.wanted: dict[tuple[int, int], None] = {}
        """Numbers with fragments (0: all of it) that it has asked for, in this order."""
        self.serials = Serials(), Serials()
        """The serials of its ACKNACKs and NACK_FRAGs."""
        self.pause_ns = _FIRST_PAUSE_NS
        self.due_ns = 0
        self.rests_until_ns = 0
        self.heartbeats = floor
        """The serial of the last heartbeat to it."""
        self.hushed_ns = 0
        """Until then, no request for a heartbeat is answered."""
        self.offer_from_ns = 0
        """The earliest time at which all samples are offered to it again."""
        self.has_answered = False

    def on(self, event: WriterEvent) -> None:
        self.state = WRITER_TRANSITIONS[self.state][event]


class Writer:
    """One writer of our participant.

    `fragment_bytes`: longer samples are sent in fragments of this size. `on_restart` is called with the GUID
    of a reader that has lost samples that it had acknowledged: remove it then. None: it may ask for it again.
    """

    def __init__(
        self,
        entity: bytes,
        send: Send,
        keeping: Keeping = USUAL,
        *,
        fragment_bytes: int = 60_000,
        on_restart: Callable[[bytes], object] | None = None,
    ) -> None:
        self.entity = entity
        self.last = 0
        """The number of the last sample."""
        self.lost = 0
        """Samples that were dropped before all readers had acknowledged them."""
        self.waiting = 0
        """Samples that not all readers have acknowledged."""
        self.waiting_bytes = 0
        self.repaired = 0
        """Samples and fragments that were sent once more."""
        self._send = send
        self._keeping = keeping
        self._fragment_bytes = fragment_bytes
        self._on_restart = on_restart
        self._readers: dict[bytes, _Far] = {}
        self._floor = 0
        """The highest serial of heartbeats to removed readers: a reader that is back may remember it."""
        self._kept: dict[int, Change] = {}
        self._kept_bytes = 0

    @property
    def readers(self) -> list[bytes]:
        """GUIDs of the matched readers."""
        return list(self._readers)

    @property
    def kept(self) -> int:
        """The number of kept samples."""
        return len(self._kept)

    @property
    def kept_bytes(self) -> int:
        return self._kept_bytes

    @property
    def due_ns(self) -> int | None:
        """When `act` is due; None: not before something happens."""
        due = [far.due_ns for far in self._readers.values() if far.state is not WriterState.QUIET]
        return min(due, default=None)

    def has_answered(self, guid: bytes) -> bool:
        """Whether that reader has acknowledged anything, and so knows this writer."""
        far = self._readers.get(guid)
        return far is not None and far.has_answered

    def is_known_to(self, guid: bytes) -> bool:
        """Whether that reader is matched and knows this writer, as far as can be known: it has acknowledged
        anything, or it never does (best effort)."""
        far = self._readers.get(guid)
        return far is not None and (far.has_answered or not far.reliable)

    def acknowledged(self, guid: bytes) -> int:
        """Up to which number the reader has everything; 0 if it is not matched."""
        far = self._readers.get(guid)
        return 0 if far is None else far.acknowledged

    def ask(self, guid: bytes, now_ns: int) -> bool:
        """Ask that reader for an acknowledgment; returns False if it sends none."""
        far = self._readers.get(guid)
        if far is None or not far.reliable:
            return False
        self._beat(far, now_ns)
        return True

    def add_reader(self, guid: bytes, now_ns: int, *, reliable: bool = True) -> None:
        """Match a far reader. With samples for late joiners, it gets them now."""
        if guid in self._readers:
            return
        stays = self._keeping.for_late_joiners
        start = 1 if stays else self.last + 1
        far = self._readers[guid] = _Far(
            guid, start, start - 1 if stays else 0, self._floor, reliable=reliable
        )
        if not reliable:
            far.state = WriterState.QUIET
        for change in list(self._kept.values()) if stays else ():
            if change.stays:
                self._expect(far, change)
                self._push(far, change, now_ns)
        if reliable:
            self._beat(far, now_ns)

    def remove_reader(self, guid: bytes) -> None:
        far = self._readers.pop(guid, None)
        if far is not None:
            self._floor = max(self._floor, far.heartbeats)
            for number in far.unacknowledged:
                self._settle(number, guid)

    def write(
        self,
        payload: bytes | None,
        now_ns: int,
        time_ns: int,
        *,
        inline: bytes = b"",
        to: bytes | None = None,
        stays: bool = True,
    ) -> int:
        """Write a sample; returns its number.

        `time_ns`: its time of publication, wall clock. `to`: the only reader that gets it. `stays` False: not
        for late joiners.
        """
        self.last += 1
        stays = stays and self._keeping.for_late_joiners
        change = Change(self.last, payload, inline, to, time_ns, stays, set())
        readers = [far for far in self._readers.values() if to is None or to == far.guid]
        for far in readers:
            self._expect(far, change)
        if change.waits_for or stays:
            self._keep(change)
        for far in readers:
            self._push(far, change, now_ns)
        return change.number

    def withdraw(self, number: int) -> None:
        """Forget a sample: it has no meaning any more for a reader that did not get it."""
        if number in self._kept:
            self._drop(self._kept[number])

    def acknowledge(self, guid: bytes, acknack: AckNack, now_ns: int) -> None:
        """Handle an ACKNACK of that reader."""
        far = self._readers.get(guid)
        if far is None or not far.reliable or far.serials[0].judge(acknack.serial, now_ns) is Serial.OLD:
            return
        far.has_answered = True
        upto = min(acknack.base - 1, self.last)
        if upto > far.acknowledged:
            far.acknowledged = upto
            far.pause_ns = _FIRST_PAUSE_NS
            while far.unacknowledged and far.unacknowledged[0] <= upto:
                self._settle(far.unacknowledged.popleft(), guid)
            far.wanted = {key: None for key in far.wanted if key[0] > upto}
        elif max(upto, 0) < far.acknowledged:
            if self._on_restart is not None:
                self._on_restart(guid)
                return
            if self._keeping.for_late_joiners and now_ns >= far.offer_from_ns:
                self._offer_again(far, max(upto, 0), now_ns)
        for number in acknack.missing:
            change = self._kept.get(number)
            if change is not None and guid in change.waits_for:
                self._want(far, number, 0)
        self._send_gaps(far, acknack.missing)
        self._serve(far, now_ns)
        is_asked = not acknack.is_final and not acknack.missing
        if (is_asked or any(number < far.first for number in acknack.missing)) and now_ns >= far.hushed_ns:
            far.hushed_ns = now_ns + _FIRST_PAUSE_NS
            self._beat(far, now_ns)

    def request_fragments(self, guid: bytes, nack: NackFragments, now_ns: int) -> None:
        """Handle a NACK_FRAG of that reader."""
        far = self._readers.get(guid)
        if far is None or not far.reliable or far.serials[1].judge(nack.serial, now_ns) is Serial.OLD:
            return
        change = self._kept.get(nack.number)
        if change is None or change.payload is None or guid not in change.waits_for:
            return
        fragments = -(-len(change.payload) // self._fragment_bytes)
        for fragment in nack.missing:
            if 1 <= fragment <= fragments:
                self._want(far, nack.number, fragment)
        self._serve(far, now_ns)

    def act(self, now_ns: int) -> None:
        """Send what is due: heartbeats, and repairs that had to wait."""
        for far in list(self._readers.values()):
            if far.state is WriterState.QUIET or far.due_ns > now_ns:
                continue
            if far.state is WriterState.REPAIRING:
                self._serve(far, now_ns)
            else:
                self._beat(far, now_ns)

    def _offer_again(self, far: _Far, upto: int, now_ns: int) -> None:
        """The reader has forgotten this writer, and acknowledges less than before: it may ask for all kept
        samples again. At most once in `_LONGEST_PAUSE_NS`."""
        far.offer_from_ns = now_ns + _LONGEST_PAUSE_NS
        far.acknowledged = upto
        for change in self._kept.values():
            if change.stays and change.number > upto:
                self._wait_for(far, change)
        far.unacknowledged = deque(number for number, one in self._kept.items() if far.guid in one.waits_for)
        if far.unacknowledged:
            far.on(WriterEvent.WRITE)

    def _want(self, far: _Far, number: int, fragment: int) -> None:
        if len(far.wanted) < _MOST_WANTED:
            far.wanted[number, fragment] = None

    def _serve(self, far: _Far, now_ns: int) -> None:
        """Repair if the last repair is some time ago, and update the state."""
        if far.wanted:
            far.on(WriterEvent.REQUEST)
            far.due_ns = far.rests_until_ns
            if now_ns >= far.rests_until_ns:
                self._repair(far, now_ns)
        elif not far.unacknowledged and far.has_answered:
            far.on(WriterEvent.CATCH_UP)
        elif far.state is WriterState.REPAIRING:
            far.on(WriterEvent.REPAIR)
            far.due_ns = now_ns + far.pause_ns

    def _repair(self, far: _Far, now_ns: int) -> None:
        room = _REPAIR_BYTES
        while far.wanted and room > 0:
            number, fragment = next(iter(far.wanted))
            del far.wanted[number, fragment]
            change = self._kept.get(number)
            if change is None or far.guid not in change.waits_for:
                continue
            size = len(change.payload or b"")
            if fragment:
                self._send(far.guid, [write_time(change.time_ns), self._fragment(far, change, fragment)])
                size = min(size, self._fragment_bytes)
            else:
                self._transmit(far, change)
            self.repaired += 1
            room -= size + 100
        far.rests_until_ns = now_ns + _REST_NS
        if far.wanted:
            far.due_ns = far.rests_until_ns
        else:
            far.on(WriterEvent.REPAIR)
            self._beat(far, now_ns)

    def _push(self, far: _Far, change: Change, now_ns: int) -> None:
        """Send a new sample to a reader, and first a gap for numbers that are not for it."""
        if change.number > far.told + 1:
            first = far.told + 1
            self._send(far.guid, [write_gap(far.guid[PREFIX_BYTES:], self.entity, first, change.number)])
        far.told = change.number
        self._transmit(far, change)
        if far.reliable:
            far.pause_ns = _FIRST_PAUSE_NS
            self._beat(far, now_ns)

    def _expect(self, far: _Far, change: Change) -> None:
        """A reliable reader has to acknowledge a sample."""
        if far.reliable:
            self._wait_for(far, change)
            far.unacknowledged.append(change.number)
            far.on(WriterEvent.WRITE)

    def _wait_for(self, far: _Far, change: Change) -> None:
        if not change.waits_for:
            self.waiting += 1
            self.waiting_bytes += len(change.payload or b"")
        change.waits_for.add(far.guid)

    def _waits_no_more(self, change: Change) -> None:
        self.waiting -= 1
        self.waiting_bytes -= len(change.payload or b"")

    def _transmit(self, far: _Far, change: Change) -> None:
        payload, reader = change.payload, far.guid[PREFIX_BYTES:]
        time = write_time(change.time_ns)
        if payload is None or len(payload) <= self._fragment_bytes:
            data = write_data(reader, self.entity, change.number, payload, change.inline)
            self._send(far.guid, [time, data])
            return
        for fragment in range(1, -(-len(payload) // self._fragment_bytes) + 1):
            self._send(far.guid, [time, self._fragment(far, change, fragment)])

    def _fragment(self, far: _Far, change: Change, fragment: int) -> bytes:
        assert change.payload is not None
        return write_fragment(
            far.guid[PREFIX_BYTES:],
            self.entity,
            change.number,
            fragment,
            self._fragment_bytes,
            change.payload,
            change.inline,
        )

    def _beat(self, far: _Far, now_ns: int) -> None:
        """Send a heartbeat that asks for an answer; the next one comes later."""
        far.heartbeats += 1
        reader, serial = far.guid[PREFIX_BYTES:], far.heartbeats
        self._send(
            far.guid, [write_heartbeat(reader, self.entity, far.first, self.last, serial, is_final=False)]
        )
        if far.state is not WriterState.REPAIRING:
            far.due_ns = now_ns + far.pause_ns
        far.pause_ns = min(2 * far.pause_ns, _LONGEST_PAUSE_NS)

    def _send_gaps(self, far: _Far, missing: Sequence[int]) -> None:
        """Tell a reader which of the numbers that it asks for, and of the next ones, are not for it."""
        parts: list[bytes] = []
        end = 0
        for number in missing:
            if not max(end, far.first) <= number <= self.last:
                continue
            end = next((one for one in far.unacknowledged if one >= number), self.last + 1)
            if number < end and len(parts) < _MOST_GAPS:
                parts.append(write_gap(far.guid[PREFIX_BYTES:], self.entity, number, end))
        if parts:
            self._send(far.guid, parts)

    def _keep(self, change: Change) -> None:
        self._kept[change.number] = change
        self._kept_bytes += len(change.payload or b"")
        keeping = self._keeping
        while len(self._kept) > keeping.changes or self._kept_bytes > keeping.payload_bytes:
            oldest = next(iter(self._kept.values()))
            self.lost += bool(oldest.waits_for)
            self._drop(oldest, is_lost=True)

    def _drop(self, change: Change, *, is_lost: bool = False) -> None:
        del self._kept[change.number]
        self._kept_bytes -= len(change.payload or b"")
        if change.waits_for:
            self._waits_no_more(change)
        for guid in change.waits_for:
            far = self._readers[guid]
            far.unacknowledged.remove(change.number)
            if is_lost:
                far.first = change.number + 1
            if not far.unacknowledged and not far.wanted and far.has_answered:
                far.on(WriterEvent.CATCH_UP)
        change.waits_for.clear()

    def _settle(self, number: int, guid: bytes) -> None:
        """That reader needs a sample no more."""
        change = self._kept.get(number)
        if change is not None and guid in change.waits_for:
            change.waits_for.remove(guid)
            if not change.waits_for:
                self._waits_no_more(change)
                if not change.stays:
                    self._drop(change)
