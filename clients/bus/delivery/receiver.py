"""The waiting samples of a subscription: bounded, counted, and decoded when they are taken.

Owns the queue of undecoded runs, and counts delivered and dropped samples. Samples in rings stay there, and
are taken after samples from the socket. It does no I/O; its owner delivers and acknowledges.
"""

from collections import deque
from collections.abc import Callable, Sequence, Sized
from functools import cached_property, partial
from time import monotonic_ns
from typing import Any, Generic, TypeAlias, TypeVar

from bus import shm
from bus.delivery.ages import Ages
from bus.delivery.allowance import STEP_BYTES, begin, extend
from bus.delivery.sequence import PublisherProxy, SequenceTracker
from bus.vocabulary import DropReason
from bus.wire.layout import MAX_COUNT, RECORD_HEAD, RECORD_HEAD_BYTES
from bus.wire.runs import Account, Run, RunQueue
from bus.wire.source_time import SOURCE_BYTES, SOURCE_MARK, source_head, source_ns_of

M = TypeVar("M")

INBOX_BYTES = 256 << 20
"""Most bytes of a subscription's queue in its process; less if memory is short.

Above it, the oldest samples are dropped, counted as memory_limit."""

ALL = 1 << 30

_SHORT_BYTES = 4096
_unpack_record = RECORD_HEAD.unpack_from
_MOST_AT_ONCE = 64


Taken: TypeAlias = tuple[M, int, int, Any, int]
"""Message, stamp, number, `PublisherProxy` or None, time of receipt.

Times are in ns of the monotonic clock; the stamp is by the publisher's clock (`PublisherProxy.clock_ns`).
A stamp below 0 is the time that the message's source gave it: on the wall clock, with its sign changed."""


TakenPack: TypeAlias = tuple[PublisherProxy | None, bytes, int, int, int, bool, bool]
"""See `shm.native.Reader.take_merged`."""


