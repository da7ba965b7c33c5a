"""Sends a publisher's samples through shared memory: its ring, the ring's growth, and its readers.

Decides when the ring grows, when it gives up depth, and which readers to wait for. A sample is written once,
for any number of readers. Used only on the event loop's thread.
"""

from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Sequence
from errno import EMFILE
from heapq import heappop, heappush
from typing import ClassVar

from bus import shm
from bus.base.descriptor import Descriptor
from bus.delivery.match import STALE, Gate, GateEvent, GateState
from bus.delivery.port import RETURN_S, Owner, Port, ReaderProcess, ShmPort, Timer
from bus.delivery.ring_size import (
    EARLY,
    FIRST_CAPACITY,
    FIRST_INDEX,
    FOR_EVER,
    LAP_S,
    RingSize,
    is_filled_by_few,
    laps_slowly,
)
from bus.errors import PayloadTooLarge, SharedMemoryError
from bus.logger import Logger, get_logger
from bus.qos import Durability, History, Liveliness, QoSProfile
from bus.shm import segments
from bus.shm.openfiles import check_room
from bus.transport.memory import LARGE_BYTES
from bus.types.large_fields import LONG_TEXT
from bus.wire import messages as m
from bus.wire.runs import Buffer
from bus.wire.session import MISSING

_FORGET_S = 1.0

_log = get_logger("bus")


