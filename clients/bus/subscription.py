"""Subscriptions: runs of samples in, typed messages out, by iteration or to a callback.

Samples wait undecoded in a queue of the subscription's depth and are decoded when they are taken, so that
what is replaced costs next to nothing. One wake-up handles everything that has arrived.
"""

import asyncio
from collections.abc import AsyncIterator, Callable
from functools import partial
from time import monotonic_ns
from typing import Any, Literal, NamedTuple, TypeAlias, TypedDict, TypeVar, Unpack

import msgspec

from bus.base.descriptor import Descriptor
from bus.delivery.counters import DropCounters
from bus.delivery.counters import SubscriptionStatistics as SubscriptionStatistics
from bus.delivery.dispatcher import Dispatcher
from bus.delivery.receiver import Receiver, Taken
from bus.delivery.sequence import PublisherProxy
from bus.delivery.shm_receiver import ShmReceiver
from bus.endpoint import Endpoint, NodeContext, summed
from bus.errors import BusError, ConfigurationError, ConnectionClosed, again
from bus.events import LivelinessChanged, MessageLost, SubscriptionEvents
from bus.qos import Durability, History, QoSProfile
from bus.types.large_fields import view_type
from bus.types.support import TypeSupport
from bus.vocabulary import Route
from bus.wire import messages as m
from bus.wire.layout import MAX_COUNT
from bus.wire.runs import Run

M = TypeVar("M", bound=msgspec.Struct)

Role: TypeAlias = Literal["", "mirror", "tap"]


class Bridging(TypedDict, total=False):
    """What bridges ask of `Node.create_subscription` besides."""

    gid: bytes | None
    local_only: bool
    role: Role


_ACK_DELAY_S = 0.02
_new_info: Any = tuple.__new__
"""Makes a MessageInfo of its parts, in half the time that a call of the class takes."""


class MessageInfo(NamedTuple):
    """About one message.

    For example:

        message, info = await subscription.receive()
        print((info.received_timestamp - info.source_timestamp) / 1e9)
    """

    source_timestamp: int
    """When it was published, or came about elsewhere (`Publisher.publish_encoded`): nanoseconds of the wall
    clock."""
    received_timestamp: int
    """When it came to this process: nanoseconds of the wall clock."""
    publication_sequence_number: int
    """Which one of its publisher's messages it is, from 1."""
    reception_sequence_number: int
    """Which one of those that this subscription has delivered, from 1."""
    publisher_gid: bytes
    """Whose it is: the `gid` of its publisher."""


class Pack(NamedTuple):
    """Messages of one publisher, back to back; made by `Subscription.take_packed`."""

    publisher_gid: bytes
    data: bytes
    """Of each message its number (u64), its source time (i64, nanoseconds of the wall clock), its size (u32),
    and the message; little-endian."""
    messages: int
    payload_bytes: int
    last_at: int
    """Where the last one's number stands."""
    is_consecutive: bool
    """Whether none is missing between the first and the last."""
    has_more: bool
    """Whether more waits."""


