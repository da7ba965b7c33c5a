"""`rclpy.waitable`: an entity of a node that waits for several entities at once.

A program's Waitable makes entities of `rclpy_implementation`, adds them to a given wait set, and returns
whether it is ready. Owns only the base class; `impl.wait_set` has the rest.
"""

from typing import Any

__all__ = ["NumberOfEntities", "Waitable"]


class NumberOfEntities:
    """The number of entities of each kind that a Waitable adds to a wait set."""

    __slots__ = (
        "num_clients",
        "num_events",
        "num_guard_conditions",
        "num_services",
        "num_subscriptions",
        "num_timers",
    )

    def __init__(
        self,
        num_subs: int = 0,
        num_gcs: int = 0,
        num_timers: int = 0,
        num_clients: int = 0,
        num_services: int = 0,
        num_events: int = 0,
    ) -> None:
        self.num_subscriptions = num_subs
        self.num_guard_conditions = num_gcs
        self.num_timers = num_timers
        self.num_clients = num_clients
        self.num_services = num_services
        self.num_events = num_events

    def __add__(self, other: "NumberOfEntities") -> "NumberOfEntities":
        total = NumberOfEntities()
        for name in self.__slots__:
            setattr(total, name, getattr(self, name) + getattr(other, name))
        return total

    def __repr__(self) -> str:
        numbers = ", ".join(str(getattr(self, name)) for name in _IN_ORDER)
        return f"<{type(self).__name__}({numbers})>"


_IN_ORDER = (
    "num_subscriptions",
    "num_guard_conditions",
    "num_timers",
    "num_clients",
    "num_services",
    "num_events",
)


class Waitable:
    """Base of waitables that programs add to a node by `Node.add_waitable`.

    An executor makes it add its entities. Once they are ready, it calls `is_ready`, then `take_data`, and
    runs `execute` with the result. A program defines all of these methods.
    """

    def __init__(self, callback_group: Any) -> None:
        self.callback_group = callback_group
        callback_group.add_entity(self)
        self._futures: list[Any] = []

    def add_future(self, future: Any) -> None:
        """Keep it until it is removed."""
        self._futures.append(future)

    def remove_future(self, future: Any) -> None:
        self._futures.remove(future)

    def is_ready(self, wait_set: Any) -> bool:
        """Whether any of its entities is ready."""
        raise NotImplementedError("Must be implemented by subclass")

    def take_data(self) -> Any:
        """Take its data; then it is not ready any more."""
        raise NotImplementedError("Must be implemented by subclass")

    async def execute(self, taken_data: Any) -> None:
        """Work with what `take_data` returned."""
        raise NotImplementedError("Must be implemented by subclass")

    def get_num_entities(self) -> NumberOfEntities:
        raise NotImplementedError("Must be implemented by subclass")

    def add_to_wait_set(self, wait_set: Any) -> None:
        """Add its entities."""
        raise NotImplementedError("Must be implemented by subclass")