class Gates:
    """The matches of a publisher by its ring, and the records that the ring must keep for them.

    `writer` writes the ring. After each change, the caller passes the new limits to it by `apply`.
    """

    def __init__(self, port: Port, owner: Owner, writer: "shm.native.Writer") -> None:
        qos = owner.qos
        keeps_all = qos.history is History.KEEP_ALL
        self._port = port
        self._owner = owner
        self._writer = writer
        self.is_lossless = qos.is_lossless
        """Whether the publisher waits for its lossless matches."""
        self.by_gid: dict[bytes, Gate] = {}
        self.depth = 1 if keeps_all else qos.depth
        """The publisher's own depth."""
        self._keeps_history = keeps_all and qos.durability is Durability.TRANSIENT_LOCAL
        self._depths: Counter[int] = Counter()
        """The matches' depths, each with its number of matches: a change needs no scan of thousands."""
        self._unattached: dict[int, Gate] = {}  # by key
        self.expected: set[int] = set()
        """The broker's numbers of the subscriptions that can't be woken yet: their readers have not named
        their slots."""
        self._holds: list[tuple[int, int]] = []
        """The lossless gates that are not attached: a heap of (hold, key)."""
        self._left: dict[tuple[ReaderProcess, int], Gate] = {}
        """Gates of ended matches, by slot; their readers may still pin records."""
        self._here: set[bytes] = set()
        """The matches with subscriptions of this event loop."""
        self.known_seq = 0
        """All matches that begin up to this number are known.

        A lossless publisher's ring keeps all later records.
        """
        self._forget: Timer | None = None
        writer.hold, writer.keep = int(self.is_lossless), self.keep  # as `apply`: no match is known yet

    @property
    def is_read_here(self) -> bool:
        """Whether a subscription of this event loop reads the ring."""
        return bool(self._here)

    @property
    def keep(self) -> int:
        """Records that must stay: the largest depth."""
        return FOR_EVER if self._keeps_history else max(self.depth, *self._depths, 1)

    def apply(self, *, keeps_all: bool) -> None:
        """Make the writer keep the needed records; `keeps_all`: it must reuse no record for now."""
        holds, unattached = self._holds, self._unattached
        while holds and not ((gate := unattached.get(holds[0][1])) and gate.is_lossless):
            heappop(holds)
        first = holds[0][0] if holds else FOR_EVER
        if self.is_lossless:
            first = min(first, self.known_seq + 1)
        self._writer.hold = 0 if first == FOR_EVER else first
        self._writer.keep = FOR_EVER if keeps_all else self.keep

    def find(self, gid: bytes, other: int) -> Gate | None:
        """The match of `gid`, if its other end has the number `other` (0: any)."""
        gate = self.by_gid.get(gid)
        return gate if gate is not None and other in (0, gate.matched.other) else None

    def dead(self) -> list[bytes]:
        """Matches that no broker reports, and with a process that has ended."""
        return [
            gid
            for gid, gate in self.by_gid.items()
            if gate.state in STALE and gate.place is not None and not gate.place[0].is_alive()
        ]

    def stale(self) -> list[bytes]:
        """Matches that the present broker has not made."""
        return [gid for gid, gate in self.by_gid.items() if gate.state in STALE]

    # --- changes of matches

    def add(self, matched: m.Matched) -> None:
        """Add a match that the broker makes, for the first time or again."""
        gate = self.by_gid.get(matched.gid)
        if gate is not None and gate.state not in STALE:
            # Two endpoints claim one gid. Brokers don't check that, so the newer match counts.
            self.remove(matched.gid, is_lost=True)
            gate = None
        if gate is None:
            gate = Gate(self._owner, matched, self._writer.seq_since(matched.at_ns))
            gate.on(GateEvent.MATCH)
            self.by_gid[matched.gid] = self._unattached[gate.key] = gate
            if gate.is_lossless:
                heappush(self._holds, (gate.hold, gate.key))
        else:
            gate.on(GateEvent.MATCH)
            self._forget_depth(gate)
            gate.matched = matched
            if self.is_lossless and matched.qos.is_lossless:
                self.set_lossless(matched.gid, is_on=True)  # it is back
        if gate.state is GateState.EXPECTED:
            self.expected.add(matched.other)
        self._depths[gate.depth] += 1

    def attach(self, gid: bytes, process: ReaderProcess, slot: int) -> None:
        """Attach the reader of a match, which names its slot."""
        gate = self.by_gid[gid]
        gate.on(GateEvent.ATTACH)
        place, first_key = (process, slot), gate.key
        if gate.place != place:  # else it continued to read while busd was away
            before = self._left.pop(place, None)
            if before is not None:
                before.on(GateEvent.FORGET)
                gate.key = before.key  # the reader is back, and may have pins: its old gate continues
            self._writer.add_gate(gate.key, process.bell, slot, is_lossless=gate.is_lossless)
            gate.place = place
        self._unattached.pop(first_key, None)
        self.expected.discard(gate.matched.other)
        if process.is_here:
            self._here.add(gid)

    def remove(self, gid: bytes, *, is_lost: bool) -> None:
        """Remove an ended match: the publisher no longer waits for it. `forget_left` frees its slot.

        `is_lost`: its reader may live, and read and pin until its process ends.
        """
        gate = self.by_gid[gid]
        gate.on(GateEvent.LOSE if is_lost else GateEvent.UNMATCH)
        del self.by_gid[gid]
        self._forget_depth(gate)
        self._unattached.pop(gate.key, None)
        self.expected.discard(gate.matched.other)
        self._here.discard(gid)
        if gate.place is not None:
            self._left[gate.place] = gate
            self._writer.make_lossy(gate.key)
            self._forget_later(0)  # one scan for all matches that end at once

    def disconnect(self) -> None:
        """Note that the broker is gone."""
        self.expected.clear()  # their numbers are the old broker's
        for gate in self.by_gid.values():
            gate.on(GateEvent.DISCONNECT)

    def set_lossless(self, gid: bytes, *, is_on: bool) -> None:
        """Set whether the publisher waits for a match."""
        gate = self.by_gid.get(gid)
        if gate is None or gate.is_lossless is is_on:
            return
        gate.is_lossless = is_on
        if gate.place is None and is_on:
            heappush(self._holds, (gate.hold, gate.key))
        elif gate.place is not None and is_on:
            process, slot = gate.place
            self._writer.add_gate(gate.key, process.bell, slot, is_lossless=True)
        elif gate.place is not None:
            self._writer.make_lossy(gate.key)

    def make_all_lossy(self) -> None:
        """Stop waiting for matches."""
        for gate in self.by_gid.values():
            self._writer.make_lossy(gate.key)
            gate.is_lossless = False
        self._holds.clear()

    def forget_left(self) -> None:
        """Drop left gates that hold nothing any more; a process that has ended holds nothing."""
        is_alive: dict[ReaderProcess, bool] = {}
        for place, gate in tuple(self._left.items()):
            process, _ = place
            holds = gate.state is GateState.LOST or self._writer.has_pins(gate.key)
            if holds and process not in is_alive:
                is_alive[process] = process.is_alive()
            if not holds or not is_alive[process]:
                gate.on(GateEvent.FORGET)
                self._writer.remove_gate(gate.key)
                del self._left[place]
        self._forget_later(_FORGET_S)

    def clear(self) -> None:
        """Forget all matches, because the ring is closed."""
        self.by_gid.clear()
        self._unattached.clear()
        self.expected.clear()
        self._left.clear()
        if self._forget is not None:
            self._forget.cancel()

    def _forget_later(self, seconds: float) -> None:
        if self._forget is not None:
            self._forget.cancel()
        self._forget = None
        if self._left:
            self._forget = self._port.later(seconds, self.forget_left)

    def _forget_depth(self, gate: Gate) -> None:
        self._depths[gate.depth] -= 1
        if not self._depths[gate.depth]:
            del self._depths[gate.depth]


