"""The recorder's node: finds topics, takes what comes, and ends the bag whatever happens."""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import aclosing, suppress
from functools import partial
from pathlib import Path
from time import monotonic_ns, time_ns
from typing import Any, TypeVar

from bus.errors import BusError, ConfigurationError
from bus.events import MatchedChange, SubscriptionEvents
from bus.graph import Graph
from bus.node import Node
from bus.parameters.time_source import CLOCK_QOS, CLOCK_TOPIC
from bus.qos import Durability, History
from bus.schema import MessageSchema
from bus.types.classes import message_class
from bus_bag.losses import TopicLosses
from bus_bag.record.choice import Choice, Found
from bus_bag.record.options import RecordOptions
from bus_bag.record.pipeline import Pipeline
from bus_bag.record.services import serve
from bus_bag.record.topic import RecordedTopic, profile_for
from bus_ros.cdr import CdrError

__all__ = ["Recorder"]

_BATCH = 256
_PERIOD_S = 0.9
"""How often chunks are closed that are not full: so much a crash may cost."""
_LOSSES_S = 10.0
_STRAGGLERS_S = 0.3
"""How long to wait at the end for busd's last counters."""
_PATIENCE_S = 1.0
"""How long a disk may take that is yet to take something, where the recording is to end at once."""
_SPLIT_EVENT = "rosbag2_interfaces/msg/WriteSplitEvent"

T = TypeVar("T")


