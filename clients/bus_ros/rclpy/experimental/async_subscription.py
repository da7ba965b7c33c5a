"""Subscriptions of an AsyncNode: a native subscription with the program's callback, or to iterate."""

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine, Iterable
from functools import wraps
from typing import Any, Final, Generic, TypeVar

from bus.base.callbacks import is_async, takes_info
from bus.endpoint.endpoint import core_of
from bus.node import Node as NativeNode
from bus.subscription import MessageInfo as NativeInfo
from bus.subscription import Subscription as NativeSubscription
from bus.types.support import type_support
from bus_ros.rclpy.exceptions import InvalidHandle
from bus_ros.rclpy.impl.async_entity import AsyncEntity, AsyncOwner, End, current_task
from bus_ros.rclpy.impl.callback_checks import check_arguments
from bus_ros.rclpy.qos import QoSProfile, to_native
from bus_ros.rclpy.subscription import BaseSubscription, MessageInfo, message_info
from bus_ros.rclpy.subscription_content_filter_options import ContentFilterOptions

__all__ = ["AsyncSubscription"]

M = TypeVar("M")

MOST_AT_ONCE: Final = 1000
"""The most callbacks of a concurrent subscription at a time; further messages wait, within the depth."""


class AsyncSubscription(AsyncEntity, BaseSubscription[M], Generic[M]):
    """Made by `AsyncNode.create_subscription`.

    Without a callback (not in ROS 2), iterate: `async for message in subscription` ends with the node.
    """

    def __init__(
        self,
        owner: AsyncOwner,
        msg_type: type[M],
        topic_name: str,
        callback: Callable[..., object] | None,
        qos_profile: QoSProfile,
        *,
        raw: bool,
        concurrent: bool,
    ) -> None:
        AsyncEntity.__init__(self, owner)
        BaseSubscription.__init__(self, msg_type, qos_profile, raw=raw)
        self._topic_name = topic_name
        self._call: Any = callback  # None without a callback
        self._is_async = callback is not None and is_async(callback)
        self._concurrent = concurrent and self._is_async
        self._calls: set[asyncio.Task[Any]] = set()
        """The running calls of a concurrent callback."""
        self._native: NativeSubscription[Any] | None = None
        self._is_open = asyncio.Event()  # or destroyed

    @property
    def topic_name(self) -> str:
        return self._topic_name

    @property
    def callback(self) -> Callable[..., object] | None:
        """Setting it takes effect at the next message.

        Raises RuntimeError as `AsyncNode.create_subscription`, and TypeError for a `def` instead of an `async
        def`, or the reverse, or with another number of arguments.
        """
        callback: Callable[..., object] | None = self._call
        return callback

    @callback.setter
    def callback(self, callback: Callable[..., object]) -> None:
        check_arguments(callback)
        before = self._call
        if before is None or self._kind_of(before) != self._kind_of(callback):
            raise TypeError(
                f"the callback of '{self._topic_name}' can be replaced by one of the same kind only (def or"
                " async def, with or without the message info); make a new subscription"
            )
        self._call = callback
        self._use_direct(callback)

    def get_publisher_count(self) -> int:
        """The number of matched publishers; 0 before the node runs."""
        return 0 if self._native is None else self._native.get_publisher_count()

    async def __aiter__(self) -> AsyncIterator[M]:
        """The messages, until the subscription or its node is destroyed.

        Raises TypeError if it has a callback.
        """
        if self._call is not None:
            raise TypeError(f"the subscription to '{self._topic_name}' gives its messages to a callback")
        await self._is_open.wait()
        if self._native is None:
            return
        async for message in self._native:
            if self._filter is None or self._filter(message):
                yield message

    async def receive(self) -> tuple[M, MessageInfo]:
        """Wait for the next message; returns it with its info. Not a method of ROS 2's class.

        Has no time limit: use `asyncio.timeout`. A cancellation loses no message. Raises InvalidHandle if the
        subscription is destroyed before, bus.ConnectionClosed meanwhile.
        """
        await self._is_open.wait()
        while self._native is not None and not self.is_destroyed:
            message, info = await self._native.receive()
            if self._filter is None or self._filter(message):
                return message, message_info(info)
        raise InvalidHandle(f"the subscription to '{self._topic_name}' is destroyed")

    # --- for the node

    def ends(self) -> Iterable[End]:
        cls: Any = self.msg_type
        yield "subscription", self._topic_name, type_support(cls), to_native(self.qos_profile)

    # --- inside

    def _read_topic(self) -> str:
        return self._topic_name

    async def _open(self, native_node: NativeNode) -> None:
        self._native = await native_node.create_subscription(
            self.msg_type,
            self._topic_name,
            to_native(self.qos_profile),
            None if self._call is None else self._native_callback(self._call),
            raw=self.raw,
        )

    def _became_open(self) -> None:
        self._is_open.set()

    def _stop(self) -> None:
        self._is_open.set()
        dispatcher = core_of(self._native).dispatcher if self._native is not None else None
        if dispatcher is not None:
            dispatcher.end()
        for task in self._calls - {current_task()}:
            task.cancel()

    async def _close(self) -> None:
        if self._native is not None:
            await self._native.close()

    @staticmethod
    def _kind_of(callback: Callable[..., object]) -> tuple[bool, bool]:
        return is_async(callback), takes_info(callback)

    def _native_callback(self, callback: Callable[..., object]) -> Callable[..., Any]:
        """The function that the bus calls. It has the signature and, for warnings, the name of `callback`."""
        if self._concurrent:
            return self._concurrently(callback)
        if self._is_async:

            @wraps(callback)
            async def deliver_async(message: M, *info: NativeInfo) -> None:
                if self._filter is None or self._filter(message):
                    await self._call(message, *map(message_info, info))

            return deliver_async
        if takes_info(callback):

            @wraps(callback)
            def deliver_with_info(message: M, info: NativeInfo) -> object:
                if self._filter is None or self._filter(message):
                    return self._call(message, message_info(info))
                return None

            return deliver_with_info

        if self._filter is None:
            return callback  # without a frame in between; see `_use_direct`
        return self._filtered(callback)

    def _filtered(self, callback: Callable[..., object]) -> Callable[..., Any]:
        @wraps(callback)
        def deliver(message: M) -> object:
            if self._filter is None or self._filter(message):
                return self._call(message)
            return None

        return deliver

    def _use_direct(self, callback: Callable[..., object]) -> None:
        """Give the bus another callback, or another filter, for plain functions of the message."""
        dispatcher = core_of(self._native).dispatcher if self._native is not None else None
        if dispatcher is not None and self._kind_of(callback) == (False, False):
            dispatcher.replace_callback(self._native_callback(callback))

    def _use_filter(self, options: ContentFilterOptions, passes: Callable[[Any], bool] | None) -> None:
        super()._use_filter(options, passes)
        if self._call is not None:
            self._use_direct(self._call)

    def _concurrently(self, callback: Callable[..., object]) -> Callable[..., Coroutine[Any, Any, None]]:
        places = asyncio.Semaphore(MOST_AT_ONCE)

        @wraps(callback)
        async def deliver(message: M, *info: NativeInfo) -> None:
            if self._filter is not None and not self._filter(message):
                return
            await places.acquire()
            task = self._owner.run_in_group(self._call(message, *map(message_info, info)))
            if task is not None:
                self._calls.add(task)
                task.add_done_callback(self._calls.discard)
                task.add_done_callback(lambda _: places.release())

        return deliver
