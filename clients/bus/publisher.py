"""Publishers: typed messages in, samples out by the routes of the matches.

A message is checked, encoded and stamped in `publish`. It is written to the publisher's ring, for matches by
shared memory, and goes to the broker while there are other matches (`bus.delivery`).
"""

import asyncio
from operator import index as to_index
from typing import TYPE_CHECKING, TypeVar

import msgspec

from bus import shm
from bus.base.awaited import done_anyway
from bus.delivery.sender import find_loan_class
from bus.endpoint.core import NodeContext
from bus.endpoint.endpoint import Endpoint
from bus.endpoint.publisher_core import PublisherCore
from bus.endpoint.publisher_core import PublisherStatistics as PublisherStatistics
from bus.errors import PayloadTooLarge, again
from bus.events import PublisherEvents
from bus.qos import QoSProfile
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
from bus.wire import messages as m
from bus.wire.runs import Buffer
from bus.wire.source_time import source_head

if TYPE_CHECKING:  # few programs lend
    from bus.loan import Loan

M = TypeVar("M", bound=msgspec.Struct)

_JOINED_BYTES = 16 << 10
_TRIES = 3
"""Attempts of the quick way in a ring without room: the owner moves `hold`, then grows the ring."""
_SENDS_PER_TURN = 100
"""After this many sends without a wait, `send` gives the event loop a turn."""


