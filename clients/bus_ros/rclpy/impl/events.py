"""Events of publishers and subscriptions for wait sets: `rclpy_implementation.EventHandle`.

Owns the combination of several events into one value until a program takes it. The endpoint defines the value
of an event.
"""

from enum import IntEnum
from typing import Any

from bus_ros.engine import engine
from bus_ros.rclpy.destroyable import Handle
from bus_ros.rclpy.impl.endpoint_events import changes_of, merged
from bus_ros.rclpy.impl.wait_set import Source

__all__ = ["EventHandle"]


class EventHandle(Source):
    """Ready from an event of this kind until it is taken.

    `parent` is the handle of a publisher or a subscription. Raises TypeError if the endpoint has no events of
    the kind. Warnings of incompatible endpoints end: a program with this handle gets the events.
    """

    def __init__(self, parent: Handle, event_type: IntEnum) -> None:
        super().__init__()
        watch: Any = getattr(parent.owner, "_watch_event", None)
        if watch is None:
            raise TypeError(f"events are of publishers and subscriptions, not of {parent.owner or parent!r}")
        with engine().loop:
            self._value = watch(event_type, self._come)
            self._is_new = any(getattr(self._value, name) for name in changes_of(self._value))

    def is_ready(self) -> bool:
        return self._is_new

    def take_event(self) -> Any:
        """The counts, and their changes since they were last taken."""
        self.check()
        with engine().loop:
            value, self._is_new = self._value, False
            self._value = value._replace(**dict.fromkeys(changes_of(value), 0))
        return value

    def _come(self, callback: object, value: Any) -> None:
        """Add an event; under the guard."""
        self._value, self._is_new = merged(self._value, value), True
        self._notify()
