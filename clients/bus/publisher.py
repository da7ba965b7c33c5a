"""Publishers: typed messages in, samples out by the routes of the matches.

A message is checked, encoded and stamped in `publish`. It is written to the publisher's ring, for the matches
by shared memory, and goes to the broker while there are others (`bus.delivery`).
"""

import asyncio
import contextlib
from operator import index as to_index
from time import monotonic_ns
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec

from bus import shm
from bus.base.awaited import done_anyway
from bus.base.descriptor import Descriptor
from bus.delivery.sender import Sender, find_loan_class
from bus.delivery.shm_sender import ShmSender
from bus.diagnostics.provoked import warn
from bus.endpoint import Endpoint, Match, NodeContext, summed
from bus.errors import BusError, ConnectionClosed, PayloadTooLarge, again
from bus.events import LivelinessLost, PublisherEvents
from bus.qos import History, QoSProfile, check_offer
from bus.transport.memory import LARGE_BYTES, keep_freed_memory
from bus.types.large_fields import (
    encode_around,
    in_bytes,
    is_bounded,
    long_field,
    no_such_field,
    with_field,
)
from bus.types.support import ENCODE_ERRORS, TypeSupport, wrong_class
from bus.vocabulary import DropReason, Route
from bus.wire import messages as m
from bus.wire.layout import MAX_MESSAGE_BYTES
from bus.wire.runs import Buffer
from bus.wire.source_time import source_head

if TYPE_CHECKING:  # few programs lend
    from bus.loan import Loan

M = TypeVar("M", bound=msgspec.Struct)

_DRAIN_S = 5.0
_JOINED_BYTES = 16 << 10
_SENDS_PER_TURN = 100
"""After this many sends without a wait, `send` gives the event loop a turn."""


class PublisherStatistics(msgspec.Struct, frozen=True):
    """Totals of one publisher.

    For example:

        print(publisher.statistics().published)
    """

    published: int
    """Messages that `publish` accepted."""
    bytes: int
    """Their encoded size."""
    queued: int
    """Messages not yet handed over to busd."""
    replaced: int
    """Messages that the depth, or a bound of 64 MiB, replaced before they were handed over."""
    refused: int
    """Calls of `publish` that found no room (reliable + keep all)."""
    subscriptions: int
    """Subscriptions matched now."""
    at_ns: int = 0
    """When this was counted: nanoseconds of the monotonic clock (`time.monotonic_ns`)."""


