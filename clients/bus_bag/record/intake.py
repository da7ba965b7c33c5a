"""Moves messages from the subscriptions into the pipeline.

Taking messages goes before writing. The time of receipt is the time at which a message is taken. So messages
are taken at once. The pipeline runs after all other pending work of the event loop.
"""

import asyncio
from collections.abc import Iterable

from bus_bag.record.clock import RecordingClock
from bus_bag.record.pipeline import Pipeline
from bus_bag.record.state import RecordingLife
from bus_bag.record.topic import RecordedTopic

__all__ = ["Intake"]

_BATCH = 256


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

    def take(self, topic: RecordedTopic) -> None:
        """Take messages of `topic` now, if some have arrived, and write them later."""
        subscription = topic.subscription
        if subscription is None or topic.final is not None:
            return
        if topic.is_lossless and self._pipeline.is_crowded and not self._life.is_ending:
            self._held[topic] = None
            return
        samples = subscription.take_many(_BATCH)
        if not samples:
            return
        if len(samples) == _BATCH and topic not in self._unfinished:  # continue later, after other callbacks
            self._unfinished[topic] = None
            self._loop.call_soon(self._take_more, topic)
        if self._clock.is_simulated:
            now_ns = self._clock.now_ns()
            if not now_ns:  # the simulation has not begun
                topic.passed_over += len(samples)
                return
            samples = [(payload, info._replace(received_timestamp=now_ns)) for payload, info in samples]
        self._pipeline.put(topic, samples, is_paused=self.is_paused)
        if self._pumping is None:
            self._pumping = self._loop.call_soon(self._pump_now)

    def take_all(self, topics: Iterable[RecordedTopic]) -> None:
        """Take all messages that have arrived so far."""
        for topic in topics:
            if topic.subscription is not None:
                for _ in range(topic.subscription.statistics().queued // _BATCH + 1):
                    self.take(topic)

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
