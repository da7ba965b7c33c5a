"""What goes along with the transitions of a lifecycle node: it is told of each, and may refuse."""

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
    """Base of what `add_managed_entity` takes. `state` is the one from which the node comes.

    Each callback says how it went; the first that is not SUCCESS is the transition's own result.
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
        """A decorator of methods: they do nothing while the entity is not activated, or `when_not_enabled()`.

        What the method returns is dropped, as in ROS 2.
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
