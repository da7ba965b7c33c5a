"""Publishers: typed messages in, runs of samples out.

A message is checked, encoded and stamped in `publish`. It leaves at once, but where the one before left a
moment ago: then it is gathered with those that follow into a run, which leaves when it is full or when the
turn of the event loop ends. So a paced publisher has the latency of one system call, and a flood its
throughput.
"""

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable
from threading import get_ident
from time import monotonic_ns
from typing import Any, TypeVar

import msgspec

from bus.endpoint import Endpoint
from bus.errors import BusError, ConnectionClosed, PayloadTooLarge
from bus.events import LivelinessLost, PublisherEvents
from bus.link import GATHER_NS, Link
from bus.logger import Logger
from bus.qos import Durability, History, QoSProfile
from bus.threadqueue import ThreadQueue
from bus.transport.memory import LARGE_BYTES, keep_freed_memory
from bus.typesupport import TypeSupport, wrong_class
from bus.wire import messages as m
from bus.wire.layout import MAX_MESSAGE_BYTES, RECORD_HEAD, RECORD_HEAD_BYTES, RUN_BYTES
from bus.wire.runs import Account, Buffer, Run, RunQueue, data_head

M = TypeVar("M", bound=msgspec.Struct)

_SHORT_BYTES = 4096
_QUEUE_BYTES = 64 << 20
_DRAIN_S = 5.0
_ENCODE_ERRORS = (ValueError, TypeError, AttributeError, BufferError, OverflowError, RecursionError)
_pack_record = RECORD_HEAD.pack


class PublisherStatistics(msgspec.Struct, frozen=True):
    """Totals of one publisher."""

    published: int
    """Messages that `publish` accepted."""
    bytes: int
    """Their encoded size."""
    queued: int
    """Messages not yet handed over to the broker."""
    replaced: int
    """Messages that the depth, or a bound of 64 MiB, replaced before they were handed over."""
    refused: int
    """Calls of `publish` that found no room (reliable + keep all)."""
    subscriptions: int
    """Subscriptions matched now."""


