"""Subscriptions of the facade: a native subscription; an executor takes its messages when it is free."""

from collections.abc import Callable, Sequence
from enum import Enum, IntEnum
from functools import cached_property
from time import monotonic_ns
from typing import TYPE_CHECKING, Any, Generic, TypedDict, TypeVar

from bus.base.callbacks import is_async, takes_info
from bus.endpoint.endpoint import core_of
from bus.subscription import MessageInfo as NativeInfo
from bus.subscription import Subscription as NativeSubscription
from bus_ros.engine import Engine
from bus_ros.entity import Entity, Group, Line, Owner, Work
from bus_ros.rclpy.destroyable import Destroyable
from bus_ros.rclpy.exceptions import RCLError
from bus_ros.rclpy.impl.callback_checks import check_arguments
from bus_ros.rclpy.impl.handover import Handover
from bus_ros.rclpy.qos import QoSProfile
from bus_ros.rclpy.subscription_content_filter_options import ContentFilterOptions

if TYPE_CHECKING:
    from bus_ros.rclpy.event_handler import EventHandler, SubscriptionEventCallbacks

__all__ = ["BaseSubscription", "MessageInfo", "Subscription", "message_info"]

M = TypeVar("M")

_TURN_NS = 2_500_000


class MessageInfo(TypedDict):
    """The second argument of a callback with two. Times are nanoseconds since 1970."""

    source_timestamp: int
    received_timestamp: int
    publication_sequence_number: int
    reception_sequence_number: int


class BaseSubscription(Destroyable, Generic[M]):
    """Base of `Subscription` and of `rclpy.experimental.AsyncSubscription`."""

    class CallbackType(Enum):
        """The number of arguments of the callback."""

        MessageOnly = 0
        WithMessageInfo = 1

    node: Any

    def __init__(self, msg_type: type[M], qos_profile: QoSProfile, *, raw: bool) -> None:
        self.msg_type = msg_type
        self.qos_profile = qos_profile
        self.raw = raw
        self._filter: Callable[[Any], bool] | None = None
        self._filter_options = ContentFilterOptions()

    @property
    def topic(self) -> str:
        return self.topic_name

    @property
    def topic_name(self) -> str:
        raise NotImplementedError

    @property
    def is_cft_enabled(self) -> bool:
        """Whether there is a content filter."""
        return self._filter is not None

    def get_content_filter(self) -> ContentFilterOptions:
        """The content filter. Raises RCLError if there is none."""
        if self._filter is None:
            raise RCLError("failed to get content filter: there is none")
        return self._filter_options

    def set_content_filter(self, filter_expression: str, expression_parameters: Sequence[str]) -> None:
        """Call back only for messages that pass the filter, from now on; an empty expression: for all.

        The subscription filters, so filtered messages are received nevertheless. Raises RCLError for an
        invalid expression.
        """
        options = ContentFilterOptions(filter_expression, expression_parameters)
        self._use_filter(options, self._compiled(options) if filter_expression else None)

    def _use_filter(self, options: ContentFilterOptions, passes: Callable[[Any], bool] | None) -> None:
        self._filter, self._filter_options = passes, options

    def _compiled(self, options: ContentFilterOptions) -> Callable[[Any], bool]:
        from bus.types.support import type_support  # late: few subscriptions have filters
        from bus_ros.content_filter import FilterError, compile_filter

        try:
            passes = compile_filter(*options, self.msg_type())
        except FilterError as error:
            raise RCLError(f"failed to set content filter: {error}") from None
        if not self.raw:
            return passes
        cls: Any = self.msg_type
        decode = type_support(cls).decode

        def passes_raw(data: bytes) -> bool:
            try:
                message = decode(data)
            except Exception:  # it is no message of the type; a message class may raise anything
                return False
            return passes(message)

        return passes_raw


