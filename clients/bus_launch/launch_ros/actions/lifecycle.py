"""Actions for lifecycle nodes; programs import them from `launch_ros.actions`."""

from collections.abc import Iterable, Sequence
from typing import Any

from bus_launch.launch.action import Action
from bus_launch.launch.actions import EmitEvent
from bus_launch.launch.core import (
    BaseEventHandler,
    Event,
    LaunchContext,
    LaunchDescriptionEntity,
    SomeSubstitutionsType,
)
from bus_launch.launch.frontend import Entity, Parser, expose_action
from bus_launch.launch_ros.actions.node import Node
from bus_launch.launch_ros.events.lifecycle import ChangeState, matches_node_name
from bus_launch.launch_ros.transitions import Transitions

__all__ = ["LifecycleNode", "LifecycleTransition"]


@expose_action("lifecycle_node")
class LifecycleNode(Node):
    """A node with a lifecycle: it makes the transitions of ChangeState events, and reports the transitions
    made.
    """

    def __init__(
        self,
        *,
        name: SomeSubstitutionsType,
        namespace: SomeSubstitutionsType = "",
        autostart: bool = False,
        **kwargs: Any,
    ) -> None:
        """`autostart`: configure and activate it as soon as it is there."""
        super().__init__(name=name, namespace=namespace or None, **kwargs)
        self.__autostart = autostart
        self.__transitions: Transitions | None = None

    @classmethod
    def parse(
        cls, entity: Entity, parser: Parser, ignore: Iterable[str] = ()
    ) -> tuple[type[Action], dict[str, Any]]:
        _, kwargs = super().parse(entity, parser)
        autostart = entity.get_attr("autostart", data_type=bool, optional=True, can_be_str=False)
        if autostart is not None:
            kwargs["autostart"] = autostart
        return cls, kwargs

    @property
    def node_autostart(self) -> bool:
        return self.__autostart

    def execute(self, context: LaunchContext) -> Sequence[LaunchDescriptionEntity] | None:
        super().execute(context)
        done = self.get_asyncio_future()
        if done is None or context.asyncio_loop is None:
            return None
        self.__transitions = Transitions(self, context)
        handler = _ChangesState(self, self.__transitions)
        context.register_event_handler(handler)
        task = context.asyncio_loop.create_task(self.__transitions.run(done))
        context.add_completion_future(task)
        if self.__autostart:
            self.__transitions.ask(1)
            self.__transitions.ask(3)
        return None


class _ChangesState(BaseEventHandler):
    def __init__(self, node: LifecycleNode, transitions: Transitions) -> None:
        super().__init__(
            matcher=lambda event: isinstance(event, ChangeState) and event.lifecycle_node_matcher(node)
        )
        self.__transitions = transitions

    def handle(self, event: Event, context: LaunchContext) -> None:
        super().handle(event, context)
        assert isinstance(event, ChangeState)
        self.__transitions.ask(event.transition_id)


class LifecycleTransition(Action):
    """Has some lifecycle nodes make transitions, one after the other."""

    def __init__(
        self,
        *,
        lifecycle_node_names: Iterable[SomeSubstitutionsType],
        transition_ids: Iterable[int | SomeSubstitutionsType],
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.__names = list(lifecycle_node_names)
        self.__ids = list(transition_ids)
        if not self.__names or not self.__ids:
            raise RuntimeError("LifecycleTransition needs lifecycle_node_names and transition_ids")

    def execute(self, context: LaunchContext) -> list[LaunchDescriptionEntity]:
        from bus_launch.launch.core import normalize_to_list_of_substitutions, perform_substitutions

        names = [
            perform_substitutions(context, normalize_to_list_of_substitutions(one)) for one in self.__names
        ]
        numbers = [
            one
            if isinstance(one, int)
            else int(perform_substitutions(context, normalize_to_list_of_substitutions(one)))
            for one in self.__ids
        ]
        return [
            EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_node_name(name), transition_id=number))
            for name in names
            for number in numbers
        ]
