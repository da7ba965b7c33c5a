"""The way of a publisher's samples through the broker: gathered into runs, queued, held back by credit.

A sample leaves at once, but where the one before left a moment ago: then it is gathered with those that
follow into a run, which leaves when it is full or when the turn of the event loop ends. So a paced publisher
has the latency of one system call, and a flood its throughput. Does not know messages, only their encoding.

What a lossless subscription may not have taken yet is kept, in case its connection or the broker is lost.
A lost subscription has a place here for a while: no credit beyond it is used until the subscription is back
and was sent what it has missed, to it alone. After a restart of the broker nothing new is sent before all are
back or time is up. Other reliable subscriptions are waited for, too, for a shorter time and while a depth has
room: so nothing is lost when busd restarts and the publisher is back first.
"""

from collections import deque
from collections.abc import Callable
from typing import TypeAlias

from bus.delivery.allowance import STEP_BYTES, begin, extend
from bus.delivery.open_run import open_run
from bus.delivery.port import RETURN_S, Owner, Port, Timer
from bus.delivery.thread_queue import ThreadQueue
from bus.qos import Durability, History, QoSProfile, Reliability
from bus.wire import messages as m
from bus.wire.bounds import MOST_PLACES
from bus.wire.layout import (
    DATA_HEAD_BYTES,
    MAX_MESSAGE_BYTES,
    RECORD_HEAD,
    RECORD_HEAD_BYTES,
    REPLAY,
    RESUMED,
    RUN_BYTES,
)
from bus.wire.runs import UNBOUNDED, Account, Buffer, Run, RunQueue, data_head

QUEUE_BYTES = 64 << 20

_SHORT_RETURN_S = 1.0
"""As RETURN_S, for those that are not lossless."""

_GATHER_NS = 100_000
"""A message that follows the last one so soon is gathered with others."""

_GRACE_S = 0.1
"""A loop that stood still reads what came meanwhile before a place is given up."""

Sample: TypeAlias = tuple[int, int, bytes]
"""Number, stamp in ns, payload."""

_pack_record = RECORD_HEAD.pack


class _Place:
    """Where a lossless subscription that was lost will go on."""

    __slots__ = ("other", "seq", "timer")

    def __init__(self, seq: int, other: int, timer: Timer | None) -> None:
        self.seq = seq
        """It has taken all up to there."""
        self.other = other
        """The number that the present broker gave it; 0: an earlier broker."""
        self.timer = timer