class Receiver(Generic[M]):
    """Keeps the samples of one subscription until they are taken.

    `depth` 0 is keep all; then `take` decodes a whole run at once, because nothing is ever replaced.
    `on_drop(reason, count)` is called for samples lost here, `on_reject(size, error)` for each sample that
    does not decode, `on_taken(proxy)` when samples of a lossless publisher were taken.
    """

    def __init__(
        self,
        decode: Callable[[bytes | bytearray | memoryview], M],
        depth: int,
        *,
        is_lossless: bool,
        on_drop: Callable[[str, int], None],
        on_reject: Callable[[int, Exception], None],
        on_taken: Callable[[PublisherProxy], None],
    ) -> None:
        self._samples = 0
        self._bytes = 0
        self._dropped: dict[str, int] = {}
        self._ages = Ages()
        self._age_due = 0
        """When `_samples` reaches this, the age of the next sample by socket counts."""
        self._missed, self._missed_at = 0, 0
        """Samples replaced since one was taken, and `_samples` at that time."""
        self._most_missed = 0
        self.tracker = SequenceTracker(self.drop)
        self.is_lossless = is_lossless
        self._decode = decode
        self._queue = RunQueue(depth, Account(STEP_BYTES))
        self.ahead: deque[Taken[M]] = deque()
        """Messages decoded ahead and not yet delivered."""
        self.reader: shm.native.Reader[PublisherProxy] | None = None
        """The native Reader, which takes samples out of the rings; None if no memory is shared."""
        self.stamp_ns = 0
        """Stamp of the last sample taken out of a ring."""
        self.on_report_due: Callable[[], object] = _ignore
        """Called when a sample was taken out of a ring, unless the reader's `is_report_due` is set
        already."""
        self._rejected = 0
        self._on_drop = on_drop
        self._on_reject = on_reject
        self._on_taken = on_taken

    @cached_property
    def _has_core(self) -> bool:
        """Whether the native core exists; evaluated only when samples come by socket."""
        return shm.has_core()

    @property
    def delivered(self) -> int:
        samples = self._samples - len(self.ahead)
        return samples if self.reader is None else samples + self.reader.samples

    @property
    def bytes(self) -> int:
        return self._bytes if self.reader is None else self._bytes + self.reader.bytes

    @property
    def ages(self) -> Ages:
        """Ages of samples at the time when they were taken."""
        if self.reader is not None:
            self._ages.add_all(*self.reader.pop_ages())
        return self._ages

    @property
    def queued(self) -> int:
        queued = self._queue.count + len(self.ahead)
        if self.reader is None:
            return queued
        self.count_replaced()
        return queued + self.reader.waiting()

    @property
    def dropped(self) -> dict[str, int]:
        """Samples lost here, by reason."""
        reader, dropped = self.reader, dict(self._dropped)
        if reader is not None:
            for reason, count in (
                (DropReason.REPLACED, reader.replaced),
                (self.lapped_reason, reader.overrun),
                (DropReason.EXPIRED, reader.expired),
                (DropReason.UNDECODABLE, reader.undecodable),
            ):
                if count:
                    dropped[reason] = dropped.get(reason, 0) + count
        return dropped

    @property
    def most_missed(self) -> int:
        """The most samples that the depth replaced between two taken ones."""
        return self._most_missed if self.reader is None else max(self._most_missed, self.reader.most_missed)

    @property
    def lapped_reason(self) -> str:
        """The reason for samples that a ring dropped unread: the depth here if there is one, else the
        publisher's."""
        return DropReason.REPLACED if self._queue.depth else DropReason.PUBLISHER_QUEUE

    @property
    def waiting(self) -> tuple[deque[Taken[M]], deque[Run]]:
        """The queues here; samples in them come before samples in rings."""
        return self.ahead, self._queue.runs

    @property
    def has_more(self) -> bool:
        return bool(self.ahead or self._queue.runs or (self.reader is not None and self.reader.waiting()))

    @property
    def has_rejected(self) -> bool:
        """Whether the reader took a sample that did not decode, which `take` must report."""
        return self.reader is not None and self.reader.undecodable != self._rejected

    def count_replaced(self) -> None:
        """Apply the depth to the rings now, as `take` would later, to bring the counters up to date."""
        if self.reader is not None:
            self.reader.messages(0, self._decode)

    @property
    def lost_silently(self) -> int:
        """A number that grows with each sample that is lost without a call of `on_drop`: in a ring, or as a
        gap in the numbers."""
        reader = self.reader
        if reader is None:
            return self.tracker.missing
        reader.messages(0, self._decode)  # as `count_replaced`
        in_rings = reader.replaced + reader.overrun + reader.expired + reader.undecodable
        return in_rings + self.tracker.missing

    def drain_rings(self) -> None:
        """Move the waiting samples of the rings into the queue, in order, without samples that come
        meanwhile."""
        if self.reader is None:
            return
        self.reader.takes_held = True  # held samples would be lost with a ring that is left
        try:
            self._drain(self.reader)
        finally:
            self.reader.takes_held = False
        self.trim()

    def _drain(self, reader: "shm.native.Reader[PublisherProxy]") -> None:
        left = reader.waiting()
        while left > 0 and (batch := reader.take(min(left, _MOST_AT_ONCE), bytes)):
            left -= len(batch)
            for payload, stamp_ns, seq, proxy, received_ns in batch:
                if stamp_ns < 0:
                    payload, stamp_ns = source_head(-stamp_ns) + payload, received_ns + proxy.clock_ns
                body = RECORD_HEAD.pack(len(payload), min(stamp_ns, MAX_COUNT)) + payload  # it may be false
                run = Run(0, proxy.number, seq, 1, body, lifespan_ns=proxy.lifespan_ns)
                run.received_ns, run.origin = received_ns, proxy
                self._queue.append(run)
                self._samples -= 1  # until they are taken
                self._bytes -= len(payload)

    def set_depth(self, depth: int) -> None:
        self._queue.set_depth(depth)
        if self.reader is not None:
            self.reader.depth = depth

    def put(self, run: Run) -> bool:
        """Queue a run; returns whether the receiver now holds too much: then the caller must `trim` it."""
        proxy = run.origin = self.tracker.get(run.source)
        if proxy is not None:
            run.lifespan_ns = proxy.lifespan_ns
            is_next = run.first_seq == proxy.last_seq + 1 and not proxy.is_new
            if not is_next and not self.tracker.check_run(proxy, run):
                return False
            proxy.last_seq = max(proxy.last_seq, run.first_seq + run.count - 1)
        self.tracker.received += run.count
        if not self._queue.runs:
            begin(self._queue)
        return self._queue.append(run)

    def trim(self) -> None:
        """Drop the oldest samples above the bounds, and count them."""
        if replaced := self._queue.trim():
            self.drop(DropReason.REPLACED, replaced)
            if self._missed_at != self._samples:
                self._missed, self._missed_at = 0, self._samples
            self._missed += replaced
            self._most_missed = max(self._most_missed, self._missed)
        extend(self._queue, INBOX_BYTES, is_lossless=self.is_lossless)
        gone: list[Run] = []
        if over := self._queue.drop_over_quota(gone, spare=1):
            self._let_go(gone)
            self.drop(DropReason.MEMORY_LIMIT, over)

    def drop(self, reason: str, count: int) -> None:
        """Count lost samples."""
        self._dropped[reason] = self._dropped.get(reason, 0) + count
        self._on_drop(reason, count)

    def take(self, limit: int = 1, *, is_most: bool = False) -> Taken[M] | None:
        """Take the oldest message, as in `Taken`; None without one.

        `limit`: how many samples may be decoded at once. A decoded sample counts as taken: a newer one does
        not replace it. So the limit is 1, unless nothing is ever replaced, or no sample can come in between.
        With `is_most`, no more samples of a ring are decoded, even if nothing is ever replaced.
        """
        ahead, runs = self.ahead, self._queue.runs
        while not ahead:
            if not runs:
                reader = self.reader  # in the child of a fork in the decoder, there is none afterwards
                if reader is None:
                    return None
                at_once = limit if self._queue.depth or is_most else _MOST_AT_ONCE
                try:
                    batch = reader.take(at_once, self._decode)
                except BaseException:  # such as KeyboardInterrupt in the decoder
                    ahead += reader.pop_interrupted()
                    raise
                if reader.undecodable != self._rejected:
                    self._reject_from_rings(reader)
                elif not batch:
                    return None
                if batch:
                    _, stamp_ns, _, proxy, received_ns = batch[-1]
                    self.stamp_ns = stamp_ns - proxy.clock_ns if stamp_ns >= 0 else received_ns
                    if not reader.is_report_due:
                        self.note()
                ahead += batch
                continue
            run = runs[0]
            if run.count > 1 or run.lifespan_ns or self.is_lossless:
                self._decode_ahead(run, limit if self._queue.depth else ALL)
            elif taken := self._take_single(run):
                return taken
        return ahead.popleft()

    def take_many(self, limit: int) -> list[Taken[M]]:
        """Take up to `limit` of the oldest messages, in as few steps as possible."""
        ahead, runs, reader = self.ahead, self._queue.runs, self.reader
        found: list[Taken[M]] = []
        # Decoded samples that are left over could not be taken packed.
        try:
            while (left := limit - len(found)) > 0 and (taken := self.take(left, is_most=True)) is not None:
                found.append(taken)
                if len(ahead) < left:
                    found += ahead
                    ahead.clear()
                    if not runs and (reader is None or not reader.waiting()):
                        break  # `take` would find out the same, in more steps
                else:
                    found += [ahead.popleft() for _ in range(left - 1)]
        except BaseException:
            ahead.extendleft(reversed(found))
            raise
        return found

    def take_packed(
        self, most_bytes: int, longest: int, offset_ns: int, *, merges: bool = False
    ) -> TakenPack | None:
        """As `Reader.take_packed`, or `Reader.take_merged`; None if other samples come before those in the
        rings."""
        reader = self.reader
        if reader is None or self.ahead or self._queue.runs:
            return None
        take: Callable[[int, int, int], TakenPack | None]
        take = reader.take_merged if merges else reader.take_packed
        found = take(most_bytes, longest, offset_ns)
        if found is not None:
            self.stamp_ns = monotonic_ns()
            if not reader.is_report_due:
                self.note()
        return found

    def take_messages(self, limit: int) -> list[M]:
        """Take up to `limit` of the oldest messages without info; none if only `take` can handle the case."""
        if self.ahead:
            return []
        if self._queue.runs:
            return self._take_from_run(limit)
        reader = self.reader
        if reader is None:
            return []
        try:
            batch = reader.messages(limit, self._decode)
        except BaseException:
            self.put_back(reader.pop_interrupted())
            raise
        if reader.undecodable != self._rejected:
            self._reject_from_rings(reader)
        return batch

    def take_lone(self, run: Run) -> Taken[M] | None:
        """Take the message of a run of one sample that was not `put`; None if the case is not simple.

        At a moderate rate it always is simple: the sample is the next one, and nothing waits here.
        """
        proxy = self.tracker.get(run.source)
        if (
            proxy is None
            or run.count != 1
            or run.first_seq != proxy.last_seq + 1
            or proxy.is_new
            or proxy.lifespan_ns
            or self._queue.runs
            or self.ahead
            or not self._has_core
        ):
            return None
        try:
            found = shm.native.run_samples(
                run.body, 0, 1, self._decode, run.first_seq, proxy, run.received_ns
            )
        except BaseException:  # such as KeyboardInterrupt in the decoder: the message is lost
            if run.first_seq == proxy.last_seq + 1:
                proxy.last_seq += 1
                self.tracker.received += 1
                self.drop(DropReason.UNDECODABLE, 1)
            raise
        if found is None or run.first_seq != proxy.last_seq + 1:
            return None
        proxy.last_seq += 1
        self.tracker.received += 1
        samples = self._samples = self._samples + 1
        size = found[1] - RECORD_HEAD_BYTES
        self._bytes += size
        if samples >= self._age_due:
            self._check_age(_unpack_record(run.body)[1], proxy)
        if self.is_lossless:
            run.origin = proxy
            self._note_taken(run, run.first_seq, size)
        return found[0][0]

    def quick_take(self, *, with_info: bool) -> Callable[[], list[Any]] | None:
        """A native call that takes a message out of the rings. The caller checks that nothing waits here."""
        if self.reader is None:
            return None
        return partial(self.reader.take if with_info else self.reader.messages, 1, self._decode)

    def quick_wait(self, *, with_info: bool) -> Callable[[int, int, float], Any] | None:
        """A native call that waits for the next message: see `Reader.wait`. Valid only while nothing is
        `waiting`."""
        return None if self.reader is None else partial(self.reader.wait, self._decode, with_info)

    def note(self) -> None:
        """Request a report after a message was taken out of a ring, unless one is due already."""
        reader = self.reader
        if reader is not None and not reader.is_report_due:
            reader.is_report_due = True
            self.on_report_due()

    def call_back(
        self,
        callback: Callable[[M], object],
        on_error: Callable[[Exception], object],
        *others: Sized,
        on_slow: Callable[[int], object] | None = None,
    ) -> None:
        """Let the reader call back by itself for samples in rings, while nothing waits here or in `others`.

        `on_slow` gets the nanoseconds of a slow call.
        """
        assert self.reader is not None
        self.reader.prepare(
            callback, self._decode, on_error, (*self.waiting, *others), self.on_report_due, on_slow
        )

    def call_back_with_taken(
        self, callback: Callable[[Taken[M]], object], on_error: Callable[[Exception], object], *others: Sized
    ) -> None:
        """As `call_back`, for a callback of what `take` returns."""
        assert self.reader is not None
        self.reader.prepare(
            callback,
            self._decode,
            on_error,
            (*self.waiting, *others),
            self.on_report_due,
            gives_taken=True,
        )

    def put_back(self, messages: list[M]) -> None:
        """Return messages of `take_messages` that were not delivered; they are taken next."""
        self.ahead.extendleft((message, 0, 0, None, 0) for message in reversed(messages))

    def _reject_from_rings(self, reader: "shm.native.Reader[PublisherProxy]") -> None:
        self._rejected = reader.undecodable
        for size, error in reader.pop_rejected():
            self._on_reject(size, error)

    def _take_from_run(self, limit: int) -> list[M]:
        queue, run = self._queue, self._queue.runs[0]
        if not self._has_core or run.lifespan_ns:
            return []
        begin, skipped = queue.offset, queue.skipped
        number = min(limit, run.count - skipped)
        found = shm.native.run_messages(run.body, begin, number, self._decode)
        if found is None or not self._is_head(run, skipped):
            return []
        messages, offset = found
        queue.advance(number, offset)
        self._count(
            run, number, run.first_seq + skipped + number - 1, offset - begin - number * RECORD_HEAD_BYTES
        )
        if not begin and self._samples >= self._age_due:
            self._check_age(_unpack_record(run.body)[1], run.origin)
        return messages

    def _is_head(self, run: Run, skipped: int) -> bool:
        """Whether the queue's head is unchanged: the decoder may have called code that took from it."""
        queue = self._queue
        return bool(queue.runs) and queue.runs[0] is run and queue.skipped == skipped

    def _take_single(self, run: Run) -> Taken[M] | None:
        """As `_decode_ahead`, for a run of one sample. At a moderate rate all runs are like this."""
        self._queue.forget_head()
        body = memoryview(run.body)
        size, stamp_ns = _unpack_record(body) if len(body) >= RECORD_HEAD_BYTES else (len(body), 0)
        if RECORD_HEAD_BYTES + size > len(body):
            self.drop(DropReason.UNDECODABLE, 1)
            return None
        published_ns = stamp_ns
        payload = body[RECORD_HEAD_BYTES : RECORD_HEAD_BYTES + size]
        if payload[:8] == SOURCE_MARK and (source_ns := source_ns_of(payload)):
            payload, stamp_ns = payload[SOURCE_BYTES:], -source_ns
        try:
            message = self._decode(payload)
        except Exception as error:  # a message class may raise anything
            self._reject([(size, error)])
            return None
        except BaseException:
            self.drop(DropReason.UNDECODABLE, 1)
            raise
        self._samples += 1
        self._bytes += size
        if self._samples >= self._age_due:
            self._check_age(published_ns, run.origin)
        return message, stamp_ns, run.first_seq, run.origin, run.received_ns

    def _decode_ahead(self, run: Run, limit: int) -> None:
        """Decode up to `limit` samples of the oldest run."""
        queue, ahead, decode = self._queue, self.ahead, self._decode
        if run.lifespan_ns:
            gone: list[Run] = []
            if expired := queue.drop_expired(monotonic_ns(), gone):
                self._let_go(gone)
                self.drop(DropReason.EXPIRED, expired)
                return
        begin, skipped = queue.offset, queue.skipped
        first_seq, held = run.first_seq + skipped, run.count - skipped
        offset, number = begin, min(limit, held)
        if self._has_core:
            found = shm.native.run_samples(
                run.body, begin, number, decode, first_seq, run.origin, run.received_ns
            )
            if found is not None:
                if self._is_head(run, skipped):
                    samples, offset = found
                    ahead += samples
                    queue.advance(number, offset)
                    size = offset - begin - number * RECORD_HEAD_BYTES
                    self._count(run, number, first_seq + number - 1, size)
                    if not begin and self._samples >= self._age_due:
                        self._check_age(_unpack_record(run.body)[1], run.origin)
                return
        length = len(run.body)
        # A slice of bytes is a copy, which is faster for short payloads; a view is faster for long ones.
        body = run.body if length < _SHORT_BYTES * run.count else memoryview(run.body)
        rejected: list[tuple[int, Exception]] = []
        seq = first_seq
        for seq in range(first_seq, first_seq + number):
            start = offset + RECORD_HEAD_BYTES
            if start > length:
                break
            size, stamp_ns = _unpack_record(body, offset)
            if start + size > length:
                break
            offset = start + size
            payload = body[start:offset]
            if payload[:8] == SOURCE_MARK and (source_ns := source_ns_of(payload)):
                payload, stamp_ns = payload[SOURCE_BYTES:], -source_ns
            try:
                ahead.append((decode(payload), stamp_ns, seq, run.origin, run.received_ns))
            except Exception as error:
                rejected.append((size, error))
            except BaseException:  # the run stays, and all of it is decoded again
                ahead.clear()
                raise
        else:
            queue.advance(number, offset)
            size = offset - begin - number * RECORD_HEAD_BYTES
            self._count(run, len(ahead), seq, size, rejected)
            if not begin and self._samples >= self._age_due:
                self._check_age(_unpack_record(body)[1], run.origin)
            self._reject(rejected)
            return
        # The run is shorter than its head claims: the missing samples count as undecodable.
        queue.forget_head()
        size = offset - begin - (seq - first_seq) * RECORD_HEAD_BYTES
        self._count(run, len(ahead), first_seq + held - 1, size, rejected)
        self._reject(rejected)
        self.drop(DropReason.UNDECODABLE, first_seq + held - seq)

    def _count(
        self, run: Run, samples: int, seq: int, size: int, rejected: Sequence[tuple[int, Exception]] = ()
    ) -> None:
        """Count `samples` taken out of the run, up to number `seq`: `size` bytes, including `rejected`
        ones."""
        self._samples += samples
        self._bytes += size
        if rejected:
            self._bytes -= sum(one for one, _ in rejected)
        if self.is_lossless:
            self._note_taken(run, seq, size)

    def _check_age(self, published_ns: int, origin: object) -> None:
        """Note the age of a run's first sample, which was taken, perhaps with others."""
        clock_ns = origin.clock_ns if isinstance(origin, PublisherProxy) else 0
        self._age_due = self._samples + self._ages.add(monotonic_ns() + clock_ns - published_ns)

    def _let_go(self, gone: list[Run]) -> None:
        """Note dropped runs as taken, because a lossless publisher must not wait for them."""
        for run in gone:
            self._note_taken(run, run.first_seq + run.count - 1, len(run.body))

    def _note_taken(self, run: Run, seq: int, size: int) -> None:
        proxy = run.origin
        if isinstance(proxy, PublisherProxy) and proxy.needs_ack and seq > proxy.taken_seq:
            proxy.taken_seq = seq
            proxy.unacked_bytes += size
            self._on_taken(proxy)

    def _reject(self, rejected: list[tuple[int, Exception]]) -> None:
        # Called only when the queue is consistent: the callee may take again.
        for size, error in rejected:
            self._on_reject(size, error)
            self.drop(DropReason.UNDECODABLE, 1)


def _ignore() -> None:
    """Stands for a callback that was not given."""
