"""Actions that set launch configurations and environment variables, for later actions."""

import os
from collections.abc import Callable, Mapping
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
from bus_launch.launch.utilities.type_utils import perform_typed_substitution

__all__ = [
    "AppendEnvironmentVariable",
    "PopEnvironment",
    "PopLaunchConfigurations",
    "PrependEnvironmentVariable",
    "PushEnvironment",
    "PushLaunchConfigurations",
    "ResetEnvironment",
    "ResetLaunchConfigurations",
    "SetEnvironmentVariable",
    "SetLaunchConfiguration",
    "UnsetEnvironmentVariable",
    "UnsetLaunchConfiguration",
]

_Parsed = tuple[type[Action], dict[str, Any]]


class _Named(Action):
    def __init__(self, name: SomeSubstitutionsType, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._name = normalize_to_list_of_substitutions(name)

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> _Parsed:
        _, kwargs = super().parse(entity, parser)
        kwargs["name"] = parser.parse_substitution(entity.get_attr("name"))
        return cls, kwargs

    @property
    def name(self) -> list[Substitution]:
        return self._name


class _Setting(_Named):
    def __init__(self, name: SomeSubstitutionsType, value: SomeSubstitutionsType, **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        self._value = normalize_to_list_of_substitutions(value)

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> _Parsed:
        _, kwargs = super().parse(entity, parser)
        kwargs["value"] = parser.parse_substitution(entity.get_attr("value"))
        return cls, kwargs

    @property
    def value(self) -> list[Substitution]:
        return self._value

    def _pair(self, context: LaunchContext) -> tuple[str, str]:
        return perform_substitutions(context, self._name), perform_substitutions(context, self._value)


@expose_action("let")
class SetLaunchConfiguration(_Setting):
    """Sets a launch configuration, until the end of its group."""

    def execute(self, context: LaunchContext) -> None:
        name, value = self._pair(context)
        context.launch_configurations[name] = value


@expose_action("unset_launch_configuration")
class UnsetLaunchConfiguration(_Named):
    """Removes a launch configuration; a missing one is no error."""

    def execute(self, context: LaunchContext) -> None:
        context.launch_configurations.pop(perform_substitutions(context, self._name), None)


@expose_action("set_env")
class SetEnvironmentVariable(_Setting):
    """Sets an environment variable, for the processes that are started after it."""

    def execute(self, context: LaunchContext) -> None:
        name, value = self._pair(context)
        context.environment[name] = value


@expose_action("unset_env")
class UnsetEnvironmentVariable(_Named):
    """Removes an environment variable; a missing one is no error."""

    def execute(self, context: LaunchContext) -> None:
        context.environment.pop(perform_substitutions(context, self._name), None)


@expose_action("append_env")
class AppendEnvironmentVariable(_Setting):
    """Puts a value behind, or in front of, the value of an environment variable."""

    def __init__(
        self,
        name: SomeSubstitutionsType,
        value: SomeSubstitutionsType,
        prepend: bool | SomeSubstitutionsType = False,
        separator: SomeSubstitutionsType = os.pathsep,
        **kwargs: Any,
    ) -> None:
        super().__init__(name, value, **kwargs)
        self.__prepend = prepend if isinstance(prepend, bool) else normalize_to_list_of_substitutions(prepend)
        self.__separator = normalize_to_list_of_substitutions(separator)

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> _Parsed:
        _, kwargs = super().parse(entity, parser)
        prepend = entity.get_attr("prepend", optional=True, data_type=bool)
        if prepend is not None:
            kwargs["prepend"] = parser.parse_if_substitutions(prepend)
        separator = entity.get_attr("separator", optional=True)
        if separator is not None:
            kwargs["separator"] = parser.parse_substitution(separator)
        return cls, kwargs

    @property
    def prepend(self) -> bool | list[Substitution]:
        return self.__prepend

    @property
    def separator(self) -> list[Substitution]:
        return self.__separator

    def execute(self, context: LaunchContext) -> None:
        name, value = self._pair(context)
        old = context.environment.get(name)
        parts = [value] if old is None else [old, value]
        if perform_typed_substitution(context, self.__prepend, bool):
            parts.reverse()
        context.environment[name] = perform_substitutions(context, self.__separator).join(parts)


class PrependEnvironmentVariable(AppendEnvironmentVariable):
    """Puts a text in front of an environment variable's value."""

    def __init__(
        self,
        name: SomeSubstitutionsType,
        value: SomeSubstitutionsType,
        separator: SomeSubstitutionsType = os.pathsep,
        **kwargs: Any,
    ) -> None:
        super().__init__(name, value, True, separator, **kwargs)


class _Simple(Action):
    _do: Callable[..., None]

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> _Parsed:
        return cls, super().parse(entity, parser)[1]

    def execute(self, context: LaunchContext) -> None:
        type(self)._do(context)


class PushLaunchConfigurations(_Simple):
    """Keeps the launch configurations for PopLaunchConfigurations."""

    _do = LaunchContext._push_launch_configurations


class PopLaunchConfigurations(_Simple):
    """Restores the launch configurations as they were at PushLaunchConfigurations."""

    _do = LaunchContext._pop_launch_configurations


class PushEnvironment(_Simple):
    """Keeps the environment for PopEnvironment."""

    _do = LaunchContext._push_environment


class PopEnvironment(_Simple):
    """Restores the environment as it was at PushEnvironment."""

    _do = LaunchContext._pop_environment


@expose_action("reset_env")
class ResetEnvironment(_Simple):
    """Restores the environment as it was when the launch began."""

    _do = LaunchContext._reset_environment


@expose_action("reset")
class ResetLaunchConfigurations(Action):
    """Removes all launch configurations, except the given ones."""

    def __init__(
        self,
        launch_configurations: Mapping[SomeSubstitutionsType, SomeSubstitutionsType] | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.__kept = [
            (normalize_to_list_of_substitutions(name), normalize_to_list_of_substitutions(value))
            for name, value in (launch_configurations or {}).items()
        ]

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> _Parsed:
        _, kwargs = super().parse(entity, parser)
        kwargs["launch_configurations"] = {
            tuple(parser.parse_substitution(one.get_attr("name"))): parser.parse_substitution(
                one.get_attr("value")
            )
            for one in entity.get_attr("keep", data_type=List[Entity], optional=True) or ()  # noqa: UP006
        }
        return cls, kwargs

    def execute(self, context: LaunchContext) -> None:
        kept = {
            perform_substitutions(context, name): perform_substitutions(context, value)
            for name, value in self.__kept
        }
        context.launch_configurations.clear()
        context.launch_configurations.update(kept)
