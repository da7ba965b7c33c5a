"""Entities with callbacks for the transitions of a lifecycle node; a callback may refuse a transition."""

from collections.abc import Callable
from functools import wraps
from typing import Any, NamedTuple, overload

from bus_ros.rclpy.impl.transition_callback_return import (
    TransitionCallbackReturnType as TransitionCallbackReturn,
)

__all__ = ["ManagedEntity", "SimpleManagedEntity", "TransitionCallbackReturn"]


class LifecycleState(NamedTuple):
    """A state of a lifecycle node."""

    label: str
    state_id: int


class ManagedEntity:
    """Base of entities for `add_managed_entity`. `state` is the node's previous state.

    Each callback returns a result; the first that is not SUCCESS is the result of the transition.
    """

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        return TransitionCallbackReturn.SUCCESS


class SimpleManagedEntity(ManagedEntity):
    """A managed entity that knows whether it is activated."""

    def __init__(self) -> None:
        self._enabled = False

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._enabled = True
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._enabled = False
        return TransitionCallbackReturn.SUCCESS

    @property
    def is_activated(self) -> bool:
        return self._enabled

    @overload
    @staticmethod
    def when_enabled(wrapped: Callable[..., Any]) -> Callable[..., None]: ...
    @overload
    @staticmethod
    def when_enabled(
        wrapped: None = None, *, when_not_enabled: Callable[[], object] | None = None
    ) -> Callable[[Callable[..., Any]], Callable[..., None]]: ...

    @staticmethod
    def when_enabled(
        wrapped: Callable[..., Any] | None = None, *, when_not_enabled: Callable[[], object] | None = None
    ) -> Any:
        """A decorator of methods: without activation they do nothing, or call `when_not_enabled()`.

        The method's result is dropped, as in ROS 2.
        """

        def decorate(method: Callable[..., Any]) -> Callable[..., None]:
            @wraps(method)
            def call_if_enabled(self: SimpleManagedEntity, *args: Any, **keywords: Any) -> None:
                if self._enabled:
                    method(self, *args, **keywords)
                elif when_not_enabled is not None:
                    when_not_enabled()

            return call_if_enabled

        return decorate if wrapped is None else decorate(wrapped)
