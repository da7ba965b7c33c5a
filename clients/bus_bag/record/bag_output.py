"""Writes messages of topics into the files of a bag: encodes them, and splits the bag by the options.

Each further file begins with the state of the latched topics, so it can be played alone. While a recording is
paused, only that state is kept. It is written when the recording continues.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from time import monotonic_ns

from bus.vocabulary import DropReason
from bus_bag.record.batch import Batch, Packed, Sample, Samples
from bus_bag.record.latched import Latched, LatchedState
from bus_bag.record.options import RecordOptions
from bus_bag.record.splitting import Splitting
from bus_bag.record.topic import RecordedTopic
from bus_bag.storage import BagWriter
from bus_ros.cdr import CdrError

__all__ = ["BagOutput"]

_SHORT = 4 << 10
"""Batches of messages with at most this average size go into a chunk as a whole."""


class BagOutput:
    """Writes to `writer`. `now_ns` is the clock of log times.

    `size()` is the number of bytes of messages in all files, or on their way there. `before_split()` is
    called before a further file begins, `on_reject(topic, error)` for a message that does not have its type.
    """

    def __init__(
        self,
        writer: BagWriter,
        options: RecordOptions,
        *,
        now_ns: Callable[[], int],
        size: Callable[[], int],
        before_split: Callable[[], object],
        on_reject: Callable[[RecordedTopic, CdrError], object],
    ) -> None:
        self._writer = writer
        self._now_ns = now_ns
        self._size = size
        self._before_split = before_split
        self._on_reject = on_reject
        self._is_snapshot = options.is_snapshot
        splitting = Splitting(options.max_bag_size, options.max_bag_duration)
        self._splitting = splitting if splitting else None
        self._latched: LatchedState[Sample] = LatchedState()
        self.topics: dict[str, RecordedTopic] = {}
        """Recorded topics by name."""
        self.messages = 0
        """Number of messages passed to the file."""
        self.bytes = 0

    def set_publishers(self, topic: RecordedTopic, depths: Mapping[bytes, int]) -> None:
        """See `Pipeline.set_publishers`."""
        self._latched.set_publishers(topic.name, depths, monotonic_ns())

    def describe_topics(self) -> None:
        """Add all topics to the bag, also those without messages."""
        for topic in self.topics.values():
            self._channel(topic)

    def write(self, topic: RecordedTopic, batch: Batch, *, is_paused: bool) -> None:
        """Write messages. `is_paused`: handle them as messages of a pause."""
        if is_paused:
            topic.passed_over += batch.count
            self.keep(topic, batch, is_written=False)
            return
        if self._latched.has_unwritten:
            self.resume(batch.log_time)
        channel = topic.channel
        if channel is None:
            channel = self._channel(topic)
        if self._splitting is not None:
            self._split_if_due(self._splitting, batch.log_time)
        if self._write_whole(topic, channel, batch):
            if topic.is_latched and not self._is_snapshot:
                self.keep(topic, batch, is_written=True)
            return
        for sample in batch.samples():  # one of them may not have the type
            if self._splitting is not None:
                self._split_if_due(self._splitting, sample[1][1])
            written = self._write_one(topic, channel, sample, sample[1][1])
            topic.written += written
            if written and topic.is_latched and not self._is_snapshot:
                self.keep(topic, Samples([sample]), is_written=True)

    def write_state_before(self, batches: Sequence[Batch]) -> None:
        """Write the unwritten state of latched topics, without the messages in `batches`, which follow it. It
        gets the time of the first of them, because readers sort by time."""
        log_time = min((batch.log_time for batch in batches), default=self._now_ns())
        present = {id(one) for batch in batches if isinstance(batch, Samples) for one in batch.samples()}
        unwritten = self._latched.take_unwritten()
        self._write_state([one for one in unwritten if id(one.message) not in present], log_time)

    def keep(self, topic: RecordedTopic, batch: Batch, *, is_written: bool) -> None:
        """Keep the state of a topic if its publishers keep messages for late joiners."""
        if topic.is_latched:
            if isinstance(batch, Packed):
                samples = batch.samples(self._latched.depth(topic.name, batch.publisher_gid))
            else:
                samples = batch.samples()
            for sample in samples:
                if self._latched.depth(topic.name, sample[1].publisher_gid):
                    self._latched.add(
                        topic.name, sample[1].publisher_gid, sample, len(sample[0]), is_written=is_written
                    )

    def resume(self, log_time: int) -> None:
        """Write the latched messages of a pause that ends at `log_time`."""
        if not self._is_snapshot:
            self._write_state(self._latched.take_unwritten(), log_time)

    def split(self, log_time: int) -> None:
        """Continue in the next file. It begins with the state of latched topics, at `log_time`."""
        self._before_split()
        self._writer.split()
        for one in self._latched.state(monotonic_ns()):
            if one.is_written:
                topic = self.topics[one.topic]
                topic.repeated += self._write_one(topic, self._channel(topic), one.message, log_time)
            elif not self._is_snapshot:  # a pause has brought it; a snapshot writes its memory only if called
                self._write_state([one], log_time)
        if not self._is_snapshot:
            self._latched.mark_written()
        if self._splitting is not None:  # only now: the limit of bytes does not cover the state
            self._splitting.split(self._size())

    def _split_if_due(self, splitting: Splitting, log_time: int) -> None:
        """Begin a further file before a message of that time if that is due."""
        if splitting.is_due(self._size(), log_time):
            self.split(log_time)

    def _write_whole(self, topic: RecordedTopic, channel: int, batch: Batch) -> bool:
        """Write all messages in few steps; returns False without writing if that can't be done."""
        taken = 0
        if isinstance(batch, Packed) and topic.program is not None:
            taken = self._writer.write_packed(channel, batch.log_time, batch.data, topic.program.records)
        if not taken and batch.count > 1 and batch.size <= batch.count * _SHORT:
            taken = self._write_many(topic, channel, batch)
        if not taken:
            return False
        self.bytes += taken
        topic.written += batch.count
        self.messages += batch.count
        return True

    def _write_many(self, topic: RecordedTopic, channel: int, batch: Batch) -> int:
        """Write several short messages; returns the bytes, or 0 if one may not have the type."""
        payloads, infos = zip(*batch.samples(), strict=True)
        try:
            return self._writer.write_many(channel, infos, topic.encode_many(payloads))
        except CdrError:
            return 0

    def _write_one(self, topic: RecordedTopic, channel: int, sample: Sample, log_time: int) -> int:
        """Write one message; returns 1, or 0 if it does not have the type."""
        payload, info = sample
        try:
            parts = topic.encode(payload)
        except CdrError as error:
            topic.lose(DropReason.UNDECODABLE, 1)
            self._latched.forget(topic.name, info.publisher_gid, sample)  # so it is lost once
            self._on_reject(topic, error)
            return 0
        self.bytes += self._writer.write(channel, log_time, info[0], info[2], parts)
        self.messages += 1
        return 1

    def _write_state(self, state: Iterable[Latched[Sample]], log_time: int) -> None:
        """Write kept messages, as the state of that time."""
        for one in state:
            topic = self.topics[one.topic]
            topic.passed_over -= 1
            topic.written += self._write_one(topic, self._channel(topic), one.message, log_time)

    def _channel(self, topic: RecordedTopic) -> int:
        """The topic's channel; adds the topic to the bag before its first message."""
        if topic.channel is None:
            topic.channel = self._writer.add_topic(topic.metadata, topic.encoder.definition, topic.extra)
        return topic.channel
