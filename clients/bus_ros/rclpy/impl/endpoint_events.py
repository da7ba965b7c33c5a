"""Events of one publisher or subscription for its executor. Owns the values that wait for their callbacks.

As in ROS, an event is a state that changes: if several come before the callback is called, it is called once.
"""

from collections.abc import Callable
from typing import Any

from bus_ros.entity import Entity, Group, Owner, Work

__all__ = ["EndpointEvents", "changes_of", "merged"]


class EndpointEvents(Entity):
    """The calls of the program's callbacks, in their group.

    `translate` is `publisher_events` or `subscription_events`.
    """

    is_async = True

    def __init__(
        self, callbacks: Any, translate: Callable[..., Any], node: Owner, callback_group: Group
    ) -> None:
        super().__init__(node, callback_group)
        self._waiting: dict[type, tuple[Callable[[Any], object], Any]] = {}  # one for each kind of event
        self.native = translate(callbacks, self.put)
        """The callbacks for the bus."""

    def put(self, callback: Callable[[Any], object], info: Any) -> None:
        waiting = self._waiting.get(type(info))
        self._waiting[type(info)] = callback, info if waiting is None else merged(waiting[1], info)
        self.notify()

    def take(self, most: int) -> Work | None:
        if not self._waiting:
            return None
        callback, info = self._waiting.pop(next(iter(self._waiting)))
        return callback, (info,)


def merged(before: Any, info: Any) -> Any:
    """The value of two events: the newer one, with the changes of both."""
    return info._replace(**{name: getattr(before, name) + getattr(info, name) for name in changes_of(info)})


def changes_of(info: Any) -> list[str]:
    """The names of its fields that count since the previous event."""
    return [name for name in info._fields if name.endswith("_change")]
