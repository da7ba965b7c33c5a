"""Moves messages from the subscriptions into the pipeline.

Taking messages has priority over writing. The time of receipt is the time at which a message is taken. So
messages are taken at once. The pipeline runs after all other pending work of the event loop.
"""

import asyncio
from collections.abc import Iterable
from typing import Any

from bus.subscription import Subscription
from bus_bag.record.batch import Batch, Packed, Samples
from bus_bag.record.clock import RecordingClock
from bus_bag.record.pipeline import Pipeline
from bus_bag.record.state import RecordingLife
from bus_bag.record.topic import RecordedTopic

__all__ = ["Intake"]

_BATCH = 256
_PACK_BYTES = 256 << 10
"""Most bytes of messages in one buffer. They have one log time: at 1 KiB they are as many as a batch has."""
_LONG_BYTES = 16 << 10
"""Messages of this size are taken one by one, and written without a copy."""


class Intake:
    """Takes the messages of one recording. Make it on the event loop.

    While the pipeline is crowded, messages of lossless topics are not taken, so their publishers wait. At the
    end of the recording, all messages that have arrived are taken.
    """

    def __init__(
        self, pipeline: Pipeline, clock: RecordingClock, life: RecordingLife, *, is_paused: bool
    ) -> None:
        self.is_paused = is_paused
        """Whether taken messages are not recorded."""
        self._loop = asyncio.get_running_loop()
        self._pipeline = pipeline
        self._clock = clock
        self._life = life
        self._unfinished: dict[RecordedTopic, None] = {}
        """Topics that may have more messages than one call takes."""
        self._held: dict[RecordedTopic, None] = {}
        """Lossless topics that wait for room."""
        self._pumping: asyncio.Handle | None = None

    def take(self, topic: RecordedTopic) -> int:
        """Take messages of `topic` now, if some have arrived, and write them later; returns their number."""
        subscription = topic.subscription
        if subscription is None or topic.final is not None:
            return 0
        if topic.is_lossless and self._pipeline.is_crowded and not self._life.is_ending:
            self._held[topic] = None
            return 0
        now_ns = self._clock.now_ns() if self._clock.is_simulated else None
        batch, has_more = self._next(topic, subscription, now_ns)
        if batch is None:
            return 0
        if has_more and topic not in self._unfinished:  # continue later, after other callbacks
            self._unfinished[topic] = None
            self._loop.call_soon(self._take_more, topic)
        has_time = now_ns != 0  # a simulation that begins again has none at first
        self._pipeline.put(topic, batch, is_paused=self.is_paused or not has_time)
        if self._pumping is None:
            self._pumping = self._loop.call_soon(self._pump_now)
        return batch.count

    def _next(
        self, topic: RecordedTopic, subscription: Subscription[Any], now_ns: int | None
    ) -> tuple[Batch | None, bool]:
        """The next messages, with the log time `now_ns` if it is given, and whether more may wait. None if no
        message has arrived."""
        if self._pipeline.takes_packs(topic):
            # Latched messages are kept for each publisher, which a merged buffer does not name.
            is_latched = topic.is_latched
            if not is_latched or subscription.get_publisher_count() == 1:
                pack = subscription.take_packed(_PACK_BYTES, _LONG_BYTES, merges=not is_latched)
                if pack is not None:
                    return Packed(pack, now_ns), pack.has_more
        samples = subscription.take_many(_BATCH)
        if not samples:
            return None, False
        if now_ns:
            samples = [(payload, info._replace(received_timestamp=now_ns)) for payload, info in samples]
        return Samples(samples), len(samples) == _BATCH

    def take_all(self, topics: Iterable[RecordedTopic]) -> None:
        """Take all messages that have arrived so far."""
        for topic in topics:
            if topic.subscription is not None:
                left = topic.subscription.statistics().queued
                while taken := self.take(topic):
                    left -= taken
                    if left <= 0:  # later messages don't keep the recorder from its end
                        break

    def pump(self) -> None:
        """Let the pipeline continue after the pending work of the loop."""
        if self._pumping is None:
            self._pumping = self._loop.call_soon(self._pump_now)

    def _take_more(self, topic: RecordedTopic) -> None:
        self._unfinished.pop(topic, None)
        self.take(topic)

    def _pump_now(self) -> None:
        self._pumping = None
        if self._pipeline.pump():
            self.pump()
        if self._held and not self._pipeline.is_crowded:
            held, self._held = self._held, {}
            for topic in held:
                self.take(topic)