class ShmSender:
    """Makes and writes the ring of `owner`. Raises OSError if memory or descriptors are lacking."""

    _early: ClassVar[int] = 0  # senders of this process that grew at their first match

    def __init__(self, port: Port, shm_context: ShmPort, owner: Owner) -> None:
        qos = owner.qos
        self._port = port
        self._shm_context = shm_context
        self._owner = owner
        self._size = RingSize(port.now_ns, keeps_all=qos.history is History.KEEP_ALL)
        self.descriptor, memory = segments.make_ring(FIRST_CAPACITY, FIRST_INDEX, 1)
        self._announced: Descriptor | None = None
        self.writer = shm.native.Writer(memory, qos.depth if qos.history is History.KEEP_LAST else 1)
        self.gates = Gates(port, owner, self.writer)
        self.writer.is_report_due = False
        if port.is_shared:
            self.writer.is_mine = port.owns_thread
        support = owner.support
        self.writer.prepare(*support.steps)
        if support.text_fields:
            self.writer.longest = LONG_TEXT
        self.writer.most_long = LARGE_BYTES
        # Long bytes fields must not be encoded with the rest. Only a plan finds them.
        self.writer.plans_only = bool(support.bytes_fields)
        self.can_publish = not support.bytes_fields or support.plan is not None
        self._return: Timer | None = None
        self._rest: Timer | None = None  # while it runs, laps of the first ring don't matter
        self._why_not = ""  # reason of the last failed growth
        self._is_early = False

    @classmethod
    def make(cls, port: Port, owner: Owner, logger: Logger) -> "ShmSender | None":
        """Make the sender. None if memory is not shared, or if none is left; the log reports the latter."""
        if port.shm_context is None:
            return None
        try:
            check_room()
            return cls(port, port.shm_context, owner)
        except OSError as error:
            if error.errno == EMFILE:  # all later publishers will fail, too
                text = f"publishers go by socket, '{owner.topic_name}' first: {error.strerror}"
                _log.warning(text, once=True)
                return None
            logger.warning(f"'{owner.topic_name}' goes by socket: no shared memory: {error.strerror}")
            return None

    def announce(self) -> Descriptor:
        """The ring's descriptor, which the caller sends to the broker."""
        self._announced = self.descriptor
        return self.descriptor

    # --- samples

    def put(self, parts: Sequence[Buffer | str], stamp_ns: int) -> bool:
        """Write a sample, given in parts, and grow if necessary; False if lossless readers must read first.

        Raises SharedMemoryError if the ring can't be made large enough.
        """
        writer = self.writer
        may_force = False
        while (status := writer.write_parts(parts, force=may_force, stamp_ns=stamp_ns)) is not True:
            if status == shm.native.REPORT_DUE:
                break
            if status in (shm.native.HELD, shm.native.FULL):
                if not self.make_way(status):
                    return False
            else:
                may_force = self._make_larger(sum(map(len, parts)), status)
        self._written(status)
        return True

    def lend(self, size: int) -> memoryview | None:
        """Lend a place for a sample; None if `put` would return False. Raises SharedMemoryError, too."""
        may_force = False
        while True:
            place = self.writer.lend(size, force=may_force)
            if isinstance(place, memoryview):
                return place
            if place in (shm.native.HELD, shm.native.FULL):
                if not self.make_way(place):
                    return None
            else:
                may_force = self._make_larger(size, place)

    def publish_lent(self) -> None:
        """Publish the lent place. Raises PayloadTooLarge if a new broker has a lower limit."""
        status = self.writer.publish_lent()
        if status == shm.native.TOO_LARGE:
            raise self._too_large(len(self.writer.lent()))
        self._written(status)

    def make_way(self, status: int) -> bool:
        """After FULL or HELD: make room, if possible. Returns whether to try again now."""
        if status == shm.native.HELD:
            self._move_known()
            return True
        return self._make_way()

    def _make_larger(self, size: int, status: int) -> bool:
        """Grow for a message of `size` bytes; returns whether depth must be given up instead."""
        if size > self.writer.most:  # the limit of a new broker
            raise self._too_large(size)
        if status == shm.native.SHORT and self._watches_laps:
            # The ring already keeps the depth: a larger ring would only reuse records later.
            if laps_slowly(self.writer, self._port.now_ns()) or not self._grow(size, must=False):
                self._rest = self._port.later(LAP_S, self._watch_laps)
                self._set_hold()
            return False
        if self._grow(size, must=status != shm.native.SHORT):
            return False
        if status == shm.native.SHORT:
            return True
        raise SharedMemoryError(
            f"no shared memory for a message of {size} bytes on '{self._owner.topic_name}': {self._why_not}"
        )

    def _too_large(self, size: int) -> PayloadTooLarge:
        return PayloadTooLarge(self._owner.topic_name, size_bytes=size, limit_bytes=self.writer.most)

    def _make_way(self) -> bool:
        """Deal with readers that hold unread records. Returns whether to try again now."""
        writer = self.writer
        if self._move_known():
            return True
        if self.gates.is_lossless:
            # Don't grow without a broker: readers would not learn of the new ring, and the present one would
            # stay full.
            return bool(self._owner.id) and is_filled_by_few(writer) and self._grow(0, must=False)
        # Keep last, and a subscription that keeps all: take more memory, and lose samples if none is left.
        if self._grow(0, must=False):
            return True
        self.gates.make_all_lossy()
        self._set_hold()
        return True

    def _move_known(self) -> bool:
        """Stop holding records for unknown matches, up to `latest`. Returns whether that changed anything."""
        latest = self.writer.latest
        if not self.gates.is_lossless or self.gates.known_seq == latest or not self._port.is_quiet():
            return False
        # All matches made so far are known here; later ones start after `latest`.
        self.gates.known_seq = latest
        self._set_hold()
        return True

    def wait_for_room(self, on_room: Callable[[], None]) -> bool:
        """After `put` returned False: call `on_room` when there may be room.

        Returns False if the caller should try again after a turn of the loop, which reads the broker's
        messages.
        """
        # Don't wait while records are held for unknown matches: when the hold ends, readers that have taken
        # everything would not ring.
        if not self._port.is_quiet() or self._move_known():
            return False
        if not self.writer.wait_for_room():
            self._shm_context.wake_waiting(self)  # other waiting writers get no ring any more
            return False

        def on_wake() -> None:
            self._shm_context.stop_waiting(self)
            self.writer.woken()
            on_room()

        self._shm_context.wait_for_room(self, on_wake)
        return True

    # --- readers

    def expect(self, matched: m.Matched) -> None:
        """Add a match by this route, and hold the records for its reader until it names its slot."""
        is_small = self._watches_laps and not self.writer.is_lent
        if is_small and ShmSender._early < EARLY and self._grow(0, must=True):
            # Growth now delays nothing. Later, busd may be slow or gone, and readers would wait for it.
            self._is_early = True
            ShmSender._early += 1
        self.gates.add(matched)
        self._set_hold()

    def attach(self, gid: bytes, attached: m.Attached, descriptors: tuple[Descriptor, ...]) -> None:
        """Attach the reader of a match, which names its slot.

        Raises OSError or ValueError with the fault of its descriptors.
        """
        if self.gates.find(gid, attached.subscription) is None:
            return  # the match is gone again, or another match has its gid now
        if len(descriptors) != attached.descriptors:
            raise OSError(MISSING)
        segment, doorbell = descriptors
        process = self._shm_context.reader_process(segment, doorbell, attached.pid)
        self.gates.attach(gid, process, attached.slot)
        self._set_hold()

    def unmatched(self, gid: bytes, other: int = 0, *, is_lost: bool = False) -> None:
        """Remove a match, if its other end has the number `other` (0: any).

        `is_lost`: its reader may live, and read and pin until its process ends.
        """
        if self.gates.find(gid, other) is None:
            return
        self.gates.remove(gid, is_lost=is_lost)
        self._set_hold()

    def set_waiting(self, gid: bytes, *, is_on: bool) -> None:
        """Set whether to wait for a lossless match; the broker turns it off while its process is silent."""
        self.gates.set_lossless(gid, is_on=is_on)
        self._set_hold()

    def missed(self, qos: QoSProfile, since_ns: int) -> list[tuple[int, int, bytes]]:
        """Number, stamp and payload of all samples for a match made at `since_ns`, history included."""
        own, since = self._owner.qos, self.writer.since
        if Durability.VOLATILE in (own.durability, qos.durability):
            return since(since_ns)
        samples = since(0)
        depth = min((one.depth for one in (own, qos) if one.history is History.KEEP_LAST), default=FOR_EVER)
        first_new = bisect_left(samples, since_ns, key=lambda sample: sample[1])
        return samples[max(0, first_new - depth) :]

    def disconnected(self) -> None:
        """Note that the broker is gone. Readers continue, and the next broker matches them again."""
        if self._return is not None:
            self._return.cancel()
        self.gates.disconnect()
        self._set_hold()

    def declared(self, answer: m.Created) -> None:
        """Note the broker's answer to the declaration. A reader not back after RETURN_S counts as gone."""
        self.gates.depth = answer.depth or 1
        self._size.allow(answer.ring_bytes)
        self.writer.most = answer.max_message_bytes
        if self._announced is not self.descriptor:  # it grew before the broker knew the publisher
            self._port.send_about(self._owner, m.ReplaceRing(publisher=self._owner.id), (self.announce(),))
        self._set_hold()
        if self.gates.by_gid:
            self._return = self._port.later(RETURN_S, self._drop_stale)

    def drop_dead_readers(self) -> bool:
        """Stop waiting for ended processes that no broker reports; returns whether there were any."""
        gone = self.gates.dead()
        for gid in gone:
            self.unmatched(gid)
        return bool(gone)

    def close(self) -> None:
        """Give up the ring; readers read it to its end."""
        self.gates.clear()
        ShmSender._early -= self._is_early
        self._shm_context.stop_waiting(self)
        for timer in (self._return, self._rest):
            if timer is not None:
                timer.cancel()

    # --- inside

    def _written(self, status: bool | int) -> None:
        if status is not True:  # for the first time since the counters were reported
            self._port.report(self._owner)
        # The broker does not see samples in the ring.
        if self._owner.qos.liveliness is Liveliness.MANUAL_BY_TOPIC:
            self._port.send_about(self._owner, m.AssertLiveliness(publisher=self._owner.id))

    def _drop_stale(self) -> None:
        if self._owner.id:
            for gid in self.gates.stale():
                self.unmatched(gid, is_lost=True)
                self._shm_context.wake_waiting(self)

    def _set_hold(self) -> None:
        self.gates.apply(keeps_all=self._watches_laps)

    @property
    def _watches_laps(self) -> bool:
        """Whether this is the first ring, to be replaced when its records go round quickly.

        False without a broker: readers would not learn of another ring.
        """
        return self.writer.capacity == FIRST_CAPACITY and self._rest is None and bool(self._owner.id)

    def _watch_laps(self) -> None:
        self._rest = None
        self._set_hold()

    def _grow(self, size: int, *, must: bool) -> bool:
        """Continue in a larger ring, with room for a message of `size` bytes; returns whether it was made.

        `must`: the ring may exceed the limit, which only applies to growth for depth.
        """
        writer = self.writer
        sizes = self._size.larger(writer, size, self.gates.keep, must=must)
        if sizes is None:
            return False
        self.gates.forget_left()
        try:
            descriptor, memory = segments.make_ring(*sizes, writer.carry_from(FOR_EVER))
            writer.move(memory)
        except (OSError, ValueError) as error:
            self._size.failed()
            self._why_not = (error.strerror if isinstance(error, OSError) else None) or str(error)
            text = (
                f"the ring of '{self._owner.topic_name}' can't grow to {sizes[0] >> 10} KiB: {self._why_not}"
            )
            _log.warning(text, throttle_duration_sec=5.0)
            return False
        self.descriptor = descriptor
        self._set_hold()
        self._shm_context.wake_waiting(self)
        if self._owner.id:
            self._port.send_about(self._owner, m.ReplaceRing(publisher=self._owner.id), (self.announce(),))
        return True
