"""The internal part of a subscription: its receiver, and messages about its matches."""

from collections.abc import Callable, Container, Coroutine, Iterable
from functools import partial
from time import monotonic_ns
from typing import Any, Literal, NamedTuple, TypeAlias, TypedDict, TypeVar, Unpack

import msgspec

from bus.base.callbacks import ignore
from bus.base.descriptor import Descriptor
from bus.delivery.counters import DropCounters, SubscriptionStatistics
from bus.delivery.dispatcher import Dispatcher
from bus.delivery.receiver import Receiver, Taken
from bus.delivery.sequence import PublisherProxy
from bus.delivery.shm_receiver import ShmReceiver
from bus.endpoint.acknowledging import Acknowledging
from bus.endpoint.arrivals import Arrivals
from bus.endpoint.core import EndpointCore, NodeContext
from bus.endpoint.liveliness import LivelinessWatch
from bus.errors import BusError, again
from bus.events import LivelinessChanged, MessageLost, SubscriptionEvents
from bus.qos import Durability, History, QoSProfile
from bus.types.support import TypeSupport
from bus.vocabulary import Route
from bus.wire import messages as m
from bus.wire.layout import MAX_COUNT
from bus.wire.runs import Run

__all__ = ["Bridging", "MessageInfo", "SubscriptionCore", "SubscriptionOptions"]

M = TypeVar("M", bound=msgspec.Struct)

Role: TypeAlias = Literal["", "mirror", "tap"]


class Bridging(TypedDict, total=False):
    """Further arguments of `Node.create_subscription`, for bridges."""

    gid: bytes | None
    local_only: bool
    role: Role


class SubscriptionOptions(Bridging, total=False):
    """Further options of a subscription."""

    decode: Callable[[Any], Any] | None
    busy_poll: float
    on_slow: Callable[[int], object] | None


class MessageInfo(NamedTuple):
    """Times, numbers and publisher of one message.

    For example:

        message, info = await subscription.receive()
        print((info.received_timestamp - info.source_timestamp) / 1e9)
    """

    source_timestamp: int
    """Time of publishing, or of its origin elsewhere (`Publisher.publish_encoded`): nanoseconds of the wall
    clock."""
    received_timestamp: int
    """Time of arrival in this process: nanoseconds of the wall clock."""
    publication_sequence_number: int
    """Its number among its publisher's messages, from 1."""
    reception_sequence_number: int
    """Its number among the messages that this subscription delivered, from 1."""
    publisher_gid: bytes
    """The `gid` of its publisher."""


class _LastBrokers:
    """The broker that matched each publisher last, by the publisher's gid.

    After a return, a publisher that is matched by the same broker continues its numbers there.
    """

    __slots__ = ("_by_gid", "_last")

    def __init__(self, broker: object) -> None:
        self._last = broker
        self._by_gid: dict[bytes, object] = {}

    def leave(self, broker: object, matched: Iterable[bytes], kept: Container[bytes]) -> None:
        """Handle the end of a connection, in which `broker` had matched these publishers.

        Publishers that are not in `kept` are forgotten.
        """
        known = self._by_gid | dict.fromkeys(matched, broker)
        self._by_gid = {gid: known[gid] for gid in known if gid in kept}
        self._last = broker

    def take(self, gid: bytes) -> object:
        """Remove and return the broker. For an unknown publisher, it is the last one."""
        return self._by_gid.pop(gid, self._last)