class Recorder:
    """Records with `node`, which is open, until `stop`. Raises BagError, OSError and ConfigurationError where
    it can't begin.
    """

    def __init__(self, node: Node, options: RecordOptions) -> None:
        self._node = node
        self._options = options
        self._log = node.get_logger()
        self._loop = asyncio.get_running_loop()
        self._choice = Choice(options.wanted, node.full_name)
        self._topics: dict[str, RecordedTopic] = {}
        self._refused: set[Found] = set()
        self._taken: dict[RecordedTopic, None] = {}
        self._held: dict[RecordedTopic, None] = {}
        self._pumping: asyncio.Handle | None = None
        self._progress = asyncio.Event()
        self._stopped = asyncio.Event()
        self._has_begun = False
        self._is_told = self._is_hurried = False
        self._error: BaseException | None = None
        self._splits: Any = None
        self.is_paused = options.is_paused
        self.pipeline = Pipeline(
            options,
            now_ns=self.now_ns,
            on_progress=partial(self._from_thread, self._progressed),
            on_split=lambda closed, opened: self._from_thread(partial(self._tell_split, closed, opened)),
            on_reject=self._reject,
        )

    def now_ns(self) -> int:
        """The time of log times."""
        if not self._options.is_simulated:
            return time_ns()
        now: Any = self._node.now()
        return int(now.sec) * 1_000_000_000 + int(now.nanosec)

    # --- from outside

    async def run(self) -> dict[str, TopicLosses]:
        """Record until `stop`, or until nothing more can be written (`failure`); returns the accounts.

        Whatever it raises, the bag is closed with what is in it. Cancellation: the same.
        """
        tasks: list[asyncio.Task[None]] = []
        try:
            self._splits = await self._node.create_publisher(
                message_class(_SPLIT_EVENT), "events/write_split"
            )
            await serve(self._node, self)
            await self._wait_for_clock()
            self._log.info("Listening for topics...")
            tasks += [asyncio.create_task(self._discover()), asyncio.create_task(self._keep_time())]
            for task in tasks:
                task.add_done_callback(self._ended)
            await self._stopped.wait()
            for task in tasks:
                task.cancel()
            await self._finish()
        finally:
            for task in tasks:
                task.cancel()
            losses = self.pipeline.close(_PATIENCE_S if self._is_hurried else None)
        if self._error is not None:
            raise self._error
        return losses

    def _ended(self, task: "asyncio.Task[None]") -> None:
        """A task that fails ends the recording; the bag is closed with what is in it."""
        if not task.cancelled() and (error := task.exception()) is not None:
            self._error = error
            self._stopped.set()

    def stop(self) -> None:
        """End the recording; the second time without what still waits for the file."""
        if self._is_told:
            self._is_hurried = True
            self.pipeline.drop()
            self._progress.set()
        self._is_told = True
        self._stopped.set()

    @property
    def failure(self) -> BaseException | None:
        """Why nothing more can be written."""
        return self.pipeline.failure

    def pause(self) -> None:
        if not self.is_paused:
            self.toggle_paused()

    def resume(self) -> None:
        if self.is_paused:
            self.toggle_paused()

    def toggle_paused(self) -> None:
        self._take_all()
        self.is_paused = not self.is_paused
        self._log.info("Pausing recording." if self.is_paused else "Resuming recording.")
        if not self.is_paused:
            self.pipeline.resume()
            self._pump()

    def split(self) -> None:
        """Go on in the next file now."""
        self._take_all()
        self.pipeline.split()

    def snapshot(self) -> bool:
        """Write what the memory has; returns whether this recording keeps some."""
        if self._options.is_snapshot:
            self._take_all()
            self.pipeline.snapshot()
        return self._options.is_snapshot

    def lost(self) -> int:
        """Messages lost until now."""
        return sum(sum(one.lost.values()) for one in self.pipeline.losses().values())

    # --- discovery

    async def _wait_for_clock(self) -> None:
        if not self._options.is_simulated or self.now_ns():
            return
        self._log.info("use_sim_time set, waiting for /clock before starting recording...")
        clock = await self._node.create_subscription(
            message_class("rosgraph_msgs/msg/Clock"), CLOCK_TOPIC, CLOCK_QOS
        )
        receiving = asyncio.ensure_future(clock.receive())
        stopping = asyncio.ensure_future(self._stopped.wait())
        try:
            await asyncio.wait((receiving, stopping), return_when=asyncio.FIRST_COMPLETED)
            # The node's own subscription hears the same message, perhaps a moment later.
            for _ in range(1000):
                if self.now_ns() or self._stopped.is_set():
                    break
                await asyncio.sleep(0.001)
        finally:
            receiving.cancel()
            stopping.cancel()
            await clock.close()
        if not self._stopped.is_set():
            self._log.info("Sim time /clock found, starting recording.")

    async def _discover(self) -> None:
        try:
            await self._follow()
        except BusError as error:
            self._log.error(f"no more topics can be found: {error}")

    async def _follow(self) -> None:
        async with aclosing(self._node.watch_graph()) as graphs:
            async for graph in graphs:
                await self._look(graph)
                if not self._has_begun:
                    self._begin()
                if not self._options.has_discovery:
                    return

    def _begin(self) -> None:
        self._has_begun = True
        if not self.is_paused:
            self._log.info("Recording...")
        elif self._options.has_keys:
            self._log.info("Wait for recording: Press SPACE to start.")

    async def _look(self, graph: Graph) -> None:
        found, reasons = self._choice.choose(graph)
        for reason in reasons:
            self._log.warning(reason)
        new = [one for one in found if one.topic not in self._topics and one not in self._refused]
        for one in found:
            known = self._topics.get(one.topic)
            if known is not None and known.found != one and one not in self._refused:
                self._refused.add(one)
                self._log.warning(
                    f"Topic '{one.topic}' is recorded as {known.found.type_name}; what publishers of another "
                    "type send there is not recorded"
                )
        if not new:
            return
        kinds = {(one.type_name, one.type_hash) for one in new}
        schemas = dict(
            zip(kinds, await asyncio.gather(*(self._schema(*kind) for kind in kinds)), strict=True)
        )
        await asyncio.gather(
            *(
                self._subscribe(one, schema)
                for one in new
                if (schema := schemas[one.type_name, one.type_hash]) is not None
            )
        )
        if self._choice.is_complete(self._topics) and not self._stopped.is_set():
            self._log.info("All requested topics are subscribed. Stopping discovery...", once=True)

    async def _schema(self, type_name: str, type_hash: str) -> MessageSchema | None:
        """None where it has gone meanwhile."""
        with suppress(ConfigurationError):
            return await _patiently(lambda: self._node.get_schema(type_name, type_hash))
        return None

    async def _subscribe(self, found: Found, schema: MessageSchema) -> None:
        try:
            topic = RecordedTopic(found, schema)
            profile = self._options.overrides.get(found.topic)
            if profile is not None:
                self._log.info(f"Overriding subscription profile for {found.topic}")
            self._topics[found.topic] = topic
            self.pipeline.add(topic)
            events = SubscriptionEvents(matched=partial(self._meet, topic))
            subscription = await _patiently(
                lambda: self._node.create_subscription(
                    schema, found.topic, profile or profile_for(schema), events=events, raw=True
                )
            )
        except BusError as error:
            self._topics.pop(found.topic, None)
            self._refused.add(found)
            self._log.error(f"Topic '{found.topic}' is not recorded: {error}")
            return
        topic.subscription = subscription
        subscription.set_arrival_callback(partial(self._take, topic))
        self._meet(topic)
        self._take(topic)
        self._log.info(f"Subscribed to topic '{found.topic}'")
        if topic.why_json:
            self._log.warning(f"Topic '{found.topic}' is recorded as texts of JSON: {topic.why_json}")
        elif topic.encoder.as_json:
            fields = ", ".join(topic.encoder.as_json)
            self._log.warning(
                f"Topic '{found.topic}': ROS 2 can't describe {fields}; recorded as a text of JSON"
            )

    def _meet(self, topic: RecordedTopic, change: MatchedChange | None = None) -> None:
        """Publishers come and go."""
        subscription = topic.subscription
        if subscription is None:
            return
        matches = subscription.matches
        is_new = topic.meet(match.qos for match in matches)
        depths = {
            match.gid: match.qos.depth if match.qos.history is History.KEEP_LAST else 0
            for match in matches
            if match.qos.durability is Durability.TRANSIENT_LOCAL
        }
        self.pipeline.set_publishers(topic, depths, is_new=is_new)

    # --- messages

    def _take(self, topic: RecordedTopic) -> None:
        """Something has come: take it now, for the time of receipt is that of taking; write it later."""
        subscription = topic.subscription
        if subscription is None or topic.is_finished:
            return
        if subscription.qos.is_lossless and self.pipeline.is_crowded and not self._stopped.is_set():
            self._held[topic] = None  # so are its publishers, until there is room
            return
        samples = subscription.take_many(_BATCH)
        if not samples:
            return
        if len(samples) == _BATCH and topic not in self._taken:  # others have their turn first
            self._taken[topic] = None
            self._loop.call_soon(self._take_on, topic)
        if self._options.is_simulated:
            now_ns = self.now_ns()
            if not now_ns:  # the simulation has not begun
                topic.passed_over += len(samples)
                return
            samples = [(payload, info._replace(received_timestamp=now_ns)) for payload, info in samples]
        self.pipeline.put(topic, samples, is_paused=self.is_paused)
        self._pump()

    def _take_on(self, topic: RecordedTopic) -> None:
        self._taken.pop(topic, None)
        self._take(topic)

    def _take_all(self) -> None:
        """Take all that has come until now."""
        for topic in self._topics.values():
            if topic.subscription is not None:
                for _ in range(topic.subscription.statistics().queued // _BATCH + 1):
                    self._take(topic)

    def _pump(self) -> None:
        """Have the pipeline go on, behind what the loop has to do now."""
        if self._pumping is None:
            self._pumping = self._loop.call_soon(self._pump_now)

    def _pump_now(self) -> None:
        self._pumping = None
        if self.pipeline.pump():
            self._pump()
        if self._held and not self.pipeline.is_crowded:
            held, self._held = self._held, {}
            for topic in held:
                self._take(topic)
        self._look_for_failure()

    def _progressed(self) -> None:
        """The writing thread has done something."""
        self._progress.set()
        self._pump()

    def _look_for_failure(self) -> None:
        if self.pipeline.failure is not None:
            self._stopped.set()
            self._progress.set()

    def _from_thread(self, call: Callable[[], object]) -> None:
        with suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(call)

    def _reject(self, topic: RecordedTopic, error: CdrError) -> None:
        self._log.warning(f"A message on '{topic.name}' is not recorded: {error}", throttle_duration_sec=5.0)

    def _tell_split(self, closed: Path, opened: Path) -> None:
        event: Any = message_class(_SPLIT_EVENT)
        with suppress(BusError):
            self._splits.publish(event(closed_file=str(closed), opened_file=str(opened)))

    # --- time and the end

    async def _keep_time(self) -> None:
        due_ns = monotonic_ns() + int(_LOSSES_S * 1e9)
        while True:
            await asyncio.sleep(_PERIOD_S)
            self.pipeline.flush()
            if monotonic_ns() >= due_ns:
                due_ns = monotonic_ns() + int(_LOSSES_S * 1e9)
                self.pipeline.write_losses()
            self._look_for_failure()

    async def _finish(self) -> None:
        """Take what has come, until the accounts close; then write it."""
        end_s = self._loop.time() + _STRAGGLERS_S
        while self.failure is None:
            self._take_all()
            if all(one.is_settled for one in self._topics.values()) or self._loop.time() > end_s:
                break
            await asyncio.sleep(0.02)
        for topic in self._topics.values():
            topic.finish()
        while not (self._is_hurried or self.failure is not None or self.pipeline.is_idle):
            self._progress.clear()
            if self.pipeline.pump():
                await asyncio.sleep(0)
                continue
            self.pipeline.flush()
            if not self.pipeline.is_idle and self.failure is None:
                await self._progress.wait()


async def _patiently(ask: Callable[[], Awaitable[T]]) -> T:
    """What busd answers. One that says nothing for long is asked again: a recording goes on meanwhile."""
    while True:
        with suppress(TimeoutError):
            return await ask()
