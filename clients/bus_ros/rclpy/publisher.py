"""Publishers of the facade: a native publisher, used under the guard by any publishing thread."""

from collections.abc import Callable, Coroutine
from contextlib import suppress
from enum import IntEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from bus.endpoint.endpoint import core_of
from bus.errors import ConnectionClosed
from bus.publisher import Publisher as NativePublisher
from bus.types.support import type_support
from bus.wire.runs import Buffer
from bus_ros.engine import Engine
from bus_ros.rclpy.destroyable import Destroyable
from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.exceptions import InvalidHandle
from bus_ros.rclpy.qos import QoSProfile
from bus_ros.rclpy.serialization import native_bytes

if TYPE_CHECKING:
    from bus_ros.rclpy.event_handler import EventHandler, PublisherEventCallbacks

__all__ = ["BasePublisher", "Publisher", "why_closed"]

M = TypeVar("M")

_READY_S = 0.1

ROOM_S = 10.0
"""The longest wait of `publish` for room if the QoS is reliable + keep all."""


class BasePublisher(Destroyable, Generic[M]):
    """Base of `Publisher` and of `rclpy.experimental.AsyncPublisher`."""

    def __init__(self, msg_type: type[M], qos_profile: QoSProfile, node: Any) -> None:
        self.msg_type = msg_type
        self.qos_profile = qos_profile
        self.node = node

    @property
    def topic(self) -> str:
        return self.topic_name

    @property
    def topic_name(self) -> str:
        raise NotImplementedError

    def _is_matched(self) -> bool:
        """Whether it has a subscription, which perhaps can't be woken yet."""
        raise NotImplementedError

    def _encoded(self, msg: M | bytes) -> bytes:
        """A message of the type or of a subclass, or bytes (MessagePack or CDR), as MessagePack.

        Raises TypeError for any other object.
        """
        if isinstance(msg, bytes):
            return native_bytes(msg, self.msg_type)
        if not isinstance(msg, self.msg_type):
            raise TypeError(f"Expected {self.msg_type}, got {type(msg)}")
        cls: Any = self.msg_type
        return type_support(cls).encode(msg)


class Publisher(BasePublisher[M]):
    """Made by `Node.create_publisher`."""

    event_callbacks: "PublisherEventCallbacks | None" = None
    _event_group: Any = None

    def __init__(
        self,
        engine: Engine,
        native: NativePublisher[Any],
        msg_type: type[M],
        qos_profile: QoSProfile,
        node: Any,
    ) -> None:
        super().__init__(msg_type, qos_profile, node)
        self._engine = engine
        self._loop = engine.loop
        self._guard = engine.loop.guard
        self.native = native
        self._core = core_of(native)
        self._awaited = 0  # of all matches until now, by `get_subscription_count`
        sends = self._core.sender.quick.sends
        if sends is not None and type(self).publish is Publisher.publish:
            sends.share(self._loop, self._publish_on)
            # Guard and fast path in one native call: this halves the time of a message.
            self.publish = sends.publish_shared  # type: ignore[method-assign]

    @property
    def is_destroyed(self) -> bool:
        return self not in self.node.publishers

    @cached_property
    def event_handlers(self) -> "list[EventHandler]":
        """Handlers for its events other than messages: callbacks, or warnings."""
        from bus_ros.rclpy.event_handler import PublisherEventCallbacks  # late: few programs ask

        callbacks = self.event_callbacks or PublisherEventCallbacks()
        group = self._event_group or self.node.default_callback_group
        return callbacks.create_event_handlers(group, self.handle, self.topic_name)

    @property
    def topic_name(self) -> str:
        return self.native.topic_name

    def publish(self, msg: M | bytes) -> None:
        """Publish a message, or serialized bytes (MessagePack or CDR); from any thread.

        If the QoS is reliable + keep all and there is no room, it waits for up to ROOM_S seconds, then raises
        RuntimeError. Raises TypeError for a message of another class, or with a wrong field; InvalidHandle
        after the publisher, or its node, was destroyed.
        """
        self._publish_on(msg, None)

    def get_subscription_count(self) -> int:
        """The number of matched subscriptions that can be woken.

        Waits once, for a bounded time, for new subscriptions: messages published before the event loop runs
        again would not wake them.
        """
        core, may_wait = self._core, not self._loop.is_mine()
        with self._loop:
            count, matched, total = core.count_ready(), len(core.matches), core.matches.total
        if count == matched or total == self._awaited or not may_wait:
            return count
        self._awaited = total
        with suppress(TimeoutError, ConnectionClosed):
            self._engine.run(lambda: core.wait_for_matches(matched), _READY_S)
        with self._loop:
            return core.count_ready()

    def assert_liveliness(self) -> None:
        """Assert the publisher's liveliness if the QoS is manual by topic."""
        self._engine.call(self.native.assert_liveliness)

    def wait_for_all_acked(self, timeout: Duration | None = None) -> bool:
        """Wait until all published messages are handed over; returns whether they are."""
        try:
            self._engine.run(self.native.flush, None if timeout is None else timeout.nanoseconds / 1e9)
        except TimeoutError:
            return False
        return True

    def destroy(self) -> None:
        """Stop publishing."""
        self.node.destroy_publisher(self)

    # --- inside

    def _is_matched(self) -> bool:
        with self._loop:
            return bool(self.native.matches)

    def _publish_on(self, msg: Any, status: int | bytes | None) -> None:
        """The rest of `publish` after the fast path, by its `status`; None: not tried."""
        if msg.__class__ is not self.msg_type:
            self._publish_other(msg)
            return
        is_taken = status is True
        native = self.native
        try:
            if not is_taken:
                with self._guard:
                    if status is None:
                        status = self._core.sender.quick.publish(msg)
                    is_taken = status is True or native._publish_on(msg, status)
        except ConnectionClosed as error:
            raise why_closed(self, error) from None
        if self._loop.is_interrupted:
            self._loop.check()
        if not is_taken:
            self._wait_for_room(lambda: self.native.send(msg))

    def _watch_event(self, event_type: IntEnum, enqueue: Any) -> Any:
        from bus_ros.rclpy.event_handler import watch_event  # late: few programs have wait sets

        return watch_event(self.native, event_type, enqueue)

    def _publish_other(self, msg: Any) -> None:
        """Publish bytes, or a message of a subclass of the topic's class."""
        data = self._encoded(msg)
        try:
            with self._loop:
                is_taken = self.native.publish_encoded(data)
        except ConnectionClosed as error:
            raise why_closed(self, error) from None
        if not is_taken:
            self._wait_for_room(lambda: self._send_encoded(data))

    async def _send_encoded(self, data: Buffer) -> None:
        while not self.native.publish_encoded(data):
            await self.native.wait_for_room()

    def _wait_for_room(self, send: Callable[[], Coroutine[Any, Any, None]]) -> None:
        try:
            self._engine.run(send, ROOM_S)
        except TimeoutError:
            raise RuntimeError(
                f"failed to publish on '{self.topic_name}': the subscriptions have taken nothing for"
                f" {ROOM_S:g} s, and keep_all keeps all"
            ) from None


def why_closed(publisher: Any, error: ConnectionClosed) -> Exception:
    """The error for the user after `error`, from a closed publisher."""
    if publisher.is_destroyed:
        return InvalidHandle(f"the publisher on '{publisher.topic_name}' is destroyed")
    return error
