"""Callback groups: which callbacks may run at the same time. Owns the groups' state.

Must not know executors. Every method may be called from any thread.
"""

from threading import Lock
from weakref import WeakSet, ref

from bus_ros.entity import Entity, Owner

__all__ = ["CallbackGroup", "MutuallyExclusiveCallbackGroup", "ReentrantCallbackGroup"]


class CallbackGroup:
    """Base of the groups. An entity is a subscription, timer, client, service, guard condition or waitable.

    `entities` are held weakly: a group keeps nothing alive.
    """

    is_exclusive = False
    """A thread may make several calls of an entity in a row: no other thread could make one meanwhile."""

    def __init__(self) -> None:
        self.entities: WeakSet[Entity] = WeakSet()
        self.is_shared = False
        """It has entities of more than one node; their executors may run in different threads."""
        self._node: ref[Owner] | None = None

    def add_entity(self, entity: Entity) -> None:
        self.entities.add(entity)
        node = getattr(entity, "node", None)
        if node is not None:
            known = self._node and self._node()
            self.is_shared |= known is not None and known is not node
            self._node = ref(node)

    def has_entity(self, entity: object) -> bool:
        return entity in self.entities

    def can_execute(self, entity: object) -> bool:
        """Whether the entity's callback could begin now."""
        raise NotImplementedError

    def beginning_execution(self, entity: object) -> bool:
        """Whether the entity's callback may begin; if so, `ending_execution` must follow."""
        raise NotImplementedError

    def ending_execution(self, entity: object) -> None:
        """Note the end of the entity's callback."""
        raise NotImplementedError


class ReentrantCallbackGroup(CallbackGroup):
    """Callbacks run whenever a thread is free, also several of one entity."""

    def can_execute(self, entity: object) -> bool:
        return True

    def beginning_execution(self, entity: object) -> bool:
        return True

    def ending_execution(self, entity: object) -> None:
        pass


class MutuallyExclusiveCallbackGroup(CallbackGroup):
    """One callback at a time."""

    is_exclusive = True

    def __init__(self) -> None:
        super().__init__()
        self._active_entity: object | None = None
        self._lock = Lock()

    def can_execute(self, entity: object) -> bool:
        return self._active_entity is None

    def beginning_execution(self, entity: object) -> bool:
        with self._lock:
            if self._active_entity is not None:
                return False
            self._active_entity = entity
            return True

    def ending_execution(self, entity: object) -> None:
        with self._lock:
            assert self._active_entity is entity, "another entity's callback is running"
            self._active_entity = None
