"""The recorder: the parts of a recording, the requests to it, and the end of the bag in every case.

Its states and their transitions are in `record/state.py`.
"""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from time import monotonic_ns
from typing import Any

from bus.errors import BusError
from bus.node import Node
from bus.types.classes import message_class
from bus_bag.losses import TopicLosses
from bus_bag.record.choice import Choice
from bus_bag.record.clock import RecordingClock
from bus_bag.record.discovery import Discovery
from bus_bag.record.intake import Intake
from bus_bag.record.options import RecordOptions
from bus_bag.record.pipeline import Pipeline
from bus_bag.record.services import serve
from bus_bag.record.state import RecordingEvent, RecordingLife, RecordingState
from bus_bag.record.topic import RecordedTopic
from bus_ros.cdr import CdrError

__all__ = ["Recorder"]

_PERIOD_S = 0.9
"""Period in which incomplete chunks are closed: a crash loses at most this time."""
_LOSSES_S = 10.0
_STRAGGLERS_S = 0.3
"""Time to wait at the end for busd's last messages, and then for its last counters."""
_PATIENCE_S = 1.0
"""Time that a disk may take for pending data if the recording must end at once."""
_SPLIT_EVENT = "rosbag2_interfaces/msg/WriteSplitEvent"


class Recorder:
    """Records with the open `node` until `stop`. Raises BagError, OSError and ConfigurationError if it can't
    begin."""

    def __init__(self, node: Node, options: RecordOptions) -> None:
        self._node = node
        self._options = options
        self._log = node.get_logger()
        self._loop = asyncio.get_running_loop()
        self._life = RecordingLife()
        self._stopped = asyncio.Event()
        """Set when it must not continue: see `RecordingLife.is_ending`."""
        self._progress = asyncio.Event()
        """Set after each job of the writing thread."""
        self._error: BaseException | None = None
        self._splits: Any = None
        self._clock = RecordingClock(node, is_simulated=options.is_simulated)
        choice = Choice(options.wanted, node.full_name)  # before the folder: patterns may be invalid
        self.pipeline = Pipeline(
            options,
            now_ns=self._clock.now_ns,
            on_progress=partial(self._from_thread, self._progressed),
            on_split=lambda closed, opened: self._from_thread(partial(self._report_split, closed, opened)),
            on_reject=self._reject,
        )
        self._intake = Intake(self.pipeline, self._clock, self._life, is_paused=options.is_paused)
        self._discovery = Discovery(
            node, options, choice, self.pipeline, on_arrival=self._intake.take, on_graph=self._begin
        )

    # --- commands

    async def run(self) -> dict[str, TopicLosses]:
        """Record until `stop`, or until nothing more can be written (`failure`); returns the counters.

        Also after an error, the bag is closed with its contents. The same is true for cancellation.
        """
        tasks: list[asyncio.Task[None]] = []
        try:
            self._splits = await self._node.create_publisher(
                message_class(_SPLIT_EVENT), "events/write_split"
            )
            await serve(self._node, self)
            await self._clock.wait_for_begin(self._stopped)
            self._log.info("Listening for topics...")
            tasks += [asyncio.create_task(self._discovery.run()), asyncio.create_task(self._keep_time())]
            for task in tasks:
                task.add_done_callback(self._ended)
            await self._stopped.wait()
            for task in tasks:
                task.cancel()
            await self._finish()
        finally:
            for task in tasks:
                task.cancel()
            patience_s = _PATIENCE_S if self.state is RecordingState.HURRYING else None
            self._life.on(RecordingEvent.CLOSE)
            losses = self.pipeline.close(patience_s)
        if self._error is not None:
            raise self._error
        return losses

    def stop(self) -> None:
        """End the recording. The second call drops messages that still wait for the file."""
        if self._life.on(RecordingEvent.STOP) is RecordingState.HURRYING:
            self.pipeline.drop()
            self._progress.set()
        self._stopped.set()

    def pause(self) -> None:
        if not self.is_paused:
            self.toggle_paused()

    def resume(self) -> None:
        if self.is_paused:
            self.toggle_paused()

    def toggle_paused(self) -> None:
        self._take_all()
        self._intake.is_paused = not self.is_paused
        self._log.info("Pausing recording." if self.is_paused else "Resuming recording.")
        if not self.is_paused:
            self.pipeline.resume()
            self._intake.pump()

    def split(self) -> None:
        """Continue in the next file now."""
        self._take_all()
        self.pipeline.split()
        self._intake.pump()

    def snapshot(self) -> bool:
        """Write the messages in memory; returns whether this recording keeps any."""
        if self._options.is_snapshot:
            self._take_all()
            count = self.pipeline.snapshot()
            self._log.info(f"Writing a snapshot: {count} {'message' if count == 1 else 'messages'}.")
        return self._options.is_snapshot

    # --- state

    @property
    def state(self) -> RecordingState:
        return self._life.state

    @property
    def failure(self) -> BaseException | None:
        """The reason why nothing more can be written."""
        return self.pipeline.failure

    @property
    def is_paused(self) -> bool:
        return self._intake.is_paused

    def lost(self) -> int:
        """Number of messages lost so far."""
        return sum(sum(one.lost.values()) for one in self.pipeline.losses().values())

    # --- events

    def _begin(self) -> None:
        """All topics of a graph are subscribed. After the first graph, the recording begins."""
        if self.state is not RecordingState.STARTING:
            return
        self._life.on(RecordingEvent.BEGIN)
        if not self.is_paused:
            self._log.info("Recording...")
        elif self._options.has_keys:
            self._log.info("Wait for recording: Press SPACE to start.")

    def _take_all(self) -> None:
        self._intake.take_all(self._discovery.topics.values())

    async def _keep_time(self) -> None:
        due_ns = monotonic_ns() + int(_LOSSES_S * 1e9)
        while True:
            await asyncio.sleep(_PERIOD_S)
            self.pipeline.flush()
            self.pipeline.note_losses(is_away=not self._node.is_connected)
            if monotonic_ns() >= due_ns:
                due_ns = monotonic_ns() + int(_LOSSES_S * 1e9)
                self.pipeline.write_losses()

    def _progressed(self) -> None:
        """Handle progress or a failure of the writing thread."""
        if self.failure is not None:
            self._life.on(RecordingEvent.FAIL)
            self._stopped.set()
        self._progress.set()
        self._intake.pump()

    def _ended(self, task: "asyncio.Task[None]") -> None:
        """Handle the end of a task. A failed task ends the recording; the bag is closed with its contents."""
        if not task.cancelled() and (error := task.exception()) is not None:
            self._error = error
            self._life.on(RecordingEvent.FAIL)
            self._stopped.set()

    def _from_thread(self, call: Callable[[], object]) -> None:
        with suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(call)

    def _reject(self, topic: RecordedTopic, error: CdrError) -> None:
        self._log.warning(f"A message on '{topic.name}' is not recorded: {error}", throttle_duration_sec=5.0)

    def _report_split(self, closed: Path, opened: Path) -> None:
        event: Any = message_class(_SPLIT_EVENT)
        with suppress(BusError):
            self._splits.publish(
                event(closed_file=str(closed), opened_file=str(opened), node_name=self._node.full_name)
            )

    # --- the end

    async def _wait_for_busd(self) -> None:
        """Wait until busd has delivered the messages that it received before.

        By socket, a message counts as expected only after its arrival here. So the counters also add up while
        busd has messages for this recorder. busd may answer the first request before it has read the
        messages that arrived at the same moment, but not the second one.
        """
        with suppress(BusError, TimeoutError):
            async with asyncio.timeout(_STRAGGLERS_S):
                for _ in range(2):
                    await self._node.graph()

    async def _finish(self) -> None:
        """Take all messages until the counters add up, then write them."""
        if self.failure is None:
            await self._wait_for_busd()
        topics = self._discovery.topics.values()
        end_s = self._loop.time() + _STRAGGLERS_S
        while self.failure is None:
            self._take_all()
            if all(one.is_settled for one in topics) or self._loop.time() > end_s:
                break
            await asyncio.sleep(0.02)
        for topic in topics:
            topic.finish()
        self.pipeline.finish()
        while not (
            self.state is RecordingState.HURRYING or self.failure is not None or self.pipeline.is_idle
        ):
            self._progress.clear()
            if self.pipeline.pump():
                await asyncio.sleep(0)
                continue
            self.pipeline.flush()
            if not self.pipeline.is_idle and self.failure is None:
                await self._progress.wait()