class Publisher(Endpoint[M]):
    """Publishes messages of one type on one topic; made by `Node.create_publisher`."""

    kind = "publisher"

    def __init__(
        self,
        link: Link,
        node: str,
        topic: str,
        support: TypeSupport[M],
        qos: QoSProfile,
        events: PublisherEvents,
        logger: Logger,
        on_error: Callable[[BaseException], None],
    ) -> None:
        super().__init__(link, node, topic, support, qos, events, logger, on_error)
        keeps_all = qos.history is History.KEEP_ALL
        depth = 0 if keeps_all else qos.depth
        self._encode = support.encode
        self._is_valid = support.is_valid
        self._max_bytes = MAX_MESSAGE_BYTES
        self._queue = RunQueue(depth, Account(_QUEUE_BYTES))
        keeps_history = qos.durability is Durability.TRANSIENT_LOCAL
        self._history = RunQueue(depth, Account(_QUEUE_BYTES)) if keeps_history else None
        self._next_seq = 1
        self.samples = 0
        self.bytes = 0
        # The run that is open: heads and payloads in turn, and how many more bytes may go into it.
        self._parts: list[Buffer] = []
        self._budget = 0
        self._full_parts = 2 * depth or 1 << 30
        self._thread = link.thread
        self._replaced = 0
        self._refused = 0
        self._lost_liveliness = 0
        # Back-pressure: what was handed over and not yet taken by all.
        self._is_windowed = qos.is_lossless
        self._window_samples = 0
        self._window_bytes = 0
        self._credited = 0
        self._flying_bytes = 0
        self._flying: deque[tuple[int, int]] = deque()
        self._room_waiters: deque[asyncio.Future[None]] = deque()
        self._from_threads = ThreadQueue(_QUEUE_BYTES)
        self._watch_deadline()

    def publish(self, message: M) -> bool:
        """Publish `message`; never blocks, and may be called from any thread.

        Returns False only where the QoS is reliable + keep all and there is no room until the subscriptions
        have taken more: then the message was not published, and that is counted (see `send`).

        Raises MessageTypeError for a message of another class or with a field of the wrong type,
        PayloadTooLarge above the topic's limit, ConnectionClosed after `close`.
        """
        if message.__class__ is not self.type:
            raise wrong_class(self.type, message)
        if not self._is_valid(message):
            error = self.support.explain(message)
            if error is not None:
                raise error
        try:
            payload = self._encode(message)
        except _ENCODE_ERRORS as error:
            raise self.support.explain(message) or error from None
        size = len(payload)
        # The short way, for a sample that goes into a run which is open and has room: all other questions
        # were answered when the run was opened. It is what a flood consists of, hence without a call more.
        budget, parts = self._budget - size, self._parts
        if budget < 0 or len(parts) >= self._full_parts or get_ident() != self._thread:
            return self._put(payload, size)
        self._budget = budget - RECORD_HEAD_BYTES
        parts += (_pack_record(size, monotonic_ns()), payload)
        return True

    def publish_encoded(self, payload: Buffer) -> bool:
        """Publish a message that is encoded already; as `publish`, but nothing checks its type here."""
        return self._put(payload, len(payload))

    async def send(self, message: M) -> None:
        """Publish `message`, and wait for room first where the QoS is reliable + keep all.

        Cancellation: the message was not published. Raises what `publish` raises.
        """
        while not self.publish(message):
            self._refused -= 1  # it is not given up
            await self._wait_for_room()

    async def flush(self) -> None:
        """Wait until everything published has been given to the broker's socket, also across its restart.

        Raises ConnectionClosed where the link ends first. Cancellation: nothing is lost.
        """
        self._collect_from_threads()
        self.hand_over()
        self._link.flush()
        await self._link.wait_for_drain(self._queue)

    async def wait_for_subscriptions(self, number: int = 1) -> None:
        """Wait until at least `number` subscriptions are matched. Cancellation leaves nothing behind."""
        await self._wait_for_matches(number)

    def get_subscription_count(self) -> int:
        """Subscriptions matched now."""
        return len(self._matches)

    def assert_liveliness(self) -> None:
        """Say that this publisher lives, without publishing (liveliness manual by topic)."""
        if self.refusal is not None:
            raise self.refusal
        self._link.send_about(self, m.AssertLiveliness(publisher=self.id))

    def statistics(self) -> PublisherStatistics:
        return PublisherStatistics(
            published=self.samples + len(self._parts) // 2,
            bytes=self.bytes + sum(map(len, self._parts[1::2])),
            queued=self._queue.count + len(self._parts) // 2,
            replaced=self._replaced,
            refused=self._refused,
            subscriptions=len(self._matches),
        )

    # --- for the link

    def hand_over(self) -> None:
        """End the open run and send it, or queue it where the broker does not take it now."""
        samples = len(self._parts) // 2
        if not samples:
            return
        body = b"".join(self._parts)
        first_seq = self._next_seq
        self._parts.clear()
        self._budget = 0
        self._next_seq += samples
        if self._is_windowed:
            self._flying.append((self._next_seq - 1, len(body)))
            self._flying_bytes += len(body)
        if self._history is not None:
            self._history.push(Run(0, 0, first_seq, samples, body))
            self._history.drop_over_quota(spare=1)
        link = self._link
        if not (
            # Nothing waits: past the queues, which are most of what one message costs at a moderate rate.
            self.id
            and not self._queue.runs
            and len(body) < _SHORT_BYTES
            and link.send_now(data_head(self.id, first_seq, samples, len(body)) + body)
        ):
            self._queue_run(Run(0, 0, first_seq, samples, body))
        self.samples += samples
        self.bytes += len(body) - samples * RECORD_HEAD_BYTES
        if self.qos.deadline is not None:
            self._last_ns = monotonic_ns()
        link.report(self)

    def _queue_run(self, run: Run) -> None:
        self._replaced += self._queue.push(run)
        self._replaced += self._queue.drop_over_quota(spare=1)
        if self.id:
            self._link.make_ready(self._queue)
            self._link.flush()

    def declaration(self, request: int, node: int) -> m.Message:
        return m.CreatePublisher(
            request=request,
            node=node,
            topic=self.topic_name,
            type_name=self.support.name,
            type_hash=self.support.hash,
            qos=self.qos,
            gid=self.gid,
            next_seq=self._first_seq_to_send(),
        )

    def declared(self, answer: m.Created) -> None:
        super().declared(answer)
        self._max_bytes = answer.max_message_bytes
        limit = max(_QUEUE_BYTES, answer.max_message_bytes + RUN_BYTES)
        self._queue.account.limit = limit
        if self._history is not None:
            self._history.account.limit = limit
        self._window_samples = answer.window_samples
        self._window_bytes = answer.window_bytes
        self._full_parts = 2 * answer.depth or 1 << 30
        self._queue.set_depth(answer.depth)
        self._queue.endpoint = answer.id
        if self._history is not None:
            # What waits is the end of the history, so the history alone tells a new broker everything.
            self._queue.clear()
            for run in self._history.newest(0, 0):
                run.is_replay = False
                self._queue.push(run)
        self._credit(self._first_seq_to_send() - 1)
        if self._queue.runs:
            self._link.make_ready(self._queue)

    def disconnected(self) -> None:
        super().disconnected()
        self.id = 0
        self._queue.is_ready = False  # the outbox that knew it is gone

    def handle(self, message: Any) -> None:
        if isinstance(message, m.Credit):
            self._credit(message.seq)
        elif isinstance(message, m.LivelinessLost):
            self._lost_liveliness += 1
            self._tell(self._events.liveliness_lost, LivelinessLost(self._lost_liveliness, 1))
        else:
            super().handle(message)

    def totals(self) -> m.Report:
        """This publisher's counters, for the graph."""
        dropped = {"replaced": self._replaced} if self._replaced else {}
        return m.Report(
            endpoint=self.id,
            samples=self.samples,
            bytes=self.bytes,
            queued=self._queue.count,
            dropped=dropped,
        )

    def end(self, reason: Any) -> None:
        super().end(reason)
        self._parts.clear()
        self._budget = 0
        self._queue.clear()
        while self._room_waiters:
            waiter = self._room_waiters.popleft()
            if not waiter.done():
                waiter.set_exception(reason)

    def abandon(self, reason: BusError) -> None:
        super().abandon(reason)
        self._parts.clear()
        self._budget = 0

    # --- inside

    def _first_seq_to_send(self) -> int:
        waiting = self._history if self._history is not None else self._queue
        return waiting.runs[0].first_seq + waiting.skipped if waiting.runs else self._next_seq

    def _put(self, payload: Buffer, size: int) -> bool:
        """Publish a sample as the first of a new run, after all that can stand against it was looked at."""
        if self.refusal is not None:
            raise self.refusal
        if size > self._max_bytes:
            raise PayloadTooLarge(self.topic_name, size_bytes=size, limit_bytes=self._max_bytes)
        if size >= LARGE_BYTES:
            keep_freed_memory()
        stamp_ns = monotonic_ns()
        if get_ident() != self._thread:
            return self._publish_from_thread(bytes(payload), stamp_ns)
        if self._parts:
            self.hand_over()
        room = self._room() if self._is_windowed else RUN_BYTES
        if room < size + RECORD_HEAD_BYTES and self._is_windowed and self._flying:
            self._refused += 1
            return False
        self._parts += (_pack_record(size, stamp_ns), payload)
        link = self._link
        if stamp_ns - link.last_sent_ns < GATHER_NS:
            self._budget = max(0, min(room, RUN_BYTES, self._max_bytes) - size - 2 * RECORD_HEAD_BYTES)
            link.gather(self)
        else:
            link.last_sent_ns = stamp_ns
            self.hand_over()
        return True

    def _room(self) -> int:
        """Bytes that a keep-all publisher may still take before somebody takes something from it."""
        if self._next_seq - 1 - self._credited + self._from_threads.count >= self._window_samples:
            return 0
        return self._window_bytes - self._flying_bytes - self._from_threads.held_bytes

    def _credit(self, seq: int) -> None:
        self._credited = max(self._credited, seq)
        while self._flying and self._flying[0][0] <= seq:
            self._flying_bytes -= self._flying.popleft()[1]
        while self._room_waiters:
            waiter = self._room_waiters.popleft()
            if not waiter.done():
                waiter.set_result(None)

    async def _wait_for_room(self) -> None:
        # There is none because something is on its way: hand it over, and credit will come.
        self.hand_over()
        waiter = asyncio.get_running_loop().create_future()
        self._room_waiters.append(waiter)
        await waiter

    def _publish_from_thread(self, payload: bytes, stamp_ns: int) -> bool:
        waiting = self._from_threads
        is_ahead = self._is_windowed and (self._flying or waiting.count)
        if is_ahead and self._room() < len(payload) + RECORD_HEAD_BYTES:
            self._refused += 1
            return False
        if waiting.put(payload, stamp_ns, self._full_parts // 2):
            try:
                self._link.loop.call_soon_threadsafe(self._collect_from_threads)
            except RuntimeError:
                raise ConnectionClosed(f"the event loop of '{self.topic_name}' has ended") from None
        return True

    def _collect_from_threads(self) -> None:
        """Publish, on the event loop, what other threads have published."""
        batch = self._from_threads.take()
        if self.refusal is None:
            self.hand_over()
            # Those that were replaced keep their numbers: the gap is how the subscriptions learn of them.
            self._next_seq += batch.skipped
            self.samples += batch.skipped
            self._replaced += batch.skipped
            held = 0
            for payload, stamp_ns in batch.samples:
                size = len(payload) + RECORD_HEAD_BYTES
                if held and (held + size > RUN_BYTES or len(self._parts) >= self._full_parts):
                    self.hand_over()
                    held = 0
                self._parts += (_pack_record(len(payload), stamp_ns), payload)
                held += size
            self.hand_over()
        self._from_threads.handed_over(batch)

    async def _drain(self) -> None:
        """Before the end: hand over what can be handed over in a bounded time; the log tells of the rest."""
        with contextlib.suppress(TimeoutError, ConnectionClosed):
            async with asyncio.timeout(_DRAIN_S if self.id else 0):
                await self.flush()
        lost = self._queue.clear()
        if lost:
            self._replaced += lost
            self._logger.warning(f"{lost} messages on '{self.topic_name}' could not be handed over")

    def _type_warning(self) -> str:
        return f"Incompatible type on topic '{self.topic_name}', no messages will be sent to it."

    def _qos_warning(self, policy: str) -> str:
        return (
            f"New subscription discovered on topic '{self.topic_name}', requesting incompatible QoS. "
            f"No messages will be sent to it. Last incompatible policy: {policy}"
        )
