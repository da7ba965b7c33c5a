"""Handlers of events of nodes; programs import it as `launch_ros.event_handlers`."""

from typing import Any

from bus_launch.launch.core import BaseEventHandler, Event, LaunchContext, SomeEntitiesType
from bus_launch.launch_ros.events.lifecycle import StateTransition

__all__ = ["OnStateTransition"]

__path__: list[str] = []  # there may be modules in it: a file for each class, as in ROS 2


class OnStateTransition(BaseEventHandler):
    """A lifecycle node has made a transition: a given one, or any."""

    def __init__(
        self,
        *,
        entities: SomeEntitiesType,
        target_lifecycle_node: Any = None,
        transition: str | None = None,
        start_state: str | None = None,
        goal_state: str | None = None,
        **kwargs: Any,
    ) -> None:
        if transition and (start_state or goal_state):
            raise ValueError("give either a transition, or start_state and goal_state")
        super().__init__(matcher=self.__takes, **kwargs)
        self.__entities = entities
        self.__node = target_lifecycle_node
        self.__wanted = {"transition": transition, "start_state": start_state, "goal_state": goal_state}

    def __takes(self, event: Event) -> bool:
        if not isinstance(event, StateTransition):
            return False
        if self.__node is not None and event.action is not self.__node:
            return False
        return all(getattr(event, name) == text for name, text in self.__wanted.items() if text)

    def describe(self) -> tuple[str, list[Any]]:
        entities = self.__entities
        return super().describe()[0], list(entities) if isinstance(entities, list | tuple) else [entities]

    def handle(self, event: Event, context: LaunchContext) -> SomeEntitiesType | None:
        super().handle(event, context)
        return self.__entities
