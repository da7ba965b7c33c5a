"""Arguments of a launch file; programs import the class from `launch.actions`."""

from collections.abc import Sequence
from typing import Any, List  # noqa: UP035 (the genuine one's `data_type`)

from bus_launch.launch.action import Action
from bus_launch.launch.core import (
    LaunchContext,
    SomeSubstitutionsType,
    Substitution,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from bus_launch.launch.frontend import Entity, Parser, expose_action

__all__ = ["DeclareLaunchArgument"]


@expose_action("arg")
class DeclareLaunchArgument(Action):
    """Declares an argument; its value is the launch configuration of the same name."""

    def __init__(
        self,
        name: str,
        *,
        default_value: SomeSubstitutionsType | None = None,
        description: str | None = None,
        choices: Sequence[str] | None = None,
        **kwargs: Any,
    ) -> None:
        """Raises RuntimeError if there are no choices to choose from, or the default is none of them."""
        super().__init__(**kwargs)
        self.__name = name
        self.__default = None if default_value is None else normalize_to_list_of_substitutions(default_value)
        self.__choices = None if choices is None else list(choices)
        if self.__choices is not None:
            if not self.__choices:
                raise RuntimeError("Provided choices arg is empty. Use None to ignore the choice list.")
            if isinstance(default_value, str) and default_value not in self.__choices:
                raise RuntimeError(
                    f'Provided default_value "{default_value}" is not in provided choices "{self.__choices}".'
                )
        self.__description = _described(description, self.__choices)
        self._conditionally_included = False

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> tuple[type[Action], dict[str, Any]]:
        _, kwargs = super().parse(entity, parser)
        kwargs["name"] = parser.escape_characters(entity.get_attr("name"))
        default = entity.get_attr("default", optional=True)
        if default is not None:
            kwargs["default_value"] = parser.parse_substitution(default)
        description = entity.get_attr("description", optional=True)
        if description is not None:
            kwargs["description"] = parser.escape_characters(description)
        choices = entity.get_attr("choice", data_type=List[Entity], optional=True)  # noqa: UP006
        if choices is not None:
            kwargs["choices"] = [parser.escape_characters(one.get_attr("value")) for one in choices]
            for one in choices:
                one.assert_entity_completely_parsed()
        return cls, kwargs

    @property
    def name(self) -> str:
        return self.__name

    @property
    def default_value(self) -> list[Substitution] | None:
        return self.__default

    @property
    def description(self) -> str:
        return self.__description

    @property
    def choices(self) -> list[str] | None:
        return self.__choices

    def execute(self, context: LaunchContext) -> None:
        if self.__name not in context.launch_configurations:
            if self.__default is None:
                raise RuntimeError(
                    f'Required launch argument "{self.__name}" (description: "{self.__description}") was '
                    "not provided"
                )
            context.launch_configurations[self.__name] = perform_substitutions(context, self.__default)
        value = context.launch_configurations[self.__name]
        if self.__choices is not None and value not in self.__choices:
            raise RuntimeError(
                f'Argument "{self.__name}" provided value "{value}" is not valid. Valid options are: '
                f"{self.__choices}"
            )


def _described(description: str | None, choices: list[str] | None) -> str:
    if choices is None:
        return "no description given" if description is None else description
    if description is None:
        return f"One of: {choices}"
    return f"{description}{'' if description.endswith('.') else '.'} Valid choices are: {choices}"
