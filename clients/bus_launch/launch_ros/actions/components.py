"""Actions for components; programs import them from `launch_ros.actions`."""

import asyncio
from collections.abc import Iterable, Sequence
from typing import Any, List  # noqa: UP035 (the genuine one's `data_type`)

from bus_launch.launch.action import Action
from bus_launch.launch.core import (
    Event,
    LaunchContext,
    LaunchDescriptionEntity,
    SomeSubstitutionsType,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from bus_launch.launch.event_handlers import OnShutdown
from bus_launch.launch.frontend import Entity, Parser, expose_action
from bus_launch.launch_ros.actions.node import Node
from bus_launch.launch_ros.descriptions import ComposableNode
from bus_launch.launch_ros.load_requests import make_request
from bus_launch.launch_ros.loading import load

__all__ = ["ComposableNodeContainer", "LoadComposableNodes"]


@expose_action("node_container")
class ComposableNodeContainer(Node):
    """Runs a container, and loads components into it. On busd the components are node classes in Python."""

    def __init__(
        self,
        *,
        name: SomeSubstitutionsType,
        namespace: SomeSubstitutionsType,
        composable_node_descriptions: Iterable[ComposableNode] | None = None,
        **kwargs: Any,
    ) -> None:
        """Other arguments are those of Node."""
        super().__init__(name=name, namespace=namespace, **kwargs)
        self.__descriptions = list(composable_node_descriptions or ())

    @classmethod
    def parse(
        cls, entity: Entity, parser: Parser, ignore: Iterable[str] = ()
    ) -> tuple[type[Action], dict[str, Any]]:
        _, kwargs = super().parse(entity, parser, ignore)
        descriptions = _parse_components(entity, parser, is_optional=True)
        if descriptions is not None:
            kwargs["composable_node_descriptions"] = descriptions
        return cls, kwargs

    def execute(self, context: LaunchContext) -> Sequence[LaunchDescriptionEntity] | None:
        super().execute(context)
        if not self.__descriptions:
            return None
        return [LoadComposableNodes(composable_node_descriptions=self.__descriptions, target_container=self)]


@expose_action("load_composable_node")
class LoadComposableNodes(Action):
    """Loads components into a running container, one after the other. It waits for the container."""

    def __init__(
        self,
        *,
        composable_node_descriptions: Iterable[ComposableNode],
        target_container: SomeSubstitutionsType | ComposableNodeContainer,
        **kwargs: Any,
    ) -> None:
        """`target_container`: its full name, or its action. Raises TypeError for anything else."""
        super().__init__(**kwargs)
        self.__descriptions = list(composable_node_descriptions)
        self.__target = (
            target_container
            if isinstance(target_container, ComposableNodeContainer)
            else normalize_to_list_of_substitutions(target_container)
        )
        self.__loading: asyncio.Future[None] | None = None

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> tuple[type[Action], dict[str, Any]]:
        _, kwargs = super().parse(entity, parser)
        kwargs["target_container"] = parser.parse_substitution(entity.get_attr("target"))
        kwargs["composable_node_descriptions"] = _parse_components(entity, parser, is_optional=False)
        return cls, kwargs

    def get_asyncio_future(self) -> "asyncio.Future[None] | None":
        return self.__loading

    def execute(self, context: LaunchContext) -> None:
        ended = None
        if isinstance(self.__target, ComposableNodeContainer):
            name, ended = self.__target.node_name, self.__target.get_asyncio_future()
        else:
            name = f"/{perform_substitutions(context, self.__target).lstrip('/')}"
        # Made now: settings of a group end with the group.
        found = [make_request(one, context) for one in self.__descriptions]
        requests = [one for one in found if one is not None]
        if not requests or context.asyncio_loop is None or context.is_shutdown:
            return
        loading = context.asyncio_loop.create_task(load(name, requests, ended))

        def cancel(event: Event, context: LaunchContext) -> None:
            loading.cancel()

        handler = OnShutdown(on_shutdown=cancel)
        context.register_event_handler(handler)
        loading.add_done_callback(lambda _: context.unregister_event_handler(handler))
        self.__loading = loading


def _parse_components(entity: Entity, parser: Parser, *, is_optional: bool) -> list[ComposableNode] | None:
    entities = entity.get_attr("composable_node", data_type=List[Entity], optional=is_optional)  # noqa: UP006
    if entities is None:
        return None
    found = []
    for one in entities:
        component_class, kwargs = ComposableNode.parse(parser, one)
        found.append(component_class(**kwargs))
    return found
