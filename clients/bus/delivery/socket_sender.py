"""Sends a publisher's samples through the broker: numbers them, gathers them into runs, queues these.

A sample is sent at once, unless the previous one was sent a moment ago. Then it is gathered with later
samples into a run, sent when it is full or when the turn of the event loop ends. So a paced publisher has the
latency of one system call, and a flood its throughput. Does not know messages, only their encoding.

`bus.delivery.window` bounds the samples that may be sent. `bus.delivery.recipients` has the subscriptions
that must not miss any.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from enum import Enum
from typing import TYPE_CHECKING, TypeAlias, cast

from bus import shm
from bus.delivery.allowance import QUEUE_BYTES, STEP_BYTES, begin, extend
from bus.delivery.open_run import OpenRun, PythonRun, open_run
from bus.delivery.port import Owner, Port, Timer
from bus.delivery.recipients import Recipients
from bus.delivery.thread_queue import ThreadQueue
from bus.qos import Durability, History
from bus.types.large_fields import LONG_TEXT
from bus.wire import messages as m
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

if TYPE_CHECKING:  # few publishers are lossless
    from bus.delivery.window import CreditWindow

_GATHER_NS = 100_000
"""A message that follows the last one within this time is gathered with others."""

_HISTORY_NS = 10_000_000
"""Interval of the runs for the history alone. Each wakes the broker, and no subscription waits for it."""

_GATHERED_BYTES = 4 * RUN_BYTES
"""Bytes of long samples that leave together. This saves a quarter of the CPU time of messages of 64 KiB."""

_MOST_APART_BYTES = STEP_BYTES
"""Bytes of queued samples that stay in the program's own buffers; further ones are copied.