class Publisher(Endpoint[M]):
    """Publishes messages of one type on one topic; made by `Node.create_publisher`.

    For example:

        publisher.publish(String(data="hi"))
    """

    _core: PublisherCore[M]

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
        sends = None
        shares_memory = node.link.shm_context is not None
        if shares_memory or shm.has_core():  # if there is room, `send` costs the same as `publish`
            sends = shm.native.Sends(self._send, self._send_on, self.send)
            self.send = sends.send  # type: ignore[method-assign, assignment]
        self._core = core = PublisherCore(
            node, topic, support, qos, events, sends, by_socket=by_socket, gid=gid
        )
        super().__init__(core)
        self._sender = core.sender
        self._quick = core.sender.quick
        self._support = support
        self._encode = support.encode
        self._sends_in_turn = 0
        self._long_fields = core.long_fields
        self._bytes_fields = {
            name: support.cls.__struct_fields__.index(name) for name in support.bytes_fields
        }

    def publish(self, message: M) -> bool:
        """Publish `message`; never blocks, and may be called from any thread.

        Returns False only if the QoS is reliable + keep all and there is no room until the subscriptions take
        more. Then the message was not published, and the refusal is counted (see `send`).

        Raises:

        - MessageTypeError: a message of another class, or a field of the wrong type
        - PayloadTooLarge: above the topic's limit
        - SharedMemoryError: the machine has no memory for it
        - LocalProtocolError: a loan is open
        - ConnectionClosed: after `close`
        """
        status = self._quick.publish(message)
        return True if status is True else self._publish_on(message, status)

    def _publish_on(self, message: M, status: int | bytes) -> bool:
        """Do the rest after `QuickWays.publish`, by its `status`, which is not True."""
        if isinstance(status, bytes):
            return self._put(status)
        if status and status in (shm.native.FULL, shm.native.HELD):
            # Everything else is right, so the message need not be encoded again to learn the same.
            for _ in range(_TRIES):
                if not self._sender.make_way(status):
                    self._core.refused += 1
                    return False
                status = self._quick.publish(message)
                if status is True:
                    return True
                if status not in (shm.native.FULL, shm.native.HELD):
                    break
        if status and status == shm.native.REPORT_DUE:
            core = self._core
            core.link.report(core)
            self._sender.watch_turn(core.least_depth)
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
        """Publish a message that is already encoded; as `publish`, but without a check of its type.

        Messages received by a subscription with `raw` can be forwarded this way. A subscription counts
        payloads that are not a message of its type as `undecodable`.

        `source_time_ns` is for messages that come from elsewhere: the time at which the message arose, in
        nanoseconds of the wall clock. Subscriptions see it as `source_timestamp`. Everything else (order,
        lifespan) depends on the time of publishing. Raises ConfigurationError if it is not a valid time.
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
        """Publish the messages in a `Pack`'s data from byte `start` on, each with its source time.

        For bridges: readers are woken once for all of them. Returns how many messages, from the front, were
        published: the ones that need no further work, possibly none. `publish_encoded` publishes the next
        one, or says why it can't.
        """
        count, is_report_due = self._quick.publish_packed(data, start)
        if is_report_due:
            self._core.link.report(self._core)
        return count

    def loan(self, message: M, field: str, size: int) -> "Loan | None":
        """Lend a buffer of `size` bytes for the field `field` of `message`; the caller fills it.

        The buffer is in the shared memory that subscriptions read, so nothing is copied: useful for a
        camera's frame. The other fields of `message` are encoded as they are now. Until the loan is published
        or discarded, this publisher can't publish anything else. Returns None if `publish` would return
        False. Only for the event loop's thread.

        Raises the errors of `publish`, and MessageTypeError if the field is not bytes, ValueError for a
        negative size, LocalProtocolError on another thread.
        """
        index = self._bytes_fields.get(field)
        if index is None:
            raise no_such_field(self.type, field)
        sender = self._sender
        loan_class = find_loan_class()
        lending = sender.lending or sender.make_lending()
        made = self._quick.lend_field(message, index, size, loan_class, lending.end)
        if made in (shm.native.FULL, shm.native.HELD):  # as in `_publish_on`
            if not sender.make_way(made):
                self._core.refused += 1
                return None
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
        self._core.refused += loan is None
        return loan

    @done_anyway
    async def send(self, message: M) -> None:
        """Publish `message`; if the QoS is reliable + keep all, wait for room first.

        Raises the errors of `publish`. After a cancellation the message was not published.
        """
        await self._send(message)

    async def _send(self, message: M) -> None:
        """`send` without the native core's quick way."""
        # A loop of sends that never wait would block signals, timers, and new matches.
        self._sends_in_turn += 1
        if self._sends_in_turn > _SENDS_PER_TURN:
            self._sends_in_turn = 1
            await asyncio.sleep(0)
        while not self.publish(message):
            self._core.refused -= 1  # `send` tries again
            await self._sender.wait_for_room()

    def _send_on(self, message: M, status: int | bytes) -> bool:
        """As `_publish_on`, for `send`, which waits for room if this returns False."""
        is_taken = self._publish_on(message, status)
        self._core.refused -= not is_taken  # `send` tries again
        return is_taken

    async def wait_for_room(self) -> None:
        """After `publish` or `loan` found no room: wait until a new attempt may succeed.

        Raises ConnectionClosed if the publisher is closed meanwhile. Cancellation leaves nothing behind.
        """
        await self._sender.wait_for_room()

    async def flush(self) -> None:
        """Wait until everything published has left this process: by shared memory, or through busd's socket.

        While busd is away, messages that go through its socket wait until it is back.

        Raises ConnectionClosed if the connection is closed first. A cancellation loses nothing.
        """
        await self._sender.flush()

    async def wait_for_subscriptions(self, number: int = 1) -> None:
        """Wait until at least `number` subscriptions are matched and can be woken.

        Has no time limit: use `asyncio.timeout`. Raises ConnectionClosed if the publisher is closed
        meanwhile. Cancellation leaves nothing behind.
        """
        await self._core.wait_for_matches(number)

    def get_subscription_count(self) -> int:
        """The number of subscriptions matched now; `wait_for_subscriptions` waits until they can be woken."""
        return len(self._core.matches)

    def assert_liveliness(self) -> None:
        """Assert that this publisher is alive, without publishing (liveliness manual by topic).

        Raises ConnectionClosed after `close`. Has no effect while busd is away.
        """
        core = self._core
        if core.refusal is not None:
            raise again(core.refusal)
        core.link.send_about(core, m.AssertLiveliness(publisher=core.id))

    def statistics(self) -> PublisherStatistics:
        """Its counters until now; `close` keeps them."""
        return self._core.statistics()

    # --- inside

    def _publish_around(self, message: M, field: str, value: memoryview | str) -> bool:
        """Publish a message with a long field, which is copied once, straight to its final place."""
        before, after = self._encode_around(message, field, value, len(value))
        return self._put(before, value, after)

    def _encode_around(self, message: M, field: str, value: Buffer | str, size: int) -> tuple[bytes, bytes]:
        """The encoding before and after `size` bytes as `field`; the check of types sees `value` there."""
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
            self._core.link.report(self._core)
            return True
        return self._put(in_bytes(payload))

    def _put(self, *parts: Buffer | str) -> bool:
        """Publish a sample by the slow way: check its size, and count it if there is no room."""
        size = sum(map(len, parts))
        self._check_size(size)
        if size >= LARGE_BYTES:
            keep_freed_memory()
            self._sender.expect_long()
        is_taken = self._sender.put(*parts)
        self._core.refused += not is_taken
        return is_taken

    def _check_size(self, size: int) -> None:
        core = self._core
        if core.refusal is not None:
            raise again(core.refusal)
        if size > core.max_bytes:
            raise PayloadTooLarge(self.topic_name, size_bytes=size, limit_bytes=core.max_bytes)

    def _counts(self) -> str:
        return f"subscriptions={len(self._core.matches)} published={self._sender.published[0]}"
