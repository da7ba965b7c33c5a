"""The base of all actions; programs import it as `launch.action`."""

from collections.abc import Iterable, Sequence
from typing import Any

from bus_launch.launch.conditions import IfCondition, UnlessCondition
from bus_launch.launch.core import Condition, LaunchContext, LaunchDescriptionEntity
from bus_launch.launch.events import ExecutionComplete
from bus_launch.launch.frontend import Entity, Parser

__all__ = ["Action"]


class Action(LaunchDescriptionEntity):
    """Does something when it is visited; `execute` is for derived classes to define."""

    def __init__(self, *, condition: Condition | None = None) -> None:
        self.__condition = condition

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> tuple[type["Action"], dict[str, Any]]:
        """The class, and the keyword arguments that a tag stands for. Derived classes begin with this."""
        if_text = entity.get_attr("if", optional=True, can_be_str=True)
        unless_text = entity.get_attr("unless", optional=True, can_be_str=True)
        if if_text is not None and unless_text is not None:
            raise RuntimeError("if and unless conditions can't be used simultaneously")
        arguments: dict[str, Any] = {}
        if if_text is not None:
            arguments["condition"] = IfCondition(parser.parse_substitution(if_text))
        if unless_text is not None:
            arguments["condition"] = UnlessCondition(parser.parse_substitution(unless_text))
        return cls, arguments

    @property
    def condition(self) -> Condition | None:
        return self.__condition

    def describe(self) -> str:
        return f"{type(self).__name__}({hex(id(self))})"

    def get_sub_entities(self) -> list[LaunchDescriptionEntity]:
        """The entities that `execute` always returns, as far as they are known before."""
        return []

    def describe_sub_entities(self) -> list[LaunchDescriptionEntity]:
        return self.get_sub_entities() if self.__condition is None else []

    def describe_conditional_sub_entities(
        self,
    ) -> list[tuple[str, Iterable[LaunchDescriptionEntity]]]:
        if self.__condition is None or not self.get_sub_entities():
            return []
        return [("Conditionally included by " + self.describe(), self.get_sub_entities())]

    def visit(self, context: LaunchContext) -> Sequence[LaunchDescriptionEntity] | None:
        if self.__condition is not None and not self.__condition.evaluate(context):
            return None
        try:
            return self.execute(context)
        finally:
            event = ExecutionComplete(action=self)
            if context.would_handle_event(event):
                future = self.get_asyncio_future()
                if future is None:
                    context.emit_event_sync(event)
                else:
                    future.add_done_callback(lambda _: context.emit_event_sync(event))

    def execute(self, context: LaunchContext) -> Sequence[LaunchDescriptionEntity] | None:
        """Do it. The launch visits the returned entities next."""
        return None