class Subscription(Entity, BaseSubscription[M]):
    """Made by `Node.create_subscription`."""

    rank = 2
    event_callbacks: "SubscriptionEventCallbacks | None" = None

    def __init__(
        self,
        engine: Engine,
        native: NativeSubscription[Any],
        msg_type: type[M],
        callback: Callable[..., object],
        callback_group: Group,
        qos_profile: QoSProfile,
        raw: bool,
        node: Owner,
    ) -> None:
        BaseSubscription.__init__(self, msg_type, qos_profile, raw=raw)
        self._callback = callback
        self.is_async = is_async(callback)
        self._engine = engine
        self.native = native
        self._receiver = core_of(native).receiver
        self._take_messages = self._receiver.take_messages
        self._wants_info = takes_info(callback)
        self.batch = 1
        """The number of messages to take at once."""
        self._setting = object()
        """Another object after each change of the callback or the filter."""
        # With a deadline, too: only `take` notes the time of a message.
        self._is_timed = native.qos.deadline is not None
        self._takes_one = self.is_async or self._wants_info or self._is_timed
        Entity.__init__(self, node, callback_group)
        self._handover = Handover(engine, self)
        with engine.loop:
            native.set_arrival_callback(self._on_message)

    @property
    def callback(self) -> Callable[..., object]:
        """Setting it takes effect at the next message. Raises RuntimeError as `Node.create_subscription`."""
        return self._callback

    @callback.setter
    def callback(self, callback: Callable[..., object]) -> None:
        check_arguments(callback)
        with self._engine.loop:
            self._callback = callback
            self.is_async = is_async(callback)
            self._wants_info = takes_info(callback)
            self._takes_one = self.is_async or self._wants_info or self._is_timed or self._filter is not None
            self._setting = object()
            self.leave()

    @property
    def _callback_type(self) -> BaseSubscription.CallbackType:
        """rclpy's private name for it."""
        kinds = self.CallbackType
        return kinds.WithMessageInfo if self._wants_info else kinds.MessageOnly

    @cached_property
    def event_handlers(self) -> "list[EventHandler]":
        """Handlers for its events other than messages: callbacks, or warnings."""
        from bus_ros.rclpy.event_handler import SubscriptionEventCallbacks  # late: few programs ask

        callbacks = self.event_callbacks or SubscriptionEventCallbacks()
        return callbacks.create_event_handlers(self.callback_group, self.handle, self.topic_name)

    @property
    def topic_name(self) -> str:
        return self.native.topic_name

    def get_publisher_count(self) -> int:
        """The number of matched publishers."""
        with self._engine.loop:
            return self.native.get_publisher_count()

    def destroy(self) -> None:
        """Stop the calls."""
        self.node.destroy_subscription(self)

    def _use_filter(self, options: ContentFilterOptions, passes: Callable[[Any], bool] | None) -> None:
        with self._engine.loop:
            super()._use_filter(options, passes)
            self._takes_one = self.is_async or self._wants_info or self._is_timed or passes is not None
            self._setting = object()
            self.leave()

    def _watch_event(self, event_type: IntEnum, enqueue: Any) -> Any:
        from bus_ros.rclpy.event_handler import watch_event  # late: few programs have wait sets

        return watch_event(self.native, event_type, enqueue)

    # --- for the executor

    def leave(self) -> None:
        self._handover.end()

    def take(self, most: int) -> Work | None:
        if self._handover.is_waited_for:
            return None
        if self._takes_one:
            taken = self.native.take()
            while taken is not None and self._filter is not None and not self._filter(taken[0]):
                taken = self.native.take()
            if taken is None:
                return None
            return self._callback, (taken[0], message_info(taken[1])) if self._wants_info else taken[:1]
        receiver = self._receiver
        if receiver.ahead:
            return self._callback, receiver.ahead.popleft()[:1]
        if self.batch == 2 and not receiver.has_more:
            self.batch = 1  # the previous message was the only one
            return None
        number = min(self.batch, most)
        messages = self._take_messages(number)
        if not messages:
            self.batch = 1
            single = receiver.take()
            return None if single is None else (self._callback, single[:1])
        if number == 1:
            self.batch = 2
            return self._callback, (messages[0],)
        return self._call_with, (messages, self.node.own_executor)

    def _call_with(self, messages: list[M], executor: Line | None) -> None:
        """Call back for all messages, unless that takes long, the executor loses the node, or a callback
        changes the callback or the filter.

        A fast callback gets more messages at a time, which saves turns of the executor.
        """
        callback, setting, node, context = self._callback, self._setting, self.node, self.node.context
        end_ns = monotonic_ns() + _TURN_NS
        left = iter(messages)
        try:
            for message in left:
                callback(message)
                if monotonic_ns() > end_ns or node.own_executor is not executor:
                    break
                if self.is_destroyed or not context.is_valid or self._setting is not setting:
                    break
        finally:
            if rest := list(left):
                self._engine.call(self._put_back, rest)
        if len(messages) == self.batch:
            self.batch = min(2 * self.batch, 64) if monotonic_ns() < end_ns else 1

    def _on_message(self) -> None:
        """Handle a new message. The next may go directly to an executor that only waits for it."""
        executor, handover = self.node.own_executor, self._handover
        if executor is not handover.executor and not self._takes_one:
            handover.begin(executor)
        self.notify()

    def _put_back(self, messages: list[M]) -> None:
        self.batch = 1
        self._receiver.put_back(messages)
        self.notify()


def message_info(info: NativeInfo) -> MessageInfo:
    """The second argument of a callback, from the bus's."""
    return MessageInfo(
        source_timestamp=info.source_timestamp,
        received_timestamp=info.received_timestamp,
        publication_sequence_number=info.publication_sequence_number,
        reception_sequence_number=info.reception_sequence_number,
    )