class SocketSender:
    """Numbers the samples, unless `resume` sets the number.

    `owner` is the publisher that the port knows. `is_active`: samples are to go this way.
    """

    def __init__(self, port: Port, owner: Owner, from_threads: ThreadQueue) -> None:
        qos, is_lossless = owner.qos, owner.qos.is_lossless
        depth = 0 if qos.history is History.KEEP_ALL else qos.depth
        self._port = port
        self._owner = owner
        self._from_threads = from_threads
        self.is_active = True
        self._is_unread = False
        self.is_report_due = False
        """Else `hand_over` has the counters reported."""
        self.on_replaced: Callable[[int], object] = int
        """Called with the number of samples that the depth has replaced here."""
        self.queue = RunQueue(depth, Account(STEP_BYTES))
        self.keeps_history = qos.durability is Durability.TRANSIENT_LOCAL
        self._history = RunQueue(depth, Account(STEP_BYTES)) if self.keeps_history else None
        self._most_queued = QUEUE_BYTES
        self.next_seq = 1
        self.samples = 0
        self.bytes = 0
        self.replaced = 0
        self._is_resumed = False
        self.run = open_run()
        if port.is_shared:
            self.run.is_mine = port.owns_thread
        self.run.most = depth or UNBOUNDED
        self.add = self.run.add
        support = owner.support
        if not support.bytes_fields:  # a long one must not be encoded with the rest
            self.run.prepare(*support.steps)
        self.run.begin_by(self._begun, self.can_take if is_lossless else None)
        self.run.begins_below = RUN_BYTES
        self.max_bytes = MAX_MESSAGE_BYTES
        # Back-pressure: what was handed over and not yet taken by all.
        self._is_windowed = is_lossless
        self._window_samples = 0
        self._window_bytes = 0
        self._credited = 0
        self._level = 0  # the broker's last word about credit; places may hold back what is above them
        self._places: dict[bytes, _Place] = {}  # by the gid of the subscription
        self.on_place_gone: Callable[[], object] = int
        """Called when nothing is kept any more for a subscription that was lost."""
        self._flying_bytes = 0
        self._flying: deque[tuple[int, int]] = deque()
        # Handed over and perhaps not taken yet. With a history that alone serves a new broker.
        self._kept = RunQueue(0, Account(QUEUE_BYTES)) if is_lossless and not self.keeps_history else None
        self._is_awaiting = qos.reliability is Reliability.RELIABLE and not self.keeps_history
        self._keeps_some = is_lossless or self.keeps_history
        # Subscriptions by this route that are waited for, with whether they are lossless, and so for longer.
        self._takers: dict[int, tuple[bytes, bool]] = {}
        self._awaited: dict[bytes, bool] = {}  # those of them that a broker before had
        self._return: Timer | None = None

    def can_take(self, size: int) -> bool:
        """Whether the window has room for a sample of `size` bytes, before a keep-all subscription takes
        more.

        For a single one it always has, whatever its size. May be asked from any thread.
        """
        run = self.run
        if not self._is_windowed or (run.budget >= size + RECORD_HEAD_BYTES and run.samples < run.most):
            return True
        if not (self._flying or run.samples or self._from_threads.count):
            return True
        return self._room() >= size + RECORD_HEAD_BYTES

    def set_readers(self, *, are_there: bool) -> None:
        """Whether anybody reads what goes this way. Else it is for the history alone, which can wait until
        the turn of the loop ends: so that what follows goes with it."""
        is_unread = not are_there and not self._is_windowed
        if is_unread is not self._is_unread:
            self._is_unread = is_unread
            self.run.most = UNBOUNDED if is_unread else self.queue.depth or UNBOUNDED

    def put(self, payload: Buffer, stamp_ns: int) -> None:
        """Take a sample as the first of a new run."""
        self.hand_over()
        self.run.begin(payload, stamp_ns)
        self._begun(stamp_ns)

    def _begun(self, stamp_ns: int) -> None:
        """A run has its first sample, with this stamp: send it now, or gather it with those that follow."""
        port = self._port
        if self._is_unread or stamp_ns - port.last_sent_ns < _GATHER_NS:
            run, room = self.run, RUN_BYTES
            if self._is_windowed:
                room = self._room()
                run.most = run.samples + max(0, self._samples_left())
            run.budget = max(0, min(room, RUN_BYTES, self.max_bytes) - run.size)
            port.gather(self._owner)
        else:
            port.last_sent_ns = stamp_ns
            try:
                self.hand_over()
            except MemoryError:
                if not self.run.samples:
                    raise
                port.gather(self._owner)  # taken: it leaves with those that follow, or when the turn ends

    def skip(self, count: int) -> None:
        """Samples were replaced before they came here: leave a gap in the numbers for them."""
        if not count:
            return
        self.hand_over()
        self.next_seq += count
        self.samples += count
        self.replaced += count

    def resume(self, seq: int) -> None:
        """Take samples from number `seq` on, after those before went another way."""
        self.hand_over()
        if seq > self.next_seq:
            self.next_seq = seq
            self._is_resumed = True
            self.credit(seq - 1)
        self.is_active = True

    def catch_up(self, subscription: int, samples: list[Sample], *, since_ns: int) -> None:
        """Send samples to one subscription alone, which then gets what is sent to all.

        Those stamped before `since_ns` are history. Some may be on their way to all as well: the subscription
        recognizes them by their numbers.
        """
        owner, parts, size = self._owner, list[bytes](), 0
        for at, (seq, stamp_ns, payload) in enumerate(samples):
            parts += (_pack_record(len(payload), stamp_ns), payload)
            size += RECORD_HEAD_BYTES + len(payload)
            is_replay = stamp_ns < since_ns
            is_last = at + 1 == len(samples) or is_replay is not (samples[at + 1][1] < since_ns)
            if is_last or size >= RUN_BYTES:
                count = len(parts) // 2
                flags = REPLAY if is_replay else 0
                head = data_head(owner.id, seq + 1 - count, count, size, flags=flags, only_for=subscription)
                self._port.send_about(owner, head + b"".join(parts))
                parts.clear()
                size = 0
        self._port.send_about(owner, m.CaughtUp(publisher=owner.id, subscription=subscription))

    def hand_over(self) -> None:
        """End the open run and send it, or queue it where the broker does not take it now."""
        run, first_seq = self.run, self.next_seq
        samples, size = run.samples, run.size
        if not samples:
            return
        owner, is_resumed = self._owner, self._is_resumed
        frame = run.end(owner.id, first_seq, RESUMED if is_resumed else 0)
        self.next_seq += samples
        self.samples += samples
        self.bytes += size - samples * RECORD_HEAD_BYTES
        self._is_resumed = False
        if self._keeps_some:
            self._keep(Run(0, 0, first_seq, samples, memoryview(frame)[DATA_HEAD_BYTES:]))
        if (
            not owner.id
            or self.queue.runs
            or self._awaited
            # Nothing waits: past the queues, most of what one message costs at a moderate rate.
            or not self._port.send_now(frame)
        ):
            body = memoryview(frame)[DATA_HEAD_BYTES:]
            self._queue_run(Run(0, 0, first_seq, samples, body, is_resumed=is_resumed))
        if not self.is_report_due:
            self.is_report_due = True
            self._port.report(owner)

    def _keep(self, run: Run) -> None:
        """Keep of what is handed over what may be needed again."""
        if self._is_windowed:
            self._flying.append((self.next_seq - 1, len(run.body)))
            self._flying_bytes += len(run.body)
        if self._history is not None:
            self._history.push(run)
            extend(self._history, self._most_queued, is_lossless=self._is_windowed)
            self._history.drop_over_quota(spare=1)
        if self._kept is not None:
            self._kept.push(run)
            self._kept.drop_over_quota(spare=1)

    def credit(self, seq: int) -> None:
        """All that must acknowledge have taken everything up to `seq`."""
        self._level = seq
        if self._places:
            seq = min(seq, *[place.seq for place in self._places.values()])
        kept = self._kept
        while kept is not None and kept.runs and kept.runs[0].first_seq + kept.runs[0].count - 1 <= seq:
            kept.forget_head()
        self._forget_flying(seq)

    @property
    def places(self) -> tuple[bytes, ...]:
        """The gids of subscriptions that were lost, may come back, and are to miss nothing."""
        return tuple(self._places)

    def keep_place(self, other: int, keep_s: float) -> None:
        """A subscription was lost, and may be back within `keep_s`; 0: it will not be."""
        taker = self._takers.pop(other, None)
        if not keep_s:
            for gid in [gid for gid, place in self._places.items() if place.other == other]:
                self._forget_place(gid, self._places[gid])
        elif taker is not None and taker[1] and not self._is_matched(taker[0]):
            gid = taker[0]
            place = self._places[gid] = _Place(self._level, other, None)
            place.timer = self._port.later(keep_s, self._time_is_up, gid, place)
            self._bound_places()

    def _forget_flying(self, seq: int) -> None:
        """Take everything up to `seq` out of the window."""
        self._credited = max(self._credited, seq)
        while self._flying and self._flying[0][0] <= seq:
            self._flying_bytes -= self._flying.popleft()[1]

    def declared(self, answer: m.Created) -> None:
        """A broker knows the publisher now: send what waits."""
        self.max_bytes = answer.max_message_bytes
        self._most_queued = max(QUEUE_BYTES, answer.max_message_bytes + RUN_BYTES)
        self._window_samples = answer.window_samples
        self._window_bytes = answer.window_bytes
        self.run.most = UNBOUNDED if self._is_unread else answer.depth or UNBOUNDED
        self.run.begins_below = min(RUN_BYTES, self.max_bytes + 1)
        self.queue.set_depth(answer.depth)
        self.queue.endpoint = answer.id
        if self._history is not None:
            # What waits is the end of the history, so the history is all that a new broker needs.
            self.queue.clear()
            for run in self._history.newest(0, 0):
                run.is_replay = False
                self.queue.push(run)
            self.queue.account.limit = self._history.account.limit
        self._forget_flying(self.first_seq_to_send() - 1)
        for gid, place in self._places.items():
            place.timer = self._port.later(RETURN_S, self._time_is_up, gid, place)
        if self._awaited:
            self._return = self._port.later(_SHORT_RETURN_S, self._wait_for_lossless)
        elif self.queue.runs:
            self._port.make_ready(self.queue)

    def matched(
        self, other: int, gid: bytes, qos: QoSProfile, *, by_socket: bool, last_seq: int | None = None
    ) -> None:
        """A subscription is matched, by this route if it `by_socket`.

        `last_seq`: it was lost and is back, has had all up to there, and waits for what it has missed.
        """
        if not self._is_awaiting or qos.reliability is not Reliability.RELIABLE:
            return
        is_lossless = self._is_windowed and qos.is_lossless
        if last_seq is not None:
            if gid in self._places or self._is_matched(gid):
                self._repeat(other, last_seq)
            self._port.send_about(self._owner, m.CaughtUp(publisher=self._owner.id, subscription=other))
            self._level = min(self._level, last_seq)  # the broker's credit, too, goes on from there
        if by_socket:
            self._takers[other] = gid, is_lossless
        place = self._places.pop(gid, None)
        if gid in self._awaited and by_socket and is_lossless and last_seq is None:
            self._repeat(other, 0)
            if place is not None:  # until the new broker gives credit, what was sent again may not have come
                self._level = min(self._level, place.seq)
        if place is not None:
            _cancel(place)
            self.credit(self._level)
        if gid in self._awaited:
            del self._awaited[gid]
            if not self._awaited:
                self._go_on()

    def unmatched(self, other: int) -> None:
        self._takers.pop(other, None)

    def first_seq_to_send(self) -> int:
        """The number of the first sample that a new broker will get."""
        waiting = self._history if self._history is not None else self.queue
        return waiting.runs[0].first_seq + waiting.skipped if waiting.runs else self.next_seq

    def disconnected(self) -> None:
        self.queue.is_ready = False  # the outbox that it stood in is gone
        for gid, place in self._places.items():
            self._awaited[gid] = True
            place.other = 0
            _cancel(place)
        for gid, is_lossless in self._takers.values():
            self._awaited[gid] = is_lossless
            if is_lossless:
                self._places[gid] = _Place(self._level, 0, None)
        self._takers.clear()
        self._bound_places()
        self._stop_waiting()

    def drop_queued(self) -> int:
        """Give up what waits; returns how many samples."""
        lost = self.queue.clear()
        self.replaced += lost
        return lost

    def end(self) -> None:
        """Nothing more will be sent."""
        self.forget_open()
        self.queue.clear()
        for place in self._places.values():
            _cancel(place)
        self._places.clear()
        self._stop_waiting()

    @property
    def open_samples(self) -> int:
        """Samples of the run that is open; they are in no other count."""
        return self.run.samples

    @property
    def open_bytes(self) -> int:
        return self.run.size - self.run.samples * RECORD_HEAD_BYTES

    def forget_open(self) -> None:
        """Drop the open run, and begin no other here."""
        self.run.forget()
        self.run.begins_below = 0

    def _is_matched(self, gid: bytes) -> bool:
        """Whether a lossless subscription of that gid is matched, perhaps by its last connection."""
        return (gid, True) in self._takers.values()

    def _bound_places(self) -> None:
        while len(self._places) > MOST_PLACES:
            oldest = next(iter(self._places))
            self._forget_place(oldest, self._places[oldest])

    def _time_is_up(self, gid: bytes, place: _Place) -> None:
        place.timer = self._port.later(_GRACE_S, self._forget_place, gid, place)

    def _forget_place(self, gid: bytes, place: _Place) -> None:
        """The subscription was away too long, or will not be back."""
        if self._places.get(gid) is place:
            _cancel(place)
            del self._places[gid]
            self.credit(self._level)
            self.on_place_gone()

    def _repeat(self, subscription: int, last_seq: int) -> None:
        """Send it what is kept behind `last_seq` and was sent before: perhaps it was not passed on."""
        assert self._kept is not None
        first_seq = self.first_seq_to_send()
        for run in self._kept.runs:
            if run.first_seq >= first_seq:
                break
            if run.first_seq + run.count - 1 > last_seq:
                rest = run if run.first_seq > last_seq else run.after(last_seq)
                head = data_head(
                    self._owner.id, rest.first_seq, rest.count, len(rest.body), only_for=subscription
                )
                self._port.send_about(self._owner, head + rest.body)

    def _wait_for_lossless(self) -> None:
        """The others were away too long."""
        self._awaited = {gid: True for gid, is_lossless in self._awaited.items() if is_lossless}
        if self._awaited:
            self._return = self._port.later(RETURN_S - _SHORT_RETURN_S, self._go_on)
        else:
            self._go_on()

    def _go_on(self) -> None:
        """All are back, or were away too long: go on."""
        self._stop_waiting()
        self._awaited.clear()
        if self._owner.id and self.queue.runs:
            self._port.make_ready(self.queue)
            self._port.flush()
            self._port.wrote()

    def _stop_waiting(self) -> None:
        if self._return is not None:
            self._return.cancel()

    def _room(self) -> int:
        """Bytes that the window still has room for."""
        if self._samples_left() <= 0:
            return 0
        return self._window_bytes - self._flying_bytes - self.open_bytes - self._from_threads.held_bytes

    def _samples_left(self) -> int:
        """As `_room`, in samples."""
        taken = self.next_seq - 1 + self.open_samples + self._from_threads.count
        return self._window_samples - (taken - self._credited)

    def _queue_run(self, run: Run) -> None:
        if self._awaited and self._owner.id and 0 < self.queue.depth < self.queue.count + run.count:
            self._go_on()  # a longer wait would cost more than it saves
        runs = self.queue.runs
        is_resumed = bool(runs) and runs[0].is_resumed
        if not runs:
            begin(self.queue)
        replaced = self.queue.push(run)
        extend(self.queue, self._most_queued, is_lossless=self._is_windowed)
        replaced += self.queue.drop_over_quota(spare=1)
        if replaced:
            self.replaced += replaced
            self.on_replaced(replaced)
            runs[0].is_resumed |= is_resumed  # the gap before it is mostly of that kind
        if self._owner.id and not self._awaited:
            self._port.make_ready(self.queue)
            self._port.flush()


def _cancel(place: _Place) -> None:
    if place.timer is not None:
        place.timer.cancel()
