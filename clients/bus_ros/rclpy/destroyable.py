"""Handles: what stands where rclpy's C library keeps an object. Knows only whether its owner is destroyed."""

from collections.abc import Callable
from functools import cached_property
from typing import Any, Protocol, Self

from bus_ros.rclpy.exceptions import InvalidHandle

__all__ = ["Destroyable", "Handle", "Handled"]

_DESTROYED = "cannot use Destroyable because destruction was requested"


class Handle:
    """Entered in a `with` to use its owner, which raises InvalidHandle once that is destroyed."""

    def __init__(
        self, is_destroyed: Callable[[], bool], destroy: Callable[[], object], owner: Any = None
    ) -> None:
        self._is_destroyed = is_destroyed
        self._destroy = destroy
        self.owner = owner

    @property
    def pointer(self) -> int:
        """Tells handles apart."""
        return id(self)

    def destroy_when_not_in_use(self) -> None:
        """At once: nothing here is in use but within a call."""
        if not self._is_destroyed():
            self._destroy()

    def check(self) -> None:
        """Raises InvalidHandle where the owner is destroyed."""
        if self._is_destroyed():
            raise InvalidHandle(_DESTROYED)

    def __enter__(self) -> Self:
        self.check()
        return self

    def __exit__(self, *_: object) -> None:
        """Leaving it destroys nothing."""


class _Owner(Protocol):
    @property
    def is_destroyed(self) -> bool: ...
    def destroy(self) -> None: ...


class Handled:
    """Base of what has a handle."""

    @cached_property
    def handle(self: _Owner) -> Handle:
        """For programs that enter rclpy's handles: `with subscription.handle:`."""
        return Handle(lambda: self.is_destroyed, self.destroy, self)


class Destroyable(Handled):
    """Base of what can be destroyed; `with` does it at the end."""

    def destroy(self) -> None:
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.destroy()
