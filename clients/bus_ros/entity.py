"""Entities: the parts of a node that can have calls for an executor to make."""

from collections import deque
from collections.abc import Callable
from itertools import count
from typing import Any, Protocol, TypeAlias

from bus_ros.engine import Lifetime, Waiter

Work: TypeAlias = tuple[Callable[..., object], tuple[Any, ...]]
"""A call to be made without the guard."""

_orders = count()


class Group(Protocol):
    """A callback group."""

    @property
    def is_exclusive(self) -> bool: ...
    @property
    def is_shared(self) -> bool: ...
    def add_entity(self, entity: "Entity") -> None: ...
    def can_execute(self, entity: object) -> bool: ...
    def beginning_execution(self, entity: object) -> bool: ...
    def ending_execution(self, entity: object) -> None: ...


class Line(Protocol):
    """The interface of an executor for its entities."""

    handed: set[Any]
    last_handed: Any
    lone: Any

    @property
    def ready(self) -> deque[Any]: ...
    @property
    def waiter(self) -> Waiter: ...
    def is_looking(self) -> bool: ...
    def on_timers_changed(self) -> None: ...
    def create_task(self, callback: Callable[..., Any], *args: Any) -> object: ...


class Owner(Protocol):
    """The interface of a node for its entities."""

    waiting: "list[Entity]"
    """Entities that may have something to take, while the node has no executor."""

    @property
    def own_executor(self) -> Line | None: ...
    @property
    def context(self) -> Lifetime: ...
    def get_logger(self) -> Any: ...
    def destroy_subscription(self, subscription: Any) -> bool: ...
    def destroy_client(self, client: Any) -> bool: ...
    def destroy_service(self, service: Any) -> bool: ...
    def destroy_guard_condition(self, guard: Any) -> bool: ...
    def destroy_timer(self, timer: Any) -> bool: ...


class Entity:
    """Base of subscriptions, timers, services, clients, guard conditions and events.

    `take` and `notify` are called under the engine's guard.
    """

    is_async = False
    """Its work may return a coroutine, which holds the group until it ends."""
    is_single = False
    """After one `take`, nothing more can be taken for now."""
    is_timer = False
    is_step = False
    """It is a step of a task instead."""
    is_closed = False
    """A nested spin in its own callback makes no other call of it."""
    rank = 0
    """The place of its kind in a round of an executor; 0: events, actions, a program's waitables."""

    def __init__(self, node: Owner, callback_group: Group | None) -> None:
        self.node = node
        self.callback_group = callback_group
        self.held_group = callback_group
        """The group that a call holds, or None: other callbacks of it do not run meanwhile."""
        self.is_exclusive: bool = callback_group is not None and callback_group.is_exclusive
        self.is_queued = False  # at an executor, or at its node
        self.order = next(_orders)
        self.place = self.rank, self.order
        self.is_destroyed = False
        if callback_group is not None:
            callback_group.add_entity(self)

    def take(self, most: int) -> Work | None:
        """The next call, with up to `most` messages if it is a call for messages; None if there is none."""
        raise NotImplementedError

    def leave(self) -> None:
        """Hand nothing to an executor from now on; wait until it takes."""

    def notify(self) -> None:
        """Tell the executor, or else the node, that there may be something to take."""
        if not self.is_queued and not self.is_destroyed:
            self.is_queued = True
            executor = self.node.own_executor
            if executor is None:
                self.node.waiting.append(self)
                return
            executor.ready.append(self)  # as Executor.enqueue, inlined: a call is slow after a sleep
            waiter = executor.waiter
            if not waiter.is_set:
                waiter.set()
