"""Handles, in the place of rclpy's handles of C objects. Must know only whether the owner is destroyed."""

from collections.abc import Callable
from functools import cached_property
from typing import Any, Protocol, Self

from bus_ros.rclpy.exceptions import InvalidHandle

__all__ = ["Destroyable", "Handle", "Handled"]

_DESTROYED = "cannot use Destroyable because destruction was requested"


class Handle:
    """A handle; programs enter it by `with` to use its owner. Raises InvalidHandle once that is destroyed."""

    def __init__(
        self, is_destroyed: Callable[[], bool], destroy: Callable[[], object], owner: Any = None
    ) -> None:
        self._is_destroyed = is_destroyed
        self._destroy = destroy
        self.owner = owner

    @property
    def pointer(self) -> int:
        """A number that identifies the handle."""
        return id(self)

    def destroy_when_not_in_use(self) -> None:
        """Destroy the owner at once: nothing here is in use outside of a call."""
        if not self._is_destroyed():
            self._destroy()

    def check(self) -> None:
        """Raises InvalidHandle if the owner is destroyed."""
        if self._is_destroyed():
            raise InvalidHandle(_DESTROYED)

    def __enter__(self) -> Self:
        self.check()
        return self

    def __exit__(self, *_: object) -> None:
        """Destroys nothing."""


class _Owner(Protocol):
    @property
    def is_destroyed(self) -> bool: ...
    def destroy(self) -> None: ...


class Handled:
    """Base of objects with a handle."""

    @cached_property
    def handle(self: _Owner) -> Handle:
        """The handle for programs that use rclpy's handles: `with subscription.handle:`."""
        return Handle(lambda: self.is_destroyed, self.destroy, self)


class Destroyable(Handled):
    """Base of a node's endpoints: objects with `destroy`; the end of a `with` calls it."""

    node: Any

    @property
    def logger_name(self) -> str:
        """The logger name of its node."""
        return str(self.node.get_logger().name)

    def destroy(self) -> None:
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.destroy()
