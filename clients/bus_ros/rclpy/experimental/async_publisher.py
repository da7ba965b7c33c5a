"""Publishers of an AsyncNode: a native publisher, and the messages published before busd knows it."""

from collections import deque
from collections.abc import Callable, Coroutine, Iterable
from threading import RLock
from time import time_ns
from typing import Any, Generic, TypeVar

from bus.endpoint.endpoint import core_of
from bus.errors import BusError, ConnectionClosed
from bus.node import Node as NativeNode
from bus.publisher import Publisher as NativePublisher
from bus.types.support import type_support
from bus_ros.rclpy.impl.async_entity import AsyncEntity, AsyncOwner, End
from bus_ros.rclpy.impl.openings import Openings
from bus_ros.rclpy.publisher import BasePublisher, why_closed
from bus_ros.rclpy.qos import HistoryPolicy, QoSProfile, to_native

__all__ = ["AsyncPublisher"]

M = TypeVar("M")

MOST_HELD = 1000
"""The most messages that a keep-all publisher holds; with keep last, the depth is the limit."""


class AsyncPublisher(AsyncEntity, BasePublisher[M], Generic[M]):
    """Made by `AsyncNode.create_publisher`."""

    def __init__(
        self, owner: AsyncOwner, msg_type: type[M], topic_name: str, qos_profile: QoSProfile
    ) -> None:
        AsyncEntity.__init__(self, owner)
        BasePublisher.__init__(self, msg_type, qos_profile, owner.node)
        self._topic_name = topic_name
        self._native: NativePublisher[Any] | None = None
        self._openings: Openings | None = None
        self._lock = RLock()
        """Messages of other threads wait while the held ones are published, and then come after them."""
        self._holds = 1  # until it is open
        self._held: deque[tuple[bytes, int]] = deque()
        """Encoded messages, each with its time."""
        keeps_all = qos_profile.history is HistoryPolicy.KEEP_ALL
        self._most_held = MOST_HELD if keeps_all else max(1, qos_profile.depth)
        self._keeps_all = keeps_all
        self._replaced = 0
        self._quick_publish: Callable[[Any], None] | None = None
        """Does the same as `publish` while it holds no messages."""
        self._quick_send: Callable[[Any], Coroutine[Any, Any, None]] | None = None
        """The same for `send`."""

    @property
    def topic_name(self) -> str:
        return self._topic_name

    def publish(self, msg: M | bytes) -> None:
        """Publish a message, or serialized bytes; never blocks.

        Before the node runs, and while it or a subscription to the topic in this event loop is being made,
        messages wait, within the depth.

        Raises TypeError for a message of another class, or with a wrong field; InvalidHandle after the
        publisher, or its node, was destroyed; RuntimeError if the QoS is reliable + keep all and there is no
        room (`send` waits for room).
        """
        if self._holds and self._is_held(msg):
            return
        assert self._native is not None
        status = core_of(self._native).sender.quick.publish(msg)
        if status is not True:
            self._publish_on(msg, status)

    def send(self, msg: M | bytes) -> Coroutine[Any, Any, None]:
        """As `publish`. If the QoS is reliable + keep all, waits for room; not a method of ROS 2's class.

        `await publisher.send(message)` costs no more than `publish`. After a cancellation the message was not
        published.
        """
        return self._send(msg)

    async def _send(self, msg: M | bytes) -> None:
        native = self._native
        if not self._holds and native is not None and msg.__class__ is self.msg_type:
            try:
                await native._send(msg)
            except ConnectionClosed as error:
                raise why_closed(self, error) from None
            return
        while not self._put(msg):
            assert self._native is not None
            await self._native.wait_for_room()

    def get_subscription_count(self) -> int:
        """The number of matched subscriptions that can be woken; 0 before the node runs."""
        return 0 if self._native is None else core_of(self._native).count_ready()

    def assert_liveliness(self) -> None:
        """Assert the publisher's liveliness if the QoS is manual by topic."""
        if self._native is not None:
            self._native.assert_liveliness()

    # --- for the node and its openings

    def begin(self, openings: Openings) -> None:
        super().begin(openings)
        self._openings = openings
        openings.add_publisher(self._topic_name, self)

    def hold(self) -> None:
        self._holds += 1
        vars(self).pop("publish", None)
        vars(self).pop("send", None)

    def release(self) -> None:
        with self._lock:
            if self._holds == 1 and self._held:
                self._publish_held()
            self._holds -= 1
        if self._holds:
            return
        if self._quick_publish is not None:
            self.publish = self._quick_publish  # type: ignore[assignment, method-assign]
        if self._quick_send is not None:
            self.send = self._quick_send  # type: ignore[assignment, method-assign]

    def ends(self) -> Iterable[End]:
        cls: Any = self.msg_type
        yield (
            "publisher",
            self._topic_name,
            type_support(cls),
            to_native(self.qos_profile, for_publisher=True),
        )

    # --- inside

    def _is_matched(self) -> bool:
        return self._native is not None and bool(self._native.matches)

    async def _open(self, native_node: NativeNode) -> None:
        self._native = await native_node.create_publisher(
            self.msg_type,
            self._topic_name,
            to_native(self.qos_profile, for_publisher=True),
        )
        sends = core_of(self._native).sender.quick.sends
        if sends is None:
            return
        # The fast paths in one native call, without a Python frame.
        if type(self).publish is AsyncPublisher.publish:
            sends.share(None, self._publish_on)
            self._quick_publish = sends.publish_shared
        if type(self).send is AsyncPublisher.send:
            sends.slow = self._send
            self._quick_send = sends.send

    def _became_open(self) -> None:
        self.release()

    def _stop(self) -> None:
        if self._openings is not None:
            self._openings.remove_publisher(self._topic_name, self)
        with self._lock:
            if self._native is not None and self._held:
                self._publish_held()  # a subscription that was opening lost its wait, the others get them
            self._held.clear()
            self.hold()  # for good: `publish` finds it destroyed

    def _close_at_once(self) -> bool:
        return self._native is None or core_of(self._native).close_at_once()

    async def _close(self) -> None:
        if self._native is not None:
            await self._native.close()

    def _publish_on(self, msg: Any, status: Any) -> None:
        """Do the rest after the fast path, by its `status`, which is not True. None: it was not tried."""
        native = self._native
        assert native is not None
        if status is None:
            status = core_of(native).sender.quick.publish(msg)
        if status is True:
            return
        if msg.__class__ is not self.msg_type:
            is_taken = self._put(msg)
        else:
            try:
                is_taken = native._publish_on(msg, status)
            except ConnectionClosed as error:
                raise why_closed(self, error) from None
        if not is_taken:
            raise self._no_room()

    def _put(self, msg: M | bytes) -> bool:
        """Publish, or hold; returns False if there is no room."""
        native = self._native
        if self._holds:
            if self._keeps_all and len(self._held) >= self._most_held and native is not None:
                return False
            if self._is_held(msg):
                return True
        assert native is not None
        try:
            return native.publish_encoded(self._encoded(msg))
        except ConnectionClosed as error:
            raise why_closed(self, error) from None

    def _is_held(self, msg: M | bytes) -> bool:
        """Hold a message; returns False if it is to be published at once."""
        with self._lock:
            if self._holds:
                self._hold(msg)
                return True
        return False

    def _hold(self, msg: M | bytes) -> None:
        if self.is_destroyed:
            raise why_closed(self, ConnectionClosed(""))
        data = self._encoded(msg)
        if len(self._held) >= self._most_held:
            if self._keeps_all:
                raise self._no_room()
            self._held.popleft()
            self._replaced += 1
        self._held.append((data, time_ns()))

    def _publish_held(self) -> None:
        native, held = self._native, self._held
        assert native is not None
        replaced, self._replaced = self._replaced, 0
        if replaced:
            self._owner.get_logger().warning(
                f"{replaced} messages on '{self._topic_name}' were published before the node ran, beyond the"
                f" depth of {self._most_held}: newer ones replaced them"
            )
        try:
            while held:
                data, at_ns = held[0]
                if not native.publish_encoded(data, source_time_ns=at_ns):
                    self.hold()  # the rest goes first, and later messages wait behind it
                    self._owner.run_behind(self._publish_rest(native))
                    return
                held.popleft()
        except BusError as error:
            held.clear()
            self._owner.get_logger().error(f"messages on '{self._topic_name}' were not published: {error}")

    async def _publish_rest(self, native: NativePublisher[Any]) -> None:
        try:
            await native.wait_for_room()
        finally:
            self.release()

    def _no_room(self) -> RuntimeError:
        return RuntimeError(
            f"no room to publish on '{self._topic_name}': the subscriptions have taken too little, and"
            " keep_all keeps all; `await publisher.send(message)` waits for room"
        )