class Publisher(Endpoint[M]):
    """Publishes messages of one type on one topic; made by `Node.create_publisher`.

    For example:

        publisher.publish(String(data="hi"))
    """

    _kind = "publisher"

    def __init__(
        self,
        node: NodeContext,
        topic: str,
        support: TypeSupport[M],
        qos: QoSProfile,
        events: PublisherEvents,
        *,
        by_socket: bool = False,
        gid: bytes | None = None,
    ) -> None:
        check_offer(qos)
        super().__init__(node, topic, support, qos, events, gid)
        self._encode = support.encode
        self._max_bytes = MAX_MESSAGE_BYTES
        self._refused = 0
        self._sends_in_turn = 0
        self._lost_liveliness = 0
        ring = None if by_socket else ShmSender.make(node.link, self, node.logger)
        sends = None
        if ring is not None or shm.has_core():  # `send` costs what `publish` costs where there is room
            sends = shm.native.Sends(self._send, self._send_on, self.send)
            self.send = sends.send  # type: ignore[method-assign, assignment]
        self._sender = Sender(node.link, self, node.logger, ring, sends)
        self._quick = self._sender.quick
        self._long_fields = support.bytes_fields
        self._bytes_fields = {name: support.cls.__struct_fields__.index(name) for name in self._long_fields}
        if ring is not None:  # by socket they would be copied once more, to join the rest
            self._long_fields += support.text_fields
        if qos.deadline is not None:
            self._watch_deadline()

    def publish(self, message: M) -> bool:
        """Publish `message`; never blocks, and may be called from any thread.

        Returns False only where the QoS is reliable + keep all and there is no room until the subscriptions
        have taken more: then the message was not published, and that is counted (see `send`).

        Raises MessageTypeError for a message of another class or with a field of the wrong type,
        PayloadTooLarge above the topic's limit, SharedMemoryError where the machine has no memory for it,
        LocalProtocolError while a loan is open, ConnectionClosed after `close`.
        """
        status = self._quick.publish(message)
        return True if status is True else self._publish_on(message, status)

    def _publish_on(self, message: M, status: int | bytes) -> bool:
        """What `QuickWays.publish` has left to do, as its `status` says, which is not True."""
        if isinstance(status, bytes):
            return self._put(status)
        if status and status == shm.native.REPORT_DUE:
            self._link.report(self)
            self._sender.watch_turn(self._least_depth)
            return True
        if message.__class__ is not self.type:
            raise wrong_class(self.type, message)
        if self._long_fields:
            if found := long_field(message, self._long_fields):
                return self._publish_around(message, *found)
            self._sender.expect_short()
        if not self._support.is_valid(message):
            error = self._support.explain(message)
            if error is not None:
                raise error
        try:
            payload = self._encode(message)
        except ENCODE_ERRORS as error:
            raise self._support.explain(message) or error from None
        return self._write(payload)

    def publish_encoded(self, payload: Buffer, *, source_time_ns: int | None = None) -> bool:
        """Publish a message that is encoded already; as `publish`, but nothing checks its type here.

        What a subscription with `raw` received can be passed on like this. A subscription counts what is
        no message of its type as `undecodable`.

        `source_time_ns`: when the message came about, in nanoseconds of the wall clock, for those who bring
        it from elsewhere. It is the `source_timestamp` that subscriptions see; all else (order, lifespan)
        goes by when it was published. Raises ConfigurationError for what is no time.
        """
        if isinstance(payload, str):
            raise TypeError(f"an encoded message on '{self.topic_name}' must be bytes, not text")
        if source_time_ns is not None:
            head = source_head(source_time_ns)
            if payload.__class__ is bytes and len(payload) < _JOINED_BYTES:
                return self._write(head + payload)  # the copy costs less than the slow way
            return self._put(head, in_bytes(payload))
        return self._write(payload)

    def publish_packed(self, data: Buffer, start: int = 0) -> int:
        """Publish the messages that stand in a `Pack`'s data from byte `start` on, each with its source time.

        For bridges: readers are woken once for all of them. Returns how many, from the front, were published:
        as many as can be without more ado, which may be none. `publish_encoded` takes the next one, or says
        why not.
        """
        count, is_report_due = self._quick.publish_packed(data, start)
        if is_report_due:
            self._link.report(self)
        return count

    def loan(self, message: M, field: str, size: int) -> "Loan | None":
        """A buffer of `size` bytes, to be filled by the caller: the field `field` of `message`.

        It lies where the subscriptions read, so that nothing is copied: for a camera's frame, say. The rest
        of `message` counts as it is now. Until the loan is published or discarded, nothing else can be
        published here. None where `publish` would give False. On the event loop's thread only.

        Raises as `publish`, and MessageTypeError for a field that is no bytes, ValueError for a negative
        size, LocalProtocolError on another thread.
        """
        index = self._bytes_fields.get(field)
        if index is None:
            raise no_such_field(self.type, field)
        sender = self._sender
        loan_class = find_loan_class()
        lending = sender.lending or sender.make_lending()
        made = self._quick.lend_field(message, index, size, loan_class, lending.end)
        if isinstance(made, loan_class):
            return made
        if (size := to_index(size)) < 0:
            raise ValueError(f"a loan of {size} bytes on '{self.topic_name}'")
        self._check_size(size)
        value = bytes(size) if is_bounded(self.type, field) else b""
        before, after = self._encode_around(message, field, value, size)
        self._check_size(len(before) + size + len(after))
        loan = sender.lend(before, size, after)
        self._refused += loan is None
        return loan

    @done_anyway
    async def send(self, message: M) -> None:
        """Publish `message`, and wait for room first where the QoS is reliable + keep all.

        Cancellation: the message was not published. Raises what `publish` raises.
        """
        await self._send(message)

    async def _send(self, message: M) -> None:
        """`send` without the native core's quick way."""
        # A loop of sends that never wait would keep out signals, timers, and the matches that it sends for.
        self._sends_in_turn += 1
        if self._sends_in_turn > _SENDS_PER_TURN:
            self._sends_in_turn = 1
            await asyncio.sleep(0)
        while not self.publish(message):
            self._refused -= 1  # `send` tries again
            await self._sender.wait_for_room()

    def _send_on(self, message: M, status: int | bytes) -> bool:
        """As `_publish_on`, for `send`, which waits for room where this gives False."""
        is_taken = self._publish_on(message, status)
        self._refused -= not is_taken  # `send` tries again
        return is_taken

    async def wait_for_room(self) -> None:
        """After `publish` or `loan` found no room: wait until it is worth trying again.

        Raises ConnectionClosed where the publisher is closed meanwhile. Cancellation leaves nothing behind.
        """
        await self._sender.wait_for_room()

    async def flush(self) -> None:
        """Wait until everything published has left this process: by shared memory, or through busd's socket.

        While busd is away, what goes through it waits until it is back.

        Raises ConnectionClosed where the connection is closed first. Cancellation: nothing is lost.
        """
        await self._sender.flush()

    async def wait_for_subscriptions(self, number: int = 1) -> None:
        """Wait until at least `number` subscriptions are matched, and are there to be woken.

        Waits without an end: use `asyncio.timeout`. Raises ConnectionClosed where the publisher is closed
        meanwhile. Cancellation leaves nothing behind.
        """
        await self._wait_for_matches(number)

    def get_subscription_count(self) -> int:
        """How many subscriptions are matched now."""
        return len(self._matches)

    def assert_liveliness(self) -> None:
        """Say that this publisher lives, without publishing (liveliness manual by topic).

        Raises ConnectionClosed after `close`. Nothing happens while busd is away.
        """
        if self._refusal is not None:
            raise again(self._refusal)
        self._link.send_about(self, m.AssertLiveliness(publisher=self._id))

    def statistics(self) -> PublisherStatistics:
        """Its counters until now; they stay when it is closed."""
        published, size = self._sender.published
        return PublisherStatistics(
            published=published,
            bytes=size,
            queued=self._sender.queued,
            replaced=self._sender.replaced,
            refused=self._refused + self._sender.refused,
            subscriptions=len(self._matches),
            at_ns=monotonic_ns(),
        )

    # --- for the link

    @property
    def _shared(self) -> tuple[Descriptor, ...]:
        return self._sender.shared

    def _hand_over(self) -> None:
        self._sender.hand_over()

    def _declaration(self, request: int, node: int) -> m.Message:
        return m.CreatePublisher(
            request=request,
            node=node,
            topic=self.topic_name,
            type_name=self._support.name,
            type_hash=self._support.hash,
            qos=self.qos,
            gid=self._own_gid,
            next_seq=self._sender.first_seq_to_send(),
            descriptors=len(self._shared),
            stands_for=b"" if self.gid == self._own_gid else self.gid,
            places=self._sender.places if self._total_matches else (),
        )

    def _declared(self, answer: m.Created) -> None:
        super()._declared(answer)
        self._max_bytes = answer.max_message_bytes
        self._sender.declared(answer)

    def _disconnected(self) -> None:
        self._id = 0  # before the matches go: readers of our ring read on
        super()._disconnected()
        self._sender.disconnected()

    def _handle(self, message: Any, descriptors: tuple[Descriptor, ...] = ()) -> None:
        match message:
            case m.Credit(seq=seq):
                self._sender.credit(seq)
            case m.LivelinessLost():
                self._lost_liveliness += 1
                self._tell(self._events.liveliness_lost, LivelinessLost(self._lost_liveliness, 1))
            case m.Silence(subscription=other) if (match := self._find_match(other)) is not None:
                self._hear_of_silence(message, match)
            case m.Matched():
                if message.route != Route.BRIDGE:
                    self._sender.matched(message)
                super()._handle(message)
            case m.Unmatched(other=other):
                if message.keep_s or self._find_match(other) is None:
                    self._sender.keep_place(other, message.keep_s)
                super()._handle(message)
            case m.Attached(subscription=other) if (match := self._find_match(other)) is not None:
                try:
                    self._sender.attach(match.gid, message, descriptors)
                except (OSError, ValueError) as error:
                    refusal = m.RefuseRoute(endpoint=self._id, other=other, text=str(error)[:1000])
                    self._link.send_about(self, refusal)
                self._release_match_waiters()
            case m.Rerouted(other=other) if (match := self._find_match(other)) is not None:
                self._sender.rerouted(match.gid, match.qos, message)
                super()._handle(message)
                self._release_match_waiters()
            case _:
                super()._handle(message)

    def _totals(self) -> m.Report:
        """This publisher's counters, for the graph."""
        sender = self._sender
        sender.reported()
        samples, size = sender.published
        dropped: dict[str, int] = {DropReason.REPLACED: sender.replaced} if sender.replaced else {}
        besides = self._besides
        return m.Report(
            endpoint=self._id,
            samples=samples + (besides.samples if besides else 0),
            bytes=size + (besides.bytes if besides else 0),
            queued=sender.queued,
            dropped=dropped if besides is None else summed(dropped, besides.dropped),
            at_ns=monotonic_ns(),
        )

    def _end(self, reason: Any) -> None:
        super()._end(reason)
        self._sender.end(reason)

    def _abandon(self, reason: BusError) -> None:
        super()._abandon(reason)
        self._sender.abandon(reason)

    # --- inside

    def _find_match(self, other: int) -> Match | None:
        """With a subscription or a tap."""
        return self._matches.get(other) or self._taps.get(other)

    def _hear_of_silence(self, silence: m.Silence, match: Match) -> None:
        self._sender.set_waiting(match.gid, is_on=silence.is_over)
        time = f"{silence.silent_s:.1f} s"
        if silence.is_over:
            text = f"'{self.topic_name}' waits for {match.node} again, which was silent for {time}"
        else:
            text = f"'{self.topic_name}' goes on without {match.node}: no sign of life for {time}"
        warn(self._logger, text)

    def _least_depth(self) -> int:
        """What a subscription keeps at least; 0 where there is none that keeps the last only."""
        depths = [one.qos.depth for one in self._matches.values() if one.qos.history is History.KEEP_LAST]
        return 0 if self.qos.is_lossless else min(depths, default=0)

    def _publish_around(self, message: M, field: str, value: memoryview | str) -> bool:
        """Publish a message with a long field, which is copied only to where it will be read."""
        before, after = self._encode_around(message, field, value, len(value))
        return self._put(before, value, after)

    def _encode_around(self, message: M, field: str, value: Buffer | str, size: int) -> tuple[bytes, bytes]:
        """What comes before and after `size` bytes as `field`; the check of types sees `value` there."""
        if message.__class__ is not self.type:
            raise wrong_class(self.type, message)
        try:
            message = with_field(message, field, value)
        except AttributeError as unset:  # a field was deleted
            raise self._support.explain(message) or unset from None
        if not self._support.is_valid(message):
            error = self._support.explain(message)
            if error is not None:
                raise error
        try:
            return encode_around(message, field, size, self._encode, is_text=isinstance(value, str))
        except ENCODE_ERRORS as error:
            raise self._support.explain(with_field(message, field, value)) or error from None

    def _write(self, payload: Buffer) -> bool:
        """Publish an encoded sample."""
        status = self._quick.write(payload)
        if status is True:
            return True
        if status and status == shm.native.REPORT_DUE:
            self._link.report(self)
            return True
        return self._put(in_bytes(payload))

    def _put(self, *parts: Buffer | str) -> bool:
        """Publish a sample by the slow way: check its size, and count it where there is no room."""
        size = sum(map(len, parts))
        self._check_size(size)
        if size >= LARGE_BYTES:
            keep_freed_memory()
        is_taken = self._sender.put(*parts)
        self._refused += not is_taken
        return is_taken

    def _check_size(self, size: int) -> None:
        if self._refusal is not None:
            raise again(self._refusal)
        if size > self._max_bytes:
            raise PayloadTooLarge(self.topic_name, size_bytes=size, limit_bytes=self._max_bytes)

    def _ready_matches(self) -> int:
        return len(self._matches) - self._sender.count_expected(self._taps)

    def _counts(self) -> str:
        return f"subscriptions={len(self._matches)} published={self._sender.published[0]}"

    def _unmatch(self, other: int, *, is_lost: bool = False) -> None:
        gone = self._find_match(other)
        super()._unmatch(other)
        if gone is not None and self._id and gone.route != Route.BRIDGE:
            self._sender.unmatched(other, gone.gid, is_lost=is_lost)

    def _check_deadline(self) -> None:
        self._last_ns = max(self._last_ns, self._sender.last_ns)
        super()._check_deadline()

    async def _drain(self) -> None:
        """Before the end: hand over what can be handed over in a bounded time; the log tells of the rest."""
        with contextlib.suppress(TimeoutError, ConnectionClosed):
            async with asyncio.timeout(_DRAIN_S if self._id else 0):
                await self.flush()
        lost = self._sender.drop_queued()
        if lost:
            from bus.base.counted import counted  # few publishers lose anything

            self._logger.warning(
                f"{counted(lost, 'message')} on '{self.topic_name}' could not be handed over"
            )

    def _type_warning(self) -> str:
        return f"Incompatible type on topic '{self.topic_name}', no messages will be sent to it."

    def _qos_warning(self, policy: str) -> str:
        return (
            f"New subscription discovered on topic '{self.topic_name}', requesting incompatible QoS. "
            f"No messages will be sent to it. Last incompatible policy: {policy}"
        )
