"""Actions that hold others: groups and included launch files."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, List  # noqa: UP035 (the genuine one's `data_type`)

from bus_launch.launch.action import Action
from bus_launch.launch.actions.basic import OpaqueFunction
from bus_launch.launch.actions.settings import (
    PopEnvironment,
    PopLaunchConfigurations,
    PushEnvironment,
    PushLaunchConfigurations,
    ResetEnvironment,
    ResetLaunchConfigurations,
    SetLaunchConfiguration,
)
from bus_launch.launch.core import (
    LaunchContext,
    LaunchDescriptionEntity,
    SomeSubstitutionsType,
    TextSubstitution,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from bus_launch.launch.frontend import Entity, Parser, expose_action
from bus_launch.launch.launch_description_sources import (
    AnyLaunchDescriptionSource,
    LaunchDescriptionSource,
)

__all__ = ["GroupAction", "IncludeLaunchDescription"]

_Parsed = tuple[type[Action], dict[str, Any]]
_FILE = ("current_launch_file_path", "current_launch_file_directory")


@expose_action("group")
class GroupAction(Action):
    """Visits actions; their settings end with the group, unless `scoped` is False.

    `forwarding` False: the actions see no launch configurations from outside. `launch_configurations` are set
    for the actions.
    """

    def __init__(
        self,
        actions: Iterable[LaunchDescriptionEntity],
        *,
        scoped: bool = True,
        forwarding: bool = True,
        launch_configurations: Mapping[Any, SomeSubstitutionsType] | None = None,
        **left_over_kwargs: Any,
    ) -> None:
        super().__init__(**left_over_kwargs)
        self.__actions = list(actions)
        self.__scoped = scoped
        self.__forwarding = forwarding
        self.__configurations = dict(launch_configurations or {})

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> _Parsed:
        _, kwargs = super().parse(entity, parser)
        for name in ("scoped", "forwarding"):
            value = entity.get_attr(name, data_type=bool, optional=True, can_be_str=False)
            if value is not None:
                kwargs[name] = value
        kept = entity.get_attr("keep", data_type=List[Entity], optional=True)  # noqa: UP006
        if kept is not None:
            kwargs["launch_configurations"] = {
                tuple(parser.parse_substitution(one.get_attr("name"))): parser.parse_substitution(
                    one.get_attr("value")
                )
                for one in kept
            }
        kwargs["actions"] = [parser.parse_action(one) for one in entity.children if one.type_name != "keep"]
        return cls, kwargs

    def get_sub_entities(self) -> list[LaunchDescriptionEntity]:
        setters = [SetLaunchConfiguration(name, value) for name, value in self.__configurations.items()]
        if not self.__scoped:
            return [*setters, *self.__actions]
        before: list[LaunchDescriptionEntity] = [PushLaunchConfigurations(), PushEnvironment()]
        if self.__forwarding:
            before += setters
        else:
            before += [ResetEnvironment(), ResetLaunchConfigurations(self.__configurations)]
        return [*before, *self.__actions, PopEnvironment(), PopLaunchConfigurations()]

    def execute(self, context: LaunchContext) -> Sequence[LaunchDescriptionEntity]:
        return self.get_sub_entities()


@expose_action("include")
class IncludeLaunchDescription(Action):
    """Visits what another launch file makes, with arguments for it."""

    def __init__(
        self,
        launch_description_source: LaunchDescriptionSource | SomeSubstitutionsType,
        *,
        launch_arguments: Iterable[tuple[SomeSubstitutionsType, SomeSubstitutionsType]] | None = None,
        **kwargs: Any,
    ) -> None:
        """`launch_arguments`: pairs of name and value, as `{...}.items()` gives them."""
        super().__init__(**kwargs)
        if not isinstance(launch_description_source, LaunchDescriptionSource):
            launch_description_source = AnyLaunchDescriptionSource(launch_description_source)
        self.__source = launch_description_source
        if isinstance(launch_arguments, Mapping):
            launch_arguments = launch_arguments.items()
        self.__arguments = [_pair(one) for one in launch_arguments or ()]

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> _Parsed:
        _, kwargs = super().parse(entity, parser)
        kwargs["launch_description_source"] = parser.parse_substitution(entity.get_attr("file"))
        pairs = []
        for tag in ("arg", "let"):
            for one in entity.get_attr(tag, data_type=List[Entity], optional=True) or ():  # noqa: UP006
                pairs.append(
                    (
                        parser.parse_substitution(one.get_attr("name")),
                        parser.parse_substitution(one.get_attr("value")),
                    )
                )
                one.assert_entity_completely_parsed()
        kwargs["launch_arguments"] = pairs
        return cls, kwargs

    @property
    def launch_description_source(self) -> LaunchDescriptionSource:
        return self.__source

    @property
    def launch_arguments(self) -> list[tuple[SomeSubstitutionsType, SomeSubstitutionsType]]:
        return self.__arguments

    @property
    def given_names(self) -> list[str]:
        """The names of the arguments that are given, as far as they are known before the launch."""
        return [
            "".join(one.text for one in subs if isinstance(one, TextSubstitution))
            for subs in (normalize_to_list_of_substitutions(name) for name, _ in self.__arguments)
        ]

    def describe(self) -> str:
        return f"IncludeLaunchDescription({self.__source.location})"

    def execute(self, context: LaunchContext) -> Sequence[LaunchDescriptionEntity]:
        description = self.__source.get_launch_description(context)
        path = Path(self.__source.location).absolute()
        before = {name: value for name, value in context.get_locals_as_dict().items() if name in _FILE}
        context.extend_locals(dict(zip(_FILE, (str(path), str(path.parent)), strict=True)))
        given = self.__set_arguments(context)
        for argument in description.get_launch_arguments():
            if argument._conditionally_included or argument.default_value is not None:
                continue
            if argument.name not in context.launch_configurations:
                raise RuntimeError(
                    f"Included launch description missing required argument '{argument.name}' "
                    f"(description: '{argument.description}'), given: [{', '.join(given)}]"
                )
        return [description, OpaqueFunction(function=_leave_file, args=[before])]

    def __set_arguments(self, context: LaunchContext) -> list[str]:
        """Returns their names. Each is set at once, because a later one may use it."""
        names = []
        for name_subs, value_subs in self.__arguments:
            name = perform_substitutions(context, normalize_to_list_of_substitutions(name_subs))
            value = perform_substitutions(context, normalize_to_list_of_substitutions(value_subs))
            context.launch_configurations[name] = value
            names.append(name)
        return names


def _pair(one: object) -> tuple[SomeSubstitutionsType, SomeSubstitutionsType]:
    if isinstance(one, tuple | list) and len(one) == 2:
        return one[0], one[1]
    raise TypeError(f"launch_arguments are pairs of name and value, not {one!r}: of a dict give its items()")


def _leave_file(context: LaunchContext, before: Mapping[str, Any]) -> None:
    context._remove_locals(_FILE)
    context.extend_locals(before)