class SubscriptionCore(EndpointCore[M]):
    """The core of one subscription. `decode` makes messages of bytes, `callback` gets each message.

    See `Node.create_subscription`.
    """

    kind = "subscription"
    shared = ()
    consequence = "no messages will be received from it"

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
        self.acks = Acknowledging(self) if qos.is_lossless else None
        self.held_back: frozenset[bytes] = frozenset()
        """Publishers that get no more room."""
        self._local_only = bridging.get("local_only", False)
        self._role: Role = bridging.get("role", "")
        keeps_all = qos.history is History.KEEP_ALL
        self.receiver: Receiver[M] = Receiver(
            decode or support.decode,
            0 if keeps_all else qos.depth,
            is_lossless=self.acks is not None,
            on_drop=lambda reason, count: self._report_lost(),
            on_reject=self._reject,
            on_taken=ignore if self.acks is None else self.acks.on_taken,
        )
        self.counters = DropCounters(self.receiver)
        self._lost_reported = 0
        self._lost_silently = 0
        self._liveliness: LivelinessWatch | None = None  # without a lease nothing is watched
        if qos.liveliness_lease_duration is not None:
            self._liveliness = LivelinessWatch(link, qos.lease_ns, self._report_liveliness)
        self._brokers = _LastBrokers(link.broker)
        self._arrivals: Arrivals[M] | None = None  # since a task waited for the first time
        self.on_arrival: Callable[[], object] | None = None
        self.on_end: Callable[[BusError], object] | None = None
        """Called when the subscription can't be used any more, for any reason."""
        self.on_lost: Callable[[bytes], object] | None = None
        """Called with a publisher's gid if its process ended, or was disconnected, without leaving."""
        self.rings: ShmReceiver | None = None
        if link.shm_context is not None and self._role != "mirror":
            self.rings = ShmReceiver(link, link.shm_context, self, self._miss, decodes_plainly=decode is None)
            self.receiver.reader = self.rings.reader
            self.receiver.on_report_due = partial(link.report, self)
            if busy_poll:
                self.rings.poll(busy_poll)
        self.dispatcher: Dispatcher[M] | None = None
        if callback is not None:
            self.dispatcher = Dispatcher(
                link,
                callback,
                self.receiver,
                make_info=self.info,
                receive=self.receive,
                on_error=node.on_error,
                name=topic,
                is_timed=qos.deadline is not None,
                on_slow=on_slow,
            )
            if self.dispatcher.is_plain:
                self.receive_lone = self.dispatcher.deliver

    def statistics(self) -> SubscriptionStatistics:
        """As `Subscription.statistics`."""
        return self.counters.statistics(len(self.matches))

    def hold_back(self, publisher_gid: bytes) -> None:
        """As `Subscription.hold_back`."""
        self.held_back |= {publisher_gid}
        if self.rings is not None:
            self.rings.hold(publisher_gid, is_on=True)

    def release(self, publisher_gid: bytes) -> None:
        """As `Subscription.release`."""
        if publisher_gid not in self.held_back or self.refusal is not None:
            return
        self.held_back -= {publisher_gid}
        has_acknowledged = self.rings is not None and self.rings.hold(publisher_gid, is_on=False)
        if self.acks is not None and not has_acknowledged:
            self.acks.catch_up(publisher_gid)
        self.link.soon(self.wake)

    def replace_callback(self, callback: Callable[..., Any]) -> None:
        """As `Dispatcher.replace_callback`; only with a dispatcher."""
        assert self.dispatcher is not None
        self.dispatcher.replace_callback(callback)
        if self.dispatcher.is_plain:
            self.receive_lone = self.dispatcher.deliver
        else:
            self.__dict__.pop("receive_lone", None)

    async def receive(self) -> tuple[M, MessageInfo]:
        """For callbacks that are coroutine functions: as `Subscription.receive`."""
        while (taken := self.receiver.take()) is None:
            if (taken := await self.wait_for_arrival()) is not None:
                break
        return taken[0], self.info(taken)

    def wait_for_arrival(self) -> Coroutine[Any, Any, Taken[M] | None]:
        """As `Arrivals.wait`. Raises why the subscription can't be used any more."""
        if self.refusal is not None:
            raise again(self.refusal)
        if self._arrivals is None:
            # A deadline must see each message. Callbacks of messages or of arrivals come before tasks.
            has_callback = self.on_arrival is not None or (
                self.dispatcher is not None and not self.dispatcher.is_async
            )
            is_direct = self.qos.deadline is None and not has_callback
            self._arrivals = Arrivals(self.link.loop, self.receiver, self.on_error, is_direct=is_direct)
            if is_direct:
                self.receive_lone = self._arrivals.receive_lone
        return self._arrivals.wait()

    def announce(self, callback: Callable[[], object] | None) -> None:
        """As `Subscription.set_arrival_callback`."""
        self.on_arrival = callback
        if callback is not None and self._arrivals is not None:
            self._arrivals.stop_giving()

    def info(self, taken: Taken[M]) -> MessageInfo:
        """The information that users get in addition to a message."""
        _, stamp_ns, seq, proxy, received_ns = taken
        offset_ns = self.link.wall_offset_ns
        return MessageInfo(
            stamp_ns - (proxy.clock_ns if proxy else 0) + offset_ns if stamp_ns >= 0 else -stamp_ns,
            received_ns + offset_ns,
            seq,
            self.receiver.delivered,
            proxy.shown_gid if proxy else b"",
        )

    # --- for the link

    def receive_run(self, run: Run) -> None:
        """Queue a received run until `wake`.

        Exception: it is delivered at once if a callback would lose it.
        """
        if self.receiver.put(run):
            if self.dispatcher is not None and not self.dispatcher.is_async:
                self.dispatcher.dispatch()
            self.receiver.trim()

    def wake(self) -> None:
        """Deliver all received samples, which are in the queue or in a ring."""
        if self.refusal is not None:
            return
        if self.dispatcher is not None and not self.dispatcher.is_async:
            self.dispatcher.dispatch()
        elif self.on_arrival is not None:
            self.on_arrival()
        elif self._arrivals is not None:
            self._arrivals.release()
        if self.deadline is not None:
            self.deadline.last_ns = monotonic_ns()
        if self.events.message_lost is not None:
            # To add up all counters takes fifteen calls; most messages come without a loss.
            lost = self.receiver.lost_silently
            if lost != self._lost_silently:
                self._lost_silently = lost
                self._report_lost()

    def declaration(self, request: int, node: int) -> m.Message:
        takes = None
        if self.qos.durability is Durability.BEST_AVAILABLE:  # unknown to an older busd
            takes = msgspec.structs.replace(self.qos, durability=Durability.VOLATILE)
        return m.CreateSubscription(
            request=request,
            node=node,
            topic=self.topic_name,
            type_name=self.support.name,
            type_hash=self.support.hash,
            qos=self.qos if takes is None else takes,
            gid=self.gid,
            last_seqs=self.receiver.tracker.last_seqs,
            takes_history=takes is not None,
            local_only=self._local_only,
            role=self._role,
        )

    def declared(self, answer: m.Created) -> None:
        super().declared(answer)
        self.receiver.set_depth(answer.depth)
        if self.acks is not None:
            self.acks.set_window(answer)
        if self.matches.total:  # a new broker doesn't have the counters yet
            self.link.report(self)
        if self.qos.deadline is not None and self._role != "mirror":
            self.watch_deadline()
        if self.rings is not None:
            self.rings.declared()

    def disconnected(self) -> None:
        if self.rings is not None:
            self.rings.disconnected()
        super().disconnected()
        tracker, broker = self.receiver.tracker, self.link.broker
        matched = [proxy.gid for proxy in tracker.values()]
        self.counters.disconnected(broker)
        self.id = 0
        self._brokers.leave(broker, matched, tracker.last_seqs)

    def handle(self, message: Any, descriptors: tuple[Descriptor, ...] = ()) -> None:
        tracker, rings = self.receiver.tracker, self.rings
        match message:
            case m.Matched(other=other):
                received_seq = tracker.last_seqs.pop(message.gid, None)
                proxy = None
                if rings is not None:
                    proxy, received_seq = rings.take_up(message, received_seq, self._drain_rings)
                if proxy is None and (proxy := tracker.take_back(message)) is not None:
                    received_seq = proxy.last_seq
                if proxy is None:
                    is_new_broker = self.link.broker != self._brokers.take(message.gid)
                    proxy = tracker.match(message, received_seq, self.qos, is_new_broker=is_new_broker)
                    if self.counters.matched(proxy):
                        self._report_lost()
                tracker[other] = proxy
                super().handle(message)
                if rings is not None and message.route == Route.SHM:
                    rings.attach(proxy, message, descriptors, received_seq)
                    if proxy.shown_gid in self.held_back:
                        rings.hold(proxy.shown_gid, is_on=True)
                if self._liveliness is not None:
                    self._liveliness.match(other, is_proven=not message.awaits_sign)
            case m.Unmatched(other=other, last_seq=last_seq, lost=is_lost):
                if is_lost and self.on_lost is not None and other in self.matches:
                    self.on_lost(self.matches[other].gid)
                super().handle(message)
                if rings is not None and other in tracker:
                    rings.finish(tracker[other].gid)
                tracker.forget(other, last_seq)
            case m.RingReplaced(source=other):
                if rings is not None and other in tracker:
                    rings.replace(tracker[other], descriptors)
            case m.Rerouted(other=other):
                super().handle(message)
                if rings is not None and other in tracker:
                    self._leave_ring(tracker[other], rings)
            case m.LivelinessChanged(publisher=publisher, alive=alive):
                if self._liveliness is not None and publisher in self.matches:
                    if alive:
                        self._liveliness.life(publisher)
                    else:
                        self._liveliness.lapse(publisher, self.matches[publisher].qos.lease_ns)
            case m.Dropped(missed=missed):
                if rings is not None:
                    for gid, (_, last_seq) in missed.items():
                        tracker.note_received(gid, rings.conclude(gid, last_seq) if last_seq else None)
                self.counters.on_dropped(message)
                if missed:
                    self.link.report(self)
                self._report_lost()
            case _:
                super().handle(message)

    def totals(self) -> m.Report:
        """This subscription's counters, for the graph."""
        receiver = self.receiver
        queued = receiver.queued  # checks the rings
        if self.rings is not None:
            self.rings.reader.is_report_due = False
            self.rings.sweep()
        age_count, age_sum_ns, age_max_ns, age_parts = receiver.ages.report()
        report = m.Report(
            endpoint=self.id,
            samples=receiver.delivered,
            bytes=receiver.bytes,
            queued=min(queued, MAX_COUNT),  # a ring's numbers may be false
            dropped=self.counters.dropped_here,
            expected=self.counters.expected_here,
            repeated=receiver.tracker.repeated,
            at_ns=monotonic_ns(),
            age_count=age_count,
            age_sum_ns=age_sum_ns,
            age_max_ns=age_max_ns,
            most_missed=min(receiver.most_missed, MAX_COUNT),
            age_parts=age_parts,
        )
        besides = self.besides
        if besides is None:
            return report
        expected = report.expected + besides.samples + sum(besides.dropped.values())
        return msgspec.structs.replace(self.with_besides(report, besides), expected=expected)

    def end(self, reason: Any) -> None:
        super().end(reason)
        if self._liveliness is not None:
            self._liveliness.end()
        if self._arrivals is not None:
            self._arrivals.end()
        if self.acks is not None:
            self.acks.end()
        if self.dispatcher is not None:
            self.dispatcher.end()
        if self.rings is not None:
            self.rings.close()
        if self.on_end is not None:
            self.on_end(reason)

    def abandon(self, reason: BusError) -> None:
        super().abandon(reason)
        self.receiver.reader = None  # its cursors and pins are the parent's

    # --- inside

    def _miss(self, count: int) -> None:
        """Count samples in an unread ring of a departed publisher."""
        self.receiver.tracker.lose(count)
        self.link.report(self)
        self._report_lost()

    def _leave_ring(self, proxy: PublisherProxy, rings: ShmReceiver) -> None:
        try:
            self._drain_rings()
        finally:  # the publisher sends all missing samples
            proxy.is_rerouted = rings.leave(proxy.gid)
            received_seq = max(0, min(rings.received_seq(proxy.gid, proxy.received_seq) or 0, MAX_COUNT))
            left = m.LeaveRing(subscription=self.id, source=proxy.number, seq=received_seq)
            self.link.send_about(self, left)

    def _drain_rings(self) -> None:
        """Move waiting samples of the rings to the queue, in order with samples by socket."""
        self.receiver.drain_rings()
        self.link.report(self)  # else nothing may ever report it
        self.link.soon(self.wake)  # a publisher that refuses to share memory has rung no doorbell

    def remove_match(self, other: int, *, is_lost: bool = False) -> None:
        if self._liveliness is not None:
            self._liveliness.unmatch(other)
        super().remove_match(other)

    def _reject(self, size: int, error: Exception) -> None:
        text = f"a message of {size} bytes on '{self.topic_name}' is no {self.support.name}: {error}"
        self.logger.warning(text, throttle_duration_sec=5.0)

    def _report_lost(self) -> None:
        callback = self.events.message_lost
        if callback is not None:
            reasons = self.counters.dropped
            total = sum(reasons.values())
            change, self._lost_reported = total - self._lost_reported, total
            if change > 0:  # less than before: some may come again after a lost connection
                self.notify(callback, MessageLost(total, change, reasons))

    def _report_liveliness(self, event: LivelinessChanged) -> None:
        self.notify(self.events.liveliness_changed, event)

    def describe_incompatible_qos(self) -> str:
        return (
            f"New publisher discovered on topic '{self.topic_name}', offering incompatible QoS. "
            "No messages will be received from it"
        )

    def newest_ns(self) -> int:
        # Samples that the program takes before the loop sees the doorbell don't pass through `wake`.
        return min(self.receiver.stamp_ns, monotonic_ns())  # a stamp may be false
