"""Subscriptions: runs of samples in, typed messages out, by iteration or to a callback.

Samples wait undecoded in a queue of the subscription's depth and are decoded when they are taken. So replaced
samples cost almost nothing. One wake-up handles everything that has arrived.
"""

from collections.abc import AsyncIterator, Callable
from typing import Any, NamedTuple, TypeVar, Unpack

import msgspec

from bus.delivery.counters import SubscriptionStatistics as SubscriptionStatistics
from bus.endpoint.core import NodeContext
from bus.endpoint.endpoint import Endpoint
from bus.endpoint.subscription_core import Bridging as Bridging
from bus.endpoint.subscription_core import MessageInfo as MessageInfo
from bus.endpoint.subscription_core import SubscriptionCore, SubscriptionOptions
from bus.errors import ConfigurationError, ConnectionClosed
from bus.events import SubscriptionEvents
from bus.qos import QoSProfile
from bus.types.large_fields import view_type
from bus.types.support import TypeSupport

M = TypeVar("M", bound=msgspec.Struct)

_new_info: Any = tuple.__new__
"""Makes a MessageInfo of its parts, in half the time of a call of the class."""


class Pack(NamedTuple):
    """Messages back to back; made by `Subscription.take_packed`."""

    publisher_gid: bytes
    """Empty if the messages are from several publishers."""
    data: bytes
    """For each message: its number (u64), its source time (i64, nanoseconds of the wall clock), its size
    (u32), and the message; little-endian."""
    messages: int
    payload_bytes: int
    last_at: int
    """The offset of the last message's number."""
    is_consecutive: bool
    """Whether no message is missing between the first and the last."""
    has_more: bool
    """Whether more messages wait."""
    received_timestamp: int
    """The time at which they were taken, in nanoseconds of the wall clock."""


class Subscription(Endpoint[M]):
    """Receives messages of one type on one topic; made by `Node.create_subscription`.

    Without a callback: `async for message in subscription`, which ends when it is closed, or `receive`, or
    `take`. Beyond the depth, newer messages replace messages not yet taken; each replacement is counted.

        message, info = await subscription.receive()
    """

    _core: SubscriptionCore[M]

    def __init__(
        self,
        node: NodeContext,
        topic: str,
        support: TypeSupport[M],
        qos: QoSProfile,
        events: SubscriptionEvents,
        callback: Callable[..., Any] | None = None,
        **options: Unpack[SubscriptionOptions],
    ) -> None:
        self._core = core = SubscriptionCore(node, topic, support, qos, events, callback, **options)
        super().__init__(core)
        self._receiver = core.receiver
        self._ahead = core.receiver.ahead

    def take(self) -> tuple[M, MessageInfo] | None:
        """The oldest waiting message and its info, or None. Never blocks."""
        taken = self._receiver.take()
        return None if taken is None else (taken[0], self._core.info(taken))

    def take_many(self, limit: int) -> list[tuple[M, MessageInfo]]:
        """Up to `limit` of the oldest waiting messages, each with its info; never blocks.

        For programs that take many messages at a time, such as a recorder with `raw`. A message costs less
        than half of a `take`, and less than a callback with info. Wait for the first with `receive`.

            batch = [await subscription.receive(), *subscription.take_many(1000)]
        """
        batch = self._receiver.take_many(limit)
        offset_ns, number = self._core.link.wall_offset_ns, self._receiver.delivered - len(batch)
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

    def take_packed(self, most_bytes: int, longest: int, *, merges: bool = False) -> Pack | None:
        """The waiting messages of one publisher, in one buffer of at most `most_bytes`; never blocks.

        For bridges, which forward the buffer by `Publisher.publish_packed`: a message costs a tenth of its
        cost in `take_many`. With `merges`, for a recorder: the messages of all publishers, in the order in
        which they were published. Returns None if `take_many` has to take the next message: a message of
        `longest` bytes or more, a message received by socket, or any message without the native core.
        """
        offset_ns = self._core.link.wall_offset_ns
        found = self._receiver.take_packed(most_bytes, longest, offset_ns, merges=merges)
        if found is None:
            return None
        gid = b"" if found[0] is None else found[0].shown_gid
        return Pack(gid, *found[1:], self._receiver.stamp_ns + offset_ns)

    def set_arrival_callback(self, callback: Callable[[], object] | None) -> None:
        """Set a callback for the arrival of messages: called on the event loop, once for messages that came
        together.

        For programs that take from many subscriptions as soon as messages arrive, without a task for each.
        Messages that wait already are not announced. While it is set, `receive` and iteration are not woken;
        None removes it. Raises ConfigurationError if the subscription delivers its messages to a callback.

            subscription.set_arrival_callback(lambda: write(subscription.take_many(1000)))
        """
        if self._core.dispatcher is not None:
            raise ConfigurationError("a subscription that delivers to a callback announces no arrivals")
        self._core.announce(callback)

    def hold_back(self, publisher_gid: bytes) -> None:
        """Give one publisher no more room until `release`: a lossless publisher waits, and others go on.

        For bridges, if one publisher's route to the other bus is blocked. By shared memory, the subscription
        takes no more of its messages. By socket, messages that already had room still arrive, and are not
        acknowledged.
        """
        self._core.hold_back(publisher_gid)

    def release(self, publisher_gid: bytes) -> None:
        """Undo `hold_back`: give the publisher room again."""
        self._core.release(publisher_gid)

    async def receive(self) -> tuple[M, MessageInfo]:
        """Wait for the next message; returns it with its info.

        Has no time limit: use `asyncio.timeout`. Raises ConnectionClosed once the subscription is closed. A
        cancellation loses no message.
        """
        return await self._core.receive()

    def __aiter__(self) -> AsyncIterator[M]:
        return self

    async def __anext__(self) -> M:
        if self._ahead:
            return self._ahead.popleft()[0]
        while (taken := self._receiver.take()) is None:
            if type(self._core.refusal) is ConnectionClosed:
                raise StopAsyncIteration
            if (taken := await self._core.wait_for_arrival()) is not None:
                break
        return taken[0]

    async def wait_for_publishers(self, number: int = 1) -> None:
        """Wait until at least `number` publishers are matched.

        Has no time limit: use `asyncio.timeout`. Raises ConnectionClosed if the subscription is closed
        meanwhile. Cancellation leaves nothing behind.
        """
        await self._core.wait_for_matches(number)

    def get_publisher_count(self) -> int:
        """The number of publishers matched now."""
        return len(self._core.matches)

    def statistics(self) -> SubscriptionStatistics:
        """Its counters until now; `close` keeps them."""
        return self._core.statistics()

    def _counts(self) -> str:
        core = self._core
        dropped = sum(core.counters.dropped.values())
        return f"publishers={len(core.matches)} delivered={core.receiver.delivered} dropped={dropped}"


def decoder_of_views(support: TypeSupport[Any]) -> Callable[[Any], Any]:
    """As `support.decode`, but bytes fields are read-only views into the decoded buffer."""
    decode = msgspec.msgpack.Decoder(view_type(support.cls)).decode
    return lambda payload: decode(memoryview(payload).toreadonly())  # by socket it is a writable buffer
