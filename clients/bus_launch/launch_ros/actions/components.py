"""Actions for components: launch files may have them, but executing one is an error."""

from typing import Any

from bus_launch.launch.action import Action
from bus_launch.launch.core import LaunchContext
from bus_launch.launch.frontend import Entity, Parser, expose_action
from bus_launch.launch_ros.descriptions import refuse_components

__all__ = ["ComposableNodeContainer", "LoadComposableNodes"]


class _Components(Action):
    def __init__(self, *, condition: Any = None, **kwargs: Any) -> None:
        super().__init__(condition=condition)
        self.name = kwargs.get("name")

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> tuple[type[Action], dict[str, Any]]:
        refuse_components(f"<{entity.type_name}>")

    def execute(self, context: LaunchContext) -> None:
        refuse_components(type(self).__name__)


@expose_action("node_container")
class ComposableNodeContainer(_Components):
    """Refused: launch files on busd can't start containers or load components."""


@expose_action("load_composable_node")
class LoadComposableNodes(_Components):
    """Refused: launch files on busd can't start containers or load components."""
