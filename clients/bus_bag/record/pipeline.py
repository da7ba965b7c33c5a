"""From what was taken to the file: the cache, encoding, chunks, further files, and the thread that writes.

Everything here runs on the event loop but the jobs, which run in the thread one after the other. The loop
never waits for the disk: what it can't hand over waits in the cache.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from operator import itemgetter
from pathlib import Path
from time import monotonic_ns

from bus.errors import BusError
from bus_bag.errors import BagError
from bus_bag.losses import RECORD, TopicLosses, to_record
from bus_bag.record.cache import Cache
from bus_bag.record.latched import Latched, LatchedState
from bus_bag.record.options import RecordOptions
from bus_bag.record.splitting import Splitting
from bus_bag.record.topic import Batch, RecordedTopic, Sample
from bus_bag.record.writing import WritingThread
from bus_bag.storage import BagWriter
from bus_bag.storage.registry import writable_storage
from bus_bag.storage.writer import Job
from bus_ros.cdr import CdrError

__all__ = ["Pipeline"]

_MOST_IN_FLIGHT = 8 << 20
"""Bytes in chunks that wait for the thread, or are being written."""

_SHORT = 4 << 10
"""Batches of messages that have up to so many bytes on the average go into a chunk as one."""

_TURN_NS = 2_000_000
"""How long the event loop may be held up by encoding: meanwhile nothing is taken."""

_Faults = (BusError, OSError)

_payload = itemgetter(0)
"""Of a sample."""


class Pipeline:
    """Of one recording. `now_ns` is the clock of log times.

    In the writing thread `on_progress` is called after each job, and `on_split(closed, opened)`; on the event
    loop `on_reject(topic, error)` for what is no message of its type. Without a thread (a cache of no size)
    `on_progress` is called on the event loop, and only when a job has failed.

    Raises BagError or OSError where the bag can't be begun.
    """

    def __init__(
        self,
        options: RecordOptions,
        *,
        now_ns: Callable[[], int],
        on_progress: Callable[[], object],
        on_split: Callable[[Path, Path], None],
        on_reject: Callable[[RecordedTopic, CdrError], object],
    ) -> None:
        self._now_ns = now_ns
        self._on_progress = on_progress
        self._on_split = on_split
        self._on_reject = on_reject
        self._is_snapshot = options.is_snapshot
        self._crowd = options.max_cache_size // 2
        self._cache: Cache[tuple[Batch, int, bool]] = Cache(
            options.max_cache_size, is_circular=options.is_snapshot
        )
        splitting = Splitting(options.max_bag_size, options.max_bag_duration)
        self._splitting = splitting if splitting else None
        self._latched: LatchedState[Sample] = LatchedState()
        self._topics: dict[str, RecordedTopic] = {}
        self._files = 1
        self._failure: BaseException | None = None
        self._is_ending = False
        self._thread: WritingThread | None = None
        self.messages = 0
        """That were given to the file."""
        self.bytes = 0
        self._writer = BagWriter(
            options.folder,
            storage=writable_storage(options.storage),
            preset=options.preset,
            custom_data=options.custom_data,
            most_files=options.max_bag_files,
            run=self._run,
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

    # --- how things are

    @property
    def failure(self) -> BaseException | None:
        """Why nothing more can be written."""
        return self._failure if self._thread is None else self._thread.failure

    @property
    def cached(self) -> int:
        """Bytes that are on their way to the file."""
        return self._cache.bytes + self._in_flight

    @property
    def is_crowded(self) -> bool:
        """Whether the cache is so full that publishers that can wait should."""
        return self._cache.bytes > self._crowd and not self._is_snapshot

    @property
    def is_idle(self) -> bool:
        """Whether nothing is on its way to the file."""
        return (
            (self._is_snapshot or not self._cache.waiting)
            and not self._writer.gathered
            and (self._thread is None or self._thread.is_idle)
        )

    def losses(self) -> dict[str, TopicLosses]:
        """The accounts now."""
        self._settle_cache()
        return {name: topic.losses() for name, topic in self._topics.items()}

    @property
    def _in_flight(self) -> int:
        return self._writer.gathered + (0 if self._thread is None else self._thread.waiting_bytes)

    @property
    def _size(self) -> int:
        """Bytes of all files, with what is on its way there."""
        return self._writer.size + self._in_flight

    # --- messages in

    def add(self, topic: RecordedTopic) -> None:
        """From now on there may be messages of it."""
        self._topics[topic.name] = topic

    def set_publishers(self, topic: RecordedTopic, depths: Mapping[bytes, int], *, is_new: bool) -> None:
        """The publishers of `topic` that keep messages for late joiners: gid -> depth (0: all).

        `is_new`: the metadata of the topic have changed.
        """
        self._latched.set_publishers(topic.name, depths, monotonic_ns())
        if topic.channel is not None and is_new:
            self._writer.update_topic(topic.channel, topic.metadata)

    def put(self, topic: RecordedTopic, samples: Batch, *, is_paused: bool) -> None:
        """These were taken; while the recording is paused, only the state of latched topics is kept."""
        size = sum(map(len, map(_payload, samples)))
        if self._is_snapshot:
            self._keep(topic, samples, is_written=False)
        if self._thread is None:
            self._write(topic, samples, size, is_paused=is_paused)
            return
        self._cache.put(topic.name, (samples, size, is_paused), len(samples), size)

    def resume(self) -> None:
        """Write what latched topics have said while the recording was paused; it comes first."""
        for topic in tuple(self._topics.values())[:1]:
            self.put(topic, [], is_paused=False)  # an empty batch of any topic takes it along

    # --- messages out

    def pump(self) -> bool:
        """Encode and hand over what there is room for, for a while; returns whether there is more to do."""
        thread, cache = self._thread, self._cache
        if thread is None or self._is_snapshot:
            return False
        until_ns = monotonic_ns() + _TURN_NS
        while cache.waiting and thread.waiting_bytes < _MOST_IN_FLIGHT:
            name, (samples, size, is_paused), _ = cache.take()
            self._write(self._topics[name], samples, size, is_paused=is_paused)
            if monotonic_ns() >= until_ns:
                break
        return cache.waiting > 0 and thread.waiting_bytes < _MOST_IN_FLIGHT

    def flush(self) -> None:
        """Have written what was gathered."""
        if self._writer.gathered:
            self._writer.flush()

    def snapshot(self) -> None:
        """Write all that the memory has, after the state of latched topics that has left it."""
        self._settle_cache()
        batches = []
        while self._cache.waiting:
            batches.append(self._cache.take())
        present = {id(sample) for _, (samples, _, _), _ in batches for sample in samples}
        left = [one for one in self._latched.take_unwritten() if id(one.message) not in present]
        self._take_up(left)
        for name, (samples, size, is_paused), _ in batches:
            self._write(self._topics[name], samples, size, is_paused=is_paused)
        self._writer.flush()

    def split(self, log_time: int | None = None) -> None:
        """Go on in the next file, which begins with the state of latched topics, at `log_time`."""
        closed = self._writer.path(self._files - 1)
        opened = self._writer.path(self._files)
        self._files += 1
        self.write_losses()
        self._writer.split()
        if self._splitting is not None:
            self._splitting.split(self._size)
        self._run(partial(self._on_split, closed, opened), 0)
        now_ns = self._now_ns() if log_time is None else log_time
        for one in self._latched.state(monotonic_ns()):
            topic = self._topics[one.topic]
            if topic.channel is not None:
                topic.repeated += self._write_one(topic, topic.channel, one.message, now_ns)

    def write_losses(self) -> None:
        """Put the accounts into the file."""
        self._writer.write_metadata(RECORD, to_record(self.losses()))

    def _write(self, topic: RecordedTopic, samples: Batch, size: int, *, is_paused: bool) -> None:
        """`size`: bytes of the payloads."""
        if is_paused:
            topic.passed_over += len(samples)
            self._keep(topic, samples, is_written=False)
            return
        if self._latched.has_unwritten and not self._is_snapshot:
            self._take_up(self._latched.take_unwritten())
        channel = topic.channel
        if channel is None:
            channel = self._add_channel(topic)
        if self._splitting is not None and samples:
            self._split_if_due(self._splitting, samples[0])
        if len(samples) > 1 and size <= len(samples) * _SHORT and self._write_many(topic, channel, samples):
            if topic.is_latched and not self._is_snapshot:
                self._keep(topic, samples, is_written=True)
            return
        for sample in samples:
            if self._splitting is not None:
                self._split_if_due(self._splitting, sample)
            topic.written += self._write_one(topic, channel, sample, sample[1][1])
            if topic.is_latched and not self._is_snapshot:
                self._keep(topic, [sample], is_written=True)

    def _split_if_due(self, splitting: Splitting, sample: Sample) -> None:
        """Before this one is written."""
        log_time = sample[1][1]
        if splitting.is_due(self._size, log_time):
            self.split(log_time)

    def _write_many(self, topic: RecordedTopic, channel: int, samples: Batch) -> bool:
        """False, with nothing written, where one is no message of the type."""
        payloads, infos = zip(*samples, strict=True)
        try:
            messages = topic.encode_many(payloads)
        except CdrError:
            return False
        self.bytes += self._writer.write_many(channel, infos, messages)
        topic.written += len(messages)
        self.messages += len(messages)
        return True

    def _write_one(self, topic: RecordedTopic, channel: int, sample: Sample, log_time: int) -> int:
        """Returns how many were written: 1, or 0 for what is no message of the type."""
        payload, info = sample
        try:
            parts = topic.encode(payload)
        except CdrError as error:
            self._reject(topic, error)
            return 0
        self.bytes += self._writer.write(channel, log_time, info[0], info[2], parts)
        self.messages += 1
        return 1

    def _take_up(self, state: Iterable[Latched[Sample]]) -> None:
        """Write what was passed over, as the state of this moment."""
        now_ns = self._now_ns()
        for one in state:
            topic = self._topics[one.topic]
            topic.passed_over -= 1
            channel = self._add_channel(topic) if topic.channel is None else topic.channel
            topic.written += self._write_one(topic, channel, one.message, now_ns)

    def _add_channel(self, topic: RecordedTopic) -> int:
        topic.channel = self._writer.add_topic(topic.metadata, topic.encoder.definition, topic.extra)
        return topic.channel

    def _keep(self, topic: RecordedTopic, samples: Batch, *, is_written: bool) -> None:
        if topic.is_latched:
            for sample in samples:
                if self._latched.is_offered(topic.name, sample[1].publisher_gid):
                    self._latched.add(
                        topic.name, sample[1].publisher_gid, sample, len(sample[0]), is_written=is_written
                    )

    def _reject(self, topic: RecordedTopic, error: CdrError) -> None:
        topic.lose("undecodable", 1)
        self._on_reject(topic, error)

    def _settle_cache(self) -> None:
        """What the cache has lost since the last look goes to the accounts."""
        lost, self._cache.lost = self._cache.lost, {}
        for name, count in lost.items():
            if self._is_snapshot:
                self._topics[name].passed_over += count
            else:
                self._topics[name].lose("recorder_cache", count)

    # --- the end

    def drop(self) -> None:
        """Give up what is on its way to the file, but for what is being written."""
        self._settle_cache()
        for name, count in self._cache.clear().items():
            if self._is_snapshot:
                self._topics[name].passed_over += count
            else:
                self._topics[name].lose("not_written", count)
        if self._thread is not None:
            self._thread.drop()

    def close(self, patience_s: float | None = None) -> dict[str, TopicLosses]:
        """End the bag, once it is idle, has failed, or was dropped; returns the accounts.

        Raises BagError or OSError where that can't be done, as where the disk takes longer than `patience_s`.
        """
        self.drop()
        if self._thread is not None:
            if not self._thread.end(patience_s):
                raise BagError(f"the disk does not answer: '{self._writer.folder}' is left as it is")
            self._failure, self._thread = self._thread.failure, None
        self._is_ending = True
        try:
            if self._failure is None:
                for topic in self._topics.values():
                    if topic.channel is None:
                        self._add_channel(topic)
            self.flush()  # before it is counted what is in the files
        except _Faults as error:
            self._failure = self._failure or error
        counts = self._writer.counts()
        for topic in self._topics.values():
            if missing := topic.written + topic.repeated - counts.get(topic.name, 0):
                topic.written -= missing
                topic.lose("not_written", missing)
        losses = {name: one.closed() for name, one in self.losses().items()}
        self._writer.write_metadata(RECORD, to_record(losses))
        self._writer.close()
        return losses
