"""The way from taken messages to the file: the cache, encoding, chunks, further files, and the writing
thread.

Everything here runs on the event loop, except the jobs, which run in the thread one after the other. The loop
never waits for the disk: messages that the thread can't accept yet wait in the cache.
"""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from time import monotonic_ns
from typing import TypeAlias

from bus.errors import BusError
from bus.vocabulary import DropReason
from bus_bag.errors import BagError
from bus_bag.losses import RECORD, LossDates, TopicLosses, to_record
from bus_bag.record.bag_output import BagOutput
from bus_bag.record.batch import Batch
from bus_bag.record.cache import Cache
from bus_bag.record.options import RecordOptions
from bus_bag.record.topic import RecordedTopic
from bus_bag.record.writing import WritingThread
from bus_bag.storage import BagWriter
from bus_bag.storage.registry import writable_storage
from bus_bag.storage.writer import Job
from bus_ros.cdr import CdrError

__all__ = ["Pipeline"]

_MOST_IN_FLIGHT = 8 << 20
"""Most bytes in chunks that wait for the thread, or are being written."""

_TURN_NS = 2_000_000
"""Longest time of encoding in a turn of the event loop: meanwhile, no messages are taken."""

_NS_PER_S = 1_000_000_000

_Faults = (BusError, OSError)

_Waiting: TypeAlias = tuple[Batch, bool] | Callable[[], object]
"""Messages, and whether they came in a pause; or a request, whose turn comes after all messages from before
it."""


