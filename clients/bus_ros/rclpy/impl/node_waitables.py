"""The waitables of a node: objects of programs that wait for several entities at once."""

from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any

from bus_ros.entity import Entity

if TYPE_CHECKING:
    from bus_ros.rclpy.waitable import Waitable

__all__ = ["NodeWaitables"]


class NodeWaitables:
    """Base of Node. `add` and `remove` are for an entity."""

    def __init__(self, add: Callable[[Entity], object], remove: Callable[[Entity], object]) -> None:
        self.__add = add
        self.__remove = remove
        self.__waitables: list[tuple[Waitable, Entity]] = []
        self.waiting: list[Entity] = []
        """Entities that may have something to take while no executor works for the node."""

    def own_entities(self) -> Iterable[Entity]:
        raise NotImplementedError

    @property
    def waitables(self) -> Iterator["Waitable"]:
        """The added waitables, action servers and action clients."""
        from bus_ros.rclpy.waitable import Waitable  # late: few programs ask

        actions = [one for one in self.own_entities() if isinstance(one, Waitable)]
        return iter([*(waitable for waitable, _ in self.__waitables), *actions])

    def add_waitable(self, waitable: "Waitable") -> None:
        """Let the executor of this node work for a waitable, too."""
        from bus_ros.rclpy.impl.wait_set import WaitableEntity  # late: few nodes have any

        entity = WaitableEntity(waitable, self)
        self.__waitables.append((waitable, entity))
        self.__add(entity)

    def remove_waitable(self, waitable: "Waitable") -> None:
        """Remove a waitable; raises ValueError if the node does not have it."""
        found: list[tuple[Any, Entity]] = [one for one in self.__waitables if one[0] is waitable]
        if not found:
            raise ValueError(f"the node has no such waitable: {waitable!r}")
        self.__waitables.remove(found[0])
        self.__remove(found[0][1])