class Subscription(Endpoint[M]):
    """Receives messages of one type on one topic; made by `Node.create_subscription`.

    Without a callback: `async for message in subscription`, which ends when it is closed, or `receive`, or
    `take`. What nobody takes is replaced by what is newer, beyond the depth, and counted.

        message, info = await subscription.receive()
    """

    _kind = "subscription"

    def __init__(  # noqa: PLR0913
        self,
        node: NodeContext,
        topic: str,
        support: TypeSupport[M],
        qos: QoSProfile,
        events: SubscriptionEvents,
        callback: Callable[..., Any] | None = None,
        *,
        decode: Callable[[Any], Any] | None = None,
        busy_poll: float = 0.0,
        on_slow: Callable[[int], object] | None = None,
        **bridging: Unpack[Bridging],
    ) -> None:
        super().__init__(node, topic, support, qos, events, bridging.get("gid"))
        link = node.link
        self._local_only = bridging.get("local_only", False)
        self._role: Role = bridging.get("role", "")
        keeps_all = qos.history is History.KEEP_ALL
        self._receiver: Receiver[M] = Receiver(
            decode or support.decode,
            0 if keeps_all else qos.depth,
            is_lossless=qos.is_lossless,
            on_drop=lambda reason, count: self._tell_lost(),
            on_reject=self._reject,
            on_taken=self._acknowledge,
        )
        self._ahead = self._receiver.ahead
        self._counters = DropCounters(self._receiver)
        self._lost_reported = 0
        self._not_alive: set[int] = set()  # of the matches
        self._left_broker = link.broker
        self._left_brokers: dict[bytes, object] = {}  # by gid of a publisher: the last one that matched them
        self._ack_bytes = self._ack_samples = 1
        self._ack_timer: asyncio.TimerHandle | None = None
        self._held_back: frozenset[bytes] = frozenset()
        self._arrivals = link.waiters()
        self._on_arrival: Callable[[], object] | None = None
        self._on_end: Callable[[BusError], object] | None = None
        """Called once it can't be used any more, whatever the cause."""
        self._on_lost: Callable[[bytes], object] | None = None
        """Called with the gid of a publisher whose process has ended, or was cut off, without leaving."""
        self._rings: ShmReceiver | None = None
        if link.shm_context is not None and self._role != "mirror":
            self._rings = ShmReceiver(link, link.shm_context, self, self._miss)
            self._receiver.reader = self._rings.reader
            self._receiver.on_report_due = partial(link.report, self)
            if busy_poll:
                self._rings.poll(busy_poll)
        self._dispatcher: Dispatcher[M] | None = None
        if callback is not None:
            self._dispatcher = Dispatcher(
                link,
                callback,
                self._receiver,
                make_info=self._info,
                receive=self.receive,
                on_error=node.on_error,
                name=topic,
                is_timed=qos.deadline is not None,
                on_slow=on_slow,
            )
            if self._dispatcher.is_plain:
                self._receive_lone = self._dispatcher.deliver

    def take(self) -> tuple[M, MessageInfo] | None:
        """The oldest waiting message and its info; None where none waits. Never blocks."""
        taken = self._receiver.take()
        return None if taken is None else (taken[0], self._info(taken))

    def take_many(self, limit: int) -> list[tuple[M, MessageInfo]]:
        """Up to `limit` of the oldest waiting messages, each with its info; never blocks.

        For those who take much at a time, with `raw` a recorder say: a message costs less than half of what
        a `take` costs, and less than a callback that wants the info. Wait for the first with `receive`.

            batch = [await subscription.receive(), *subscription.take_many(1000)]
        """
        batch = self._receiver.take_many(limit)
        offset_ns, number = self._link.wall_offset_ns, self._receiver.delivered - len(batch)
        return [
            (
                message,
                _new_info(
                    MessageInfo,
                    (
                        stamp_ns - (proxy.clock_ns if proxy else 0) + offset_ns
                        if stamp_ns >= 0
                        else -stamp_ns,
                        received_ns + offset_ns,
                        seq,
                        number := number + 1,
                        proxy.shown_gid if proxy else b"",
                    ),
                ),
            )
            for message, stamp_ns, seq, proxy, received_ns in batch
        ]

    def take_packed(self, most_bytes: int, longest: int) -> Pack | None:
        """What waits of one publisher, in one buffer of at most `most_bytes`; never blocks.

        For bridges, which pass it on by `Publisher.publish_packed`: a message costs a tenth of what it costs
        in `take_many`. None where that has to take the next message: one of `longest` bytes or more, one that
        came by socket, any without the native core.
        """
        found = self._receiver.take_packed(most_bytes, longest, self._link.wall_offset_ns)
        return None if found is None else Pack(found[0].shown_gid, *found[1:])

    def set_arrival_callback(self, callback: Callable[[], object] | None) -> None:
        """Have `callback` called on the event loop when messages have come, once for all that came together.

        For programs that take from many subscriptions as soon as something is there, without a task for each.
        Messages that wait already are not announced. While it is set, `receive` and iteration are not woken;
        None ends that. Raises ConfigurationError where the subscription delivers its messages to a callback.

            subscription.set_arrival_callback(lambda: write(subscription.take_many(1000)))
        """
        if self._dispatcher is not None:
            raise ConfigurationError("a subscription that delivers to a callback announces no arrivals")
        self._on_arrival = callback

    def hold_back(self, publisher_gid: bytes) -> None:
        """Give one publisher no more room, until `release`: if it is lossless, it waits, and others go on.

        For bridges, where the way of one may be stuck. By shared memory nothing more of it is taken. By
        socket what it has had room for still comes, and is not acknowledged.
        """
        self._held_back |= {publisher_gid}
        if self._rings is not None:
            self._rings.hold(publisher_gid, is_on=True)

    def release(self, publisher_gid: bytes) -> None:
        """End what `hold_back` has begun."""
        if publisher_gid not in self._held_back or self._refusal is not None:
            return
        self._held_back -= {publisher_gid}
        if self._rings is None or not self._rings.hold(publisher_gid, is_on=False):
            for proxy in self._receiver.tracker.values():
                if proxy.shown_gid == publisher_gid and proxy.taken_seq > proxy.acked_seq:
                    self._acknowledge(proxy)
        self._link.soon(self._wake)

    async def receive(self) -> tuple[M, MessageInfo]:
        """Wait for the next message; returns it with its info.

        Waits without an end: use `asyncio.timeout`. Cancellation: no message is lost. Raises ConnectionClosed
        once the subscription is closed.
        """
        while (taken := self._receiver.take()) is None:
            if self._refusal is not None:
                raise again(self._refusal)
            await self._arrivals.wait()
        return taken[0], self._info(taken)

    def __aiter__(self) -> AsyncIterator[M]:
        return self

    async def __anext__(self) -> M:
        if self._ahead:
            return self._ahead.popleft()[0]
        while (taken := self._receiver.take()) is None:
            if self._refusal is not None:
                if type(self._refusal) is ConnectionClosed:
                    raise StopAsyncIteration
                raise again(self._refusal)
            await self._arrivals.wait()
        return taken[0]

    async def wait_for_publishers(self, number: int = 1) -> None:
        """Wait until at least `number` publishers are matched.

        Waits without an end: use `asyncio.timeout`. Raises ConnectionClosed where the subscription is closed
        meanwhile. Cancellation leaves nothing behind.
        """
        await self._wait_for_matches(number)

    def get_publisher_count(self) -> int:
        """How many publishers are matched now."""
        return len(self._matches)

    def statistics(self) -> SubscriptionStatistics:
        """Its counters until now; they stay when it is closed."""
        return self._counters.statistics(len(self._matches))

    # --- for the link

    def _receive_run(self, run: Run) -> None:
        """A run has come; it is not delivered before `_wake`, but for a callback that would lose it."""
        if self._receiver.put(run):
            if self._dispatcher is not None and not self._dispatcher.is_async:
                self._dispatcher.dispatch()
            self._receiver.trim()

    def _wake(self) -> None:
        """All that has come is in the queue or in a ring: deliver it."""
        if self._refusal is not None:
            return
        if self._dispatcher is not None and not self._dispatcher.is_async:
            self._dispatcher.dispatch()
        elif self._on_arrival is not None:
            self._on_arrival()
        else:
            self._arrivals.release()
        if self.qos.deadline is not None:
            self._last_ns = monotonic_ns()
        if self._rings is not None and self._events.message_lost is not None:
            self._receiver.count_replaced()
            self._tell_lost()

    def _declaration(self, request: int, node: int) -> m.Message:
        takes = None
        if self.qos.durability is Durability.BEST_AVAILABLE:  # which an older busd does not know
            takes = msgspec.structs.replace(self.qos, durability=Durability.VOLATILE)
        return m.CreateSubscription(
            request=request,
            node=node,
            topic=self.topic_name,
            type_name=self._support.name,
            type_hash=self._support.hash,
            qos=self.qos if takes is None else takes,
            gid=self.gid,
            last_seqs=self._receiver.tracker.last_seqs,
            takes_history=takes is not None,
            local_only=self._local_only,
            role=self._role,
        )

    def _declared(self, answer: m.Created) -> None:
        super()._declared(answer)
        self._receiver.set_depth(answer.depth)
        self._ack_bytes = answer.window_bytes // 8
        self._ack_samples = answer.window_samples // 8
        if self._total_matches:  # a new broker has its counters yet to learn
            self._link.report(self)
        if self.qos.deadline is not None and self._role != "mirror":
            self._watch_deadline()
        if self._rings is not None:
            self._rings.declared()

    def _disconnected(self) -> None:
        if self._rings is not None:
            self._rings.disconnected()
        super()._disconnected()
        tracker, broker = self._receiver.tracker, self._link.broker
        met = dict.fromkeys((proxy.gid for proxy in tracker.values()), broker)
        self._counters.disconnected(broker)
        self._id = 0
        self._left_broker = broker
        known = self._left_brokers | met
        self._left_brokers = {gid: known[gid] for gid in tracker.last_seqs if gid in known}

    def _handle(self, message: Any, descriptors: tuple[Descriptor, ...] = ()) -> None:
        tracker, rings = self._receiver.tracker, self._rings
        match message:
            case m.Matched(other=other):
                received_seq = tracker.last_seqs.pop(message.gid, None)
                proxy = None
                if rings is not None:
                    proxy, received_seq = rings.take_up(message, received_seq, self._drain_rings)
                if proxy is None and (proxy := tracker.take_back(message)) is not None:
                    received_seq = proxy.last_seq
                if proxy is None:
                    left = self._left_brokers.pop(message.gid, self._left_broker)
                    is_new_broker = self._link.broker != left
                    proxy = tracker.meet(message, received_seq, self.qos, is_new_broker=is_new_broker)
                tracker[other] = proxy
                super()._handle(message)
                if rings is not None and message.route == Route.SHM:
                    rings.attach(proxy, message, descriptors, received_seq)
                    if proxy.shown_gid in self._held_back:
                        rings.hold(proxy.shown_gid, is_on=True)
                self._tell_liveliness(1, 0)
            case m.Unmatched(other=other, last_seq=last_seq, lost=is_lost):
                if is_lost and self._on_lost is not None and other in self._matches:
                    self._on_lost(self._matches[other].gid)
                super()._handle(message)
                if rings is not None and other in tracker:
                    rings.finish(tracker[other].gid)
                tracker.forget(other, last_seq)
            case m.RingReplaced(source=other):
                if rings is not None and other in tracker:
                    rings.replace(tracker[other], descriptors)
            case m.Rerouted(other=other):
                super()._handle(message)
                if rings is not None and other in tracker:
                    self._leave_ring(tracker[other], rings)
            case m.LivelinessChanged(publisher=publisher, alive=alive):
                if publisher in self._matches and alive is (publisher in self._not_alive):
                    self._not_alive ^= {publisher}
                    self._tell_liveliness(1 if alive else -1, -1 if alive else 1)
            case m.Dropped(missed=missed):
                if rings is not None:
                    for gid, (_, last_seq) in missed.items():
                        tracker.hear(gid, rings.conclude(gid, last_seq) if last_seq else None)
                self._counters.tell(message)
                if missed:
                    self._link.report(self)
                self._tell_lost()
            case _:
                super()._handle(message)

    def _totals(self) -> m.Report:
        """This subscription's counters, for the graph."""
        receiver = self._receiver
        queued = receiver.queued  # looks at the rings
        if self._rings is not None:
            self._rings.reader.is_report_due = False
            self._rings.sweep()
        age_count, age_sum_ns, age_max_ns = receiver.ages.report()
        report = m.Report(
            endpoint=self._id,
            samples=receiver.delivered,
            bytes=receiver.bytes,
            queued=min(queued, MAX_COUNT),  # a ring may lie
            dropped=self._counters.dropped_here,
            expected=self._counters.expected_here,
            repeated=receiver.tracker.repeated,
            at_ns=monotonic_ns(),
            age_count=age_count,
            age_sum_ns=age_sum_ns,
            age_max_ns=age_max_ns,
        )
        besides = self._besides
        if besides is None:
            return report
        return msgspec.structs.replace(
            report,
            samples=report.samples + besides.samples,
            bytes=report.bytes + besides.bytes,
            dropped=summed(report.dropped, besides.dropped),
            expected=report.expected + besides.samples + sum(besides.dropped.values()),
        )

    def _end(self, reason: Any) -> None:
        super()._end(reason)
        self._arrivals.release()
        if self._ack_timer is not None:
            self._ack_timer.cancel()
        if self._dispatcher is not None:
            self._dispatcher.end()
        if self._rings is not None:
            self._rings.close()
        if self._on_end is not None:
            self._on_end(reason)

    def _abandon(self, reason: BusError) -> None:
        super()._abandon(reason)
        self._receiver.reader = None  # its cursors and pins are the parent's

    # --- inside

    def _miss(self, count: int) -> None:
        """A publisher had gone on in another ring, which is gone with it."""
        self._receiver.tracker.lose(count)
        self._link.report(self)
        self._tell_lost()

    def _leave_ring(self, proxy: PublisherProxy, rings: ShmReceiver) -> None:
        try:
            self._drain_rings()
        finally:  # whatever is missing, the publisher sends
            proxy.is_rerouted = rings.leave(proxy.gid)
            received_seq = max(0, min(rings.received_seq(proxy.gid, proxy.received_seq) or 0, MAX_COUNT))
            left = m.LeaveRing(subscription=self._id, source=proxy.number, seq=received_seq)
            self._link.send_about(self, left)

    def _drain_rings(self) -> None:
        """What waits in the rings is brought in order with what comes by socket."""
        self._receiver.drain_rings()
        self._link.report(self)  # else perhaps nothing ever has it reported
        self._link.soon(self._wake)  # a publisher that refuses to share memory has rung no doorbell

    def _counts(self) -> str:
        dropped = sum(self._counters.dropped.values())
        return f"publishers={len(self._matches)} delivered={self._receiver.delivered} dropped={dropped}"

    def _info(self, taken: Taken[M]) -> MessageInfo:
        _, stamp_ns, seq, proxy, received_ns = taken
        offset_ns = self._link.wall_offset_ns
        return MessageInfo(
            stamp_ns - (proxy.clock_ns if proxy else 0) + offset_ns if stamp_ns >= 0 else -stamp_ns,
            received_ns + offset_ns,
            seq,
            self._receiver.delivered,
            proxy.shown_gid if proxy else b"",
        )

    def _check_deadline(self) -> None:
        # What the program takes before the loop hears the doorbell does not pass through `_wake`.
        self._last_ns = max(self._last_ns, min(self._receiver.stamp_ns, monotonic_ns()))  # a stamp may lie
        super()._check_deadline()

    def _unmatch(self, other: int, *, is_lost: bool = False) -> None:
        is_known, was_alive = other in self._matches, other not in self._not_alive
        super()._unmatch(other)
        self._not_alive.discard(other)
        if is_known:
            self._tell_liveliness(*((-1, 0) if was_alive else (0, -1)))

    def _acknowledge(self, proxy: PublisherProxy) -> None:
        """Samples of a lossless publisher were taken: tell it now if they are many, else a little later."""
        samples = proxy.taken_seq - proxy.acked_seq
        if proxy.shown_gid in self._held_back:
            return
        if proxy.unacked_bytes >= self._ack_bytes or samples >= self._ack_samples:
            self._send_ack(proxy)
        elif self._ack_timer is None:
            self._ack_timer = self._link.later(_ACK_DELAY_S, self._acknowledge_all)

    def _acknowledge_all(self) -> None:
        self._ack_timer = None
        for proxy in self._receiver.tracker.values():
            if proxy.taken_seq > proxy.acked_seq and proxy.shown_gid not in self._held_back:
                self._send_ack(proxy)

    def _send_ack(self, proxy: PublisherProxy) -> None:
        proxy.acked_seq, proxy.unacked_bytes = proxy.taken_seq, 0
        # A publisher that has gone, or that an earlier broker knew, needs none.
        if proxy.number in self._matches and self._receiver.tracker.get(proxy.number) is proxy:
            ack = m.Ack(subscription=self._id, source=proxy.number, seq=proxy.taken_seq)
            self._link.send_about(self, ack)

    def _reject(self, size: int, error: Exception) -> None:
        text = f"a message of {size} bytes on '{self.topic_name}' is no {self._support.name}: {error}"
        self._logger.warning(text, throttle_duration_sec=5.0)

    def _tell_lost(self) -> None:
        callback = self._events.message_lost
        if callback is not None:
            reasons = self._counters.dropped
            total = sum(reasons.values())
            if total > self._lost_reported:
                change, self._lost_reported = total - self._lost_reported, total
                self._tell(callback, MessageLost(total, change, reasons))

    def _tell_liveliness(self, alive_change: int, not_alive_change: int) -> None:
        lost = len(self._not_alive)
        alive = len(self._matches) - lost
        event = LivelinessChanged(alive, lost, alive_change, not_alive_change)
        self._tell(self._events.liveliness_changed, event)

    def _type_warning(self) -> str:
        return f"Incompatible type on topic '{self.topic_name}', no messages will be received from it."

    def _qos_warning(self, policy: str) -> str:
        return (
            f"New publisher discovered on topic '{self.topic_name}', offering incompatible QoS. "
            f"No messages will be received from it. Last incompatible policy: {policy}"
        )


def decoder_of_views(support: TypeSupport[Any]) -> Callable[[Any], Any]:
    """As `support.decode`, but fields of bytes are read-only views into what is decoded."""
    decode = msgspec.msgpack.Decoder(view_type(support.cls)).decode
    return lambda payload: decode(memoryview(payload).toreadonly())  # by socket it is a buffer of our own