So the checks of free memory see all of a long queue: pages that a program has never written do not count."""

Sample: TypeAlias = tuple[int, int, bytes]
"""Number, stamp in ns, payload."""

_pack_record = RECORD_HEAD.pack


class Use(Enum):
    """The purpose of the socket route."""

    NONE = "none"
    """Nothing uses this route: all subscriptions read the ring."""
    HISTORY = "history"
    """Only the broker's history.

    It can wait until the turn of the loop ends, and soon after the last run also until the next one is due.
    It takes all samples along that come until then.
    """
    READERS = "readers"
    """Subscriptions get samples this way, or may do so again."""


_READERS, _HISTORY = Use.READERS, Use.HISTORY
"""Globals, because each run needs them, and an attribute of the class takes longer to find."""


class _History:
    """Keeps the runs of a transient local publisher for a new busd.

    Knows when the next run for the history alone is due.
    """

    def __init__(self, depth: int, port: Port, hand_over: Callable[[], None]) -> None:
        self.queue = RunQueue(depth, Account(STEP_BYTES))
        self._port = port
        self._hand_over = hand_over
        self._due_ns = 0
        """When the next run for the history alone is due."""
        self._timer: Timer | None = None

    def puts_off(self, stamp_ns: int) -> bool:
        """Whether a run that begins now waits until the next one is due. Then a timer hands it over."""
        if stamp_ns >= self._due_ns:
            self._due_ns = stamp_ns + _HISTORY_NS
            return False
        if self._timer is None:
            self._timer = self._port.later((self._due_ns - stamp_ns) / 1e9, self._be_due)
        return True

    def end(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _be_due(self) -> None:
        self._timer = None
        self._due_ns = self._port.now_ns() + _HISTORY_NS
        self._hand_over()


class SocketSender:
    """Numbers the samples, unless `resume` sets the number.

    `owner` is the publisher that the port knows, `threads` has the samples of other threads.
    """

    def __init__(self, port: Port, owner: Owner, threads: ThreadQueue) -> None:
        qos = owner.qos
        depth = 0 if qos.history is History.KEEP_ALL else qos.depth
        self._port = port
        self._owner = owner
        self.use = Use.READERS
        self.is_report_due = False
        """If False, `hand_over` requests a report of the counters."""
        self.on_replaced: Callable[[int], object] = int
        """Called with the number of samples that the depth has replaced here."""
        self.queue = RunQueue(depth, Account(STEP_BYTES))
        self._history: _History | None = None
        if qos.durability is Durability.TRANSIENT_LOCAL:
            self._history = _History(depth, port, self.hand_over)
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
        support = owner.support
        if not support.bytes_fields:  # a long field must not be encoded with the rest
            self.run.prepare(*support.steps)
        self._has_core = not isinstance(self.run, PythonRun)
        if support.text_fields and self._has_core:
            self.run.longest = LONG_TEXT
        self._window = _make_window(self.run, threads) if qos.is_lossless else None
        self.run.begin_by(self._begun, None if self._window is None else self._window.can_take)
        self.run.begins_below = RUN_BYTES
        self.max_bytes = MAX_MESSAGE_BYTES
        self.recipients = Recipients(port, owner, self._window, self.first_seq_to_send)
        self.recipients.on_all_back = self._go_on

    def can_take(self, size: int) -> bool:
        """Whether there is room for a sample of `size` bytes, before a keep-all subscription takes more.

        May be called from any thread.
        """
        return self._window is None or self._window.can_take(size)

    def set_use(self, *, is_read: bool) -> None:
        """Set whether subscriptions read this route, or may do so again."""
        use = Use.NONE if self._history is None else Use.HISTORY
        if is_read or (self._history is not None and self._window is not None):  # the window bounds its room
            use = Use.READERS
        if use is self.use:
            return
        if use is Use.NONE or self.use is _HISTORY:
            self.hand_over()
        self.use = use
        if self._window is None:  # else the window has bounded the open run
            self.run.most = UNBOUNDED if use is Use.HISTORY else self.queue.depth or UNBOUNDED

    def put(self, payload: Buffer, stamp_ns: int) -> None:
        """Take a sample as the first of a new run."""
        self.hand_over()
        self.run.begin(payload, stamp_ns)
        self._begun(stamp_ns)

    def _begun(self, stamp_ns: int) -> None:
        """Handle a run that has its first sample, with this stamp: send it now, or gather later samples."""
        port = self._port
        if self.use is not _READERS or stamp_ns - port.last_sent_ns < _GATHER_NS:
            budget = min(RUN_BYTES, self.max_bytes)
            if self._window is not None:
                budget = self._window.bound(budget)
            self.run.budget = max(0, budget - self.run.size)
            if self.use is _READERS or self._history is None or not self._history.puts_off(stamp_ns):
                port.gather(self._owner)
        else:
            port.last_sent_ns = stamp_ns
            try:
                self.hand_over()
            except MemoryError:
                if not self.run.samples:
                    raise
                port.gather(self._owner)  # taken: it leaves with later samples, or when the turn ends

    def long_record(self, parts: Sequence[Buffer | str], stamp_ns: int) -> "shm.native.Parts | None":
        """The record of a long sample, given in parts, for `put_long`; None if it is short or must
        be gathered with others.

        The parts are sent one after the other, and are not joined. An open run would need a copy, which is
        two fifths of a publisher's CPU time for 1 MiB.
        """
        size = sum(map(len, parts))
        if size < RUN_BYTES or not self._has_core or self.use is not _READERS:
            return None
        return shm.native.Parts(_pack_record(size, stamp_ns), *map(_unchanging, parts))

    def put_long(self, record: "shm.native.Parts", stamp_ns: int) -> None:
        """Take a sample, given as its record, in a run for it alone.

        Runs that follow each other soon leave a few at a time, at the latest with the turn of the loop.
        """
        self.hand_over()
        owner, seq, size = self._owner, self.next_seq, len(record)
        body, pieces = cast(Buffer, record), record.pieces  # the record is a buffer, too, if it is read
        if self.queue.runs and self.queue.held_bytes + size > _MOST_APART_BYTES:
            with suppress(MemoryError):  # a ring may have the sample already
                body, pieces = b"".join(pieces), ()
        run = Run(0, 0, seq, 1, body, is_resumed=self._is_resumed, pieces=pieces)
        self.next_seq += 1
        self.samples += 1
        self.bytes += size - RECORD_HEAD_BYTES
        self._is_resumed = False
        if self._window is not None or self._history is not None:
            self._keep(run)
        is_soon = stamp_ns - self._port.last_sent_ns < _GATHER_NS
        if not is_soon:
            self._port.last_sent_ns = stamp_ns
        self._queue_run(run, may_wait=is_soon)
        if not self.is_report_due:
            self.is_report_due = True
            self._port.report(owner)

    def skip(self, count: int) -> None:
        """Leave a gap in the numbers for samples that were replaced before they came here."""
        if not count:
            return
        self.hand_over()
        self._number_from(self.next_seq + count)
        self.samples += count
        self.replaced += count

    def resume(self, seq: int) -> None:
        """Take samples from number `seq` on, after earlier ones used another route."""
        self.hand_over()
        if seq > self.next_seq:
            self._number_from(seq)
            self._is_resumed = True
            self.recipients.credit(seq - 1)

    def catch_up(self, subscription: int, samples: list[Sample], *, since_ns: int) -> None:
        """Send missed samples to a single subscription, which then gets the samples for all.

        Samples stamped before `since_ns` are history. Some may be on their way to all as well: the
        subscription recognizes them by their numbers.
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
        """End the open run and send it, or queue it if the broker does not accept it now."""
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
        if self._window is not None or self._history is not None:
            self._keep(Run(0, 0, first_seq, samples, memoryview(frame)[DATA_HEAD_BYTES:]))
        if (
            not owner.id
            or self.queue.runs
            or self.recipients.awaited
            # If nothing waits, a direct send avoids the queues: most of a message's cost at a moderate rate.
            or not self._port.send_now(frame)
        ):
            body = memoryview(frame)[DATA_HEAD_BYTES:]
            self._queue_run(Run(0, 0, first_seq, samples, body, is_resumed=is_resumed))
        if not self.is_report_due:
            self.is_report_due = True
            self._port.report(owner)

    def _keep(self, run: Run) -> None:
        """Keep a run that is handed over, if it may be needed again."""
        window, history = self._window, self._history
        if window is not None:
            window.hand_over(self.next_seq - 1, len(run.body))
        if history is not None:
            history.queue.push(run)
            extend(history.queue, self._most_queued, is_lossless=window is not None)
            history.queue.drop_over_quota(spare=1)
        else:
            self.recipients.keep(run)

    def declared(self, answer: m.Created) -> None:
        """Send the queued runs, because a broker knows the publisher now."""
        self.max_bytes = answer.max_message_bytes
        self._most_queued = max(QUEUE_BYTES, answer.max_message_bytes + RUN_BYTES)
        # A run for the history alone is bounded by the turn of the loop, not by the depth.
        self.run.most = UNBOUNDED if self.use is Use.HISTORY else answer.depth or UNBOUNDED
        self.run.begins_below = min(RUN_BYTES, self.max_bytes + 1)
        self.queue.set_depth(answer.depth)
        self.queue.endpoint = answer.id
        if self._history is not None:
            # Queued runs are the end of the history, so a new broker only needs the history.
            self.queue.clear()
            for run in self._history.queue.newest(0, 0):
                run.is_replay = False
                self.queue.push(run)
            self.queue.account.limit = self._history.queue.account.limit
        if self._window is not None:
            self._window.resize(answer.window_samples, answer.window_bytes)
            self._window.credit(self.first_seq_to_send() - 1)
        self.recipients.declared()
        if self.queue.runs and not self.recipients.awaited:
            self._port.make_ready(self.queue)

    def first_seq_to_send(self) -> int:
        """The number of the first sample that a new broker will get."""
        waiting = self._history.queue if self._history is not None else self.queue
        return waiting.runs[0].first_seq + waiting.skipped if waiting.runs else self.next_seq

    def disconnected(self) -> None:
        self.queue.is_ready = False  # the outbox with the queue is gone
        self.recipients.disconnected()

    def drop_queued(self) -> int:
        """Drop the queued runs; returns the number of samples."""
        lost = self.queue.clear()
        self.replaced += lost
        return lost

    def end(self) -> None:
        """End: send nothing more."""
        self.forget_open()
        if self._history is not None:
            self._history.end()
        self.queue.clear()
        self.recipients.end()

    @property
    def open_samples(self) -> int:
        """Samples of the open run; no other counter includes them."""
        return self.run.samples

    @property
    def open_bytes(self) -> int:
        return self.run.size - self.run.samples * RECORD_HEAD_BYTES

    def forget_open(self) -> None:
        """Drop the open run, and begin no other here."""
        self.run.forget()
        self.run.begins_below = 0

    def _go_on(self) -> None:
        """Send the queued runs, because no subscription is awaited any more."""
        if self._owner.id and self.queue.runs:
            self._port.make_ready(self.queue)
            self._port.flush()
            self._port.wrote()

    def _number_from(self, seq: int) -> None:
        self.next_seq = seq
        if self._window is not None:
            self._window.last_seq = seq - 1

    def _queue_run(self, run: Run, *, may_wait: bool = False) -> None:
        """Queue a run, and send it now, or with the next ones if it `may_wait` and these replace nothing."""
        recipients, is_too_much = self.recipients, 0 < self.queue.depth < self.queue.count + run.count
        if is_too_much and recipients.awaited and self._owner.id:
            recipients.go_on()  # a longer wait would cost more than it saves
        runs = self.queue.runs
        is_resumed = bool(runs) and runs[0].is_resumed
        if not runs:
            begin(self.queue)
        replaced = self.queue.push(run)
        extend(self.queue, self._most_queued, is_lossless=self._window is not None)
        replaced += self.queue.drop_over_quota(spare=1)
        if replaced:
            self.replaced += replaced
            self.on_replaced(replaced)
            runs[0].is_resumed |= is_resumed  # most of the gap before it is of that kind
        if self._owner.id and not recipients.awaited:
            queue = self.queue
            self._port.make_ready(queue)
            if may_wait and queue.held_bytes < _GATHERED_BYTES and queue.count < (queue.depth or UNBOUNDED):
                self._port.gather(self._owner)
            else:
                self._port.flush()


def _unchanging(part: Buffer | str) -> Buffer | str:
    """The part, or a copy if its memory may change before it has left."""
    kind = part.obj.__class__ if isinstance(part, memoryview) else part.__class__
    return part if kind is bytes or kind is str else bytes(cast(Buffer, part))


def _make_window(run: OpenRun, threads: ThreadQueue) -> "CreditWindow":
    from bus.delivery.window import CreditWindow

    return CreditWindow(run, threads)