class Pipeline:
    """The pipeline of one recording. `now_ns` is the clock of log times.

    `on_progress` is called in the writing thread after each job, and so is `on_split(closed, opened)` after a
    split. `on_reject(topic, error)` is called on the event loop for a message that does not have its type.
    Without a thread (a cache of size 0), `on_progress` is called on the event loop, and only after a failed
    job.

    Raises BagError or OSError if the bag can't be started.
    """

    def __init__(
        self,
        options: RecordOptions,
        *,
        now_ns: Callable[[], int],
        on_progress: Callable[[], object],
        on_split: Callable[[Path, Path], object],
        on_reject: Callable[[RecordedTopic, CdrError], object],
    ) -> None:
        self._on_progress = on_progress
        self._is_snapshot = options.is_snapshot
        self._crowd = options.max_cache_size // 2
        self._cache: Cache[_Waiting] = Cache(options.max_cache_size, is_circular=options.is_snapshot)
        self._dates = LossDates()
        self._now_ns = now_ns
        self._failure: BaseException | None = None
        self._is_ending = False
        self._end_ns: int | None = None
        """The end of the recording; None before it."""
        self._thread: WritingThread | None = None
        self._writer = BagWriter(
            options.folder,
            storage=writable_storage(options.storage),
            preset=options.preset,
            custom_data=options.custom_data,
            most_files=options.max_bag_files,
            run=self._run,
            on_split=on_split,
        )
        self._takes_packs = self._writer.takes_packs
        self._output = BagOutput(
            self._writer,
            options,
            now_ns=now_ns,
            size=lambda: self._writer.data_size + self._in_flight,
            before_split=self.write_losses,
            on_reject=on_reject,
        )
        if options.max_cache_size:
            self._thread = WritingThread(on_progress)

    def _run(self, job: Job, size: int) -> None:
        if self._is_ending:
            job()
        elif self._thread is not None:
            self._thread.run(job, size)
        elif self._failure is None:
            try:
                job()
            except _Faults as error:
                self._failure = error
                self._on_progress()

    # --- state

    @property
    def failure(self) -> BaseException | None:
        """The reason why nothing more can be written."""
        return self._failure if self._thread is None else self._thread.failure

    @property
    def messages(self) -> int:
        """Number of messages passed to the file."""
        return self._output.messages

    @property
    def written_bytes(self) -> int:
        """Number of bytes of these messages."""
        return self._output.bytes

    @property
    def cached(self) -> int:
        """Bytes on their way to the file: in the cache, and in chunks that are not written yet."""
        return self._cache.bytes + self._in_flight

    @property
    def is_crowded(self) -> bool:
        """Whether the cache is so full that lossless publishers should wait."""
        return self._cache.bytes > self._crowd and not self._is_snapshot

    @property
    def is_idle(self) -> bool:
        """Whether no message is on its way to the file."""
        return (
            (self._is_snapshot or not self._cache.waiting)
            and not self._writer.gathered
            and (self._thread is None or self._thread.is_idle)
        )

    def losses(self) -> dict[str, TopicLosses]:
        """The present counters of each topic."""
        self._settle_cache()
        return {name: topic.losses() for name, topic in self._output.topics.items()}

    @property
    def _in_flight(self) -> int:
        return self._writer.gathered + (0 if self._thread is None else self._thread.waiting_bytes)

    # --- messages in

    def add(self, topic: RecordedTopic) -> None:
        """Add a topic before its first message."""
        self._output.topics[topic.name] = topic

    def set_publishers(self, topic: RecordedTopic, depths: Mapping[bytes, int]) -> None:
        """Set the publishers of `topic` that keep messages for late joiners: gid -> depth (0: all)."""
        self._output.set_publishers(topic, depths)

    def takes_packs(self, topic: RecordedTopic) -> bool:
        """Whether messages of `topic` can be put in one buffer."""
        if topic.program is None or not self._takes_packs:
            return False
        return not (self._is_snapshot and topic.is_latched)  # a snapshot tells its latched messages apart

    def put(self, topic: RecordedTopic, batch: Batch, *, is_paused: bool) -> None:
        """Add taken messages. While the recording is paused, only the state of latched topics is kept."""
        if self._is_snapshot:
            self._output.keep(topic, batch, is_written=False)
            if is_paused:  # so the memory keeps the messages from before the pause
                topic.passed_over += batch.count
                return
        if self._thread is None:
            self._output.write(topic, batch, is_paused=is_paused)
            return
        may_be_lost = self._is_snapshot or not topic.is_lossless
        at_s = batch.log_time // _NS_PER_S
        self._cache.put(
            topic.name, (batch, is_paused), batch.count, batch.size, may_be_lost=may_be_lost, at_s=at_s
        )

    def resume(self) -> None:
        """Write the latched messages of the pause; they come before later messages."""
        self._in_turn(partial(self._output.resume, self._now_ns()))

    def split(self) -> None:
        """Continue in the next file, which begins with the state of latched topics. Messages from before this
        call still go into the present file, except those in the memory of a snapshot."""
        log_time = self._now_ns()
        oldest = self._cache.peek() if self._is_snapshot else None
        if isinstance(oldest, tuple):  # it comes after the state
            log_time = min(log_time, oldest[0].log_time)
        self._in_turn(partial(self._output.split, log_time))

    def _in_turn(self, request: Callable[[], object]) -> None:
        """Do it after the messages that wait now. Those of a snapshot do not wait for their turn."""
        if self._thread is None or self._is_snapshot:
            request()
        else:
            self._cache.put("", request, 0, 0, may_be_lost=False)

    # --- messages out

    def pump(self) -> bool:
        """Encode and pass on messages while there is room, for a limited time; returns whether there is more
        to do."""
        thread, cache = self._thread, self._cache
        if thread is None or self._is_snapshot:
            return False
        until_ns = monotonic_ns() + _TURN_NS
        while cache.waiting and thread.waiting_bytes < _MOST_IN_FLIGHT:
            name, waiting, _ = cache.take()
            if isinstance(waiting, tuple):
                batch, is_paused = waiting
                self._output.write(self._output.topics[name], batch, is_paused=is_paused)
            else:
                waiting()
            if monotonic_ns() >= until_ns:
                break
        return cache.waiting > 0 and thread.waiting_bytes < _MOST_IN_FLIGHT

    def flush(self) -> None:
        """Write the gathered messages."""
        if self._writer.gathered:
            self._writer.flush()

    def snapshot(self) -> int:
        """Write everything in the memory, after the latched messages that have left the memory; returns the
        number of messages."""
        self._settle_cache()
        before = self.messages
        batches = []
        while self._cache.waiting:
            name, waiting, _ = self._cache.take()
            if isinstance(waiting, tuple):
                batches.append((self._output.topics[name], *waiting))
        self._output.write_state_before([batch for _, batch, _ in batches])
        for topic, batch, is_paused in batches:
            self._output.write(topic, batch, is_paused=is_paused)
        self._writer.flush()
        return self.messages - before

    def write_losses(self) -> None:
        """Write the counters into the file."""
        self._writer.write_metadata(RECORD, to_record(self.note_losses()))

    def note_losses(self, *, is_away: bool = False) -> dict[str, TopicLosses]:
        """The present counters, with the times of losses. Call it about once a second. `is_away`: busd is
        away."""
        return self._dates.note(self._look_s(), self.losses(), is_away=is_away)

    def _look_s(self) -> float:
        """The time of losses that are found now: at most the end of the recording."""
        return (self._now_ns() if self._end_ns is None else self._end_ns) / _NS_PER_S

    # --- the end

    def finish(self) -> None:
        """No more messages come. A slow disk may take long for the waiting ones: losses that are found
        meanwhile belong to the end of the recording."""
        self._end_ns = self._now_ns()

    def drop(self) -> None:
        """Drop all messages on their way to the file, except messages that are being written."""
        self._settle_cache()
        self._count_lost(self._cache.clear(), DropReason.NOT_WRITTEN)
        if self._thread is not None:
            self._thread.drop()

    def close(self, patience_s: float | None = None) -> dict[str, TopicLosses]:
        """End the bag after it is idle, has failed, or was dropped; returns the counters.

        Raises BagError or OSError if that fails, for example if the disk takes longer than `patience_s`.
        """
        self.drop()
        if self._thread is not None:
            if not self._thread.end(patience_s):
                raise BagError(f"the disk does not answer: '{self._writer.folder}' is left as it is")
            self._failure, self._thread = self._thread.failure, None
        self._is_ending = True
        try:
            if self._failure is None:
                self._output.describe_topics()
            self.flush()  # flush first, because the counters cover the files
        except _Faults as error:
            self._failure = self._failure or error
        counts = self._writer.counts()
        for topic in self._output.topics.values():
            if missing := topic.written + topic.repeated - counts.get(topic.name, 0):
                topic.written -= missing
                topic.lose(DropReason.NOT_WRITTEN, missing)
        closed = {name: one.closed() for name, one in self.losses().items()}
        losses = self._dates.note(self._look_s(), closed)
        self._writer.write_metadata(RECORD, to_record(losses))
        self._writer.close()
        return losses

    def _settle_cache(self) -> None:
        """Add to the counters the messages that the cache has dropped since the last call."""
        lost, self._cache.lost = self._cache.lost, {}
        self._count_lost(lost, DropReason.RECORDER_CACHE)

    def _count_lost(self, counts: Mapping[tuple[str, int], int], reason: DropReason) -> None:
        """Count messages that left the cache, by topic and second. Messages that leave the memory of a
        snapshot are not lost."""
        for (name, at_s), count in counts.items():
            topic = self._output.topics[name]
            if self._is_snapshot:
                topic.passed_over += count
            else:
                topic.lose(reason, count)
                self._dates.add(name, at_s, reason, count)
