"""Substitutions for the launch's own values: configurations, its files, texts put together."""

import os
import secrets
import socket
from collections.abc import Iterable, Sequence
from typing import Any

from bus_launch.launch import logging
from bus_launch.launch.core import (
    LaunchContext,
    SomeSubstitutionsType,
    Substitution,
    SubstitutionFailure,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from bus_launch.launch.frontend import expose_substitution

__all__ = [
    "AnonName",
    "LaunchConfiguration",
    "LaunchLogDir",
    "LocalSubstitution",
    "PathJoinSubstitution",
    "PathSubstitution",
    "StringJoinSubstitution",
    "ThisLaunchFile",
    "ThisLaunchFileDir",
    "arguments_of",
    "described",
]

_Parsed = tuple[type[Substitution], dict[str, Any]]


def arguments_of(name: str, data: Sequence[Any], least: int, most: int | None = None) -> Sequence[Any]:
    """The arguments of `$(name ...)`; raises TypeError if there are too few or too many."""
    most = least if most is None else most
    if not least <= len(data) <= most:
        count = f"{least}" if least == most else f"{least} to {most}"
        word = "argument" if most == 1 else "arguments"
        raise TypeError(f"{name} substitution expects {count} {word}, got {len(data)}")
    return data


def described(substitutions: Iterable[Substitution]) -> str:
    return " + ".join(one.describe() for one in substitutions)


@expose_substitution("var")
class LaunchConfiguration(Substitution):
    """The value of a launch configuration, or the default; SubstitutionFailure if there is neither."""

    def __init__(self, variable_name: SomeSubstitutionsType, *, default: Any = None) -> None:
        super().__init__()
        self.__name = normalize_to_list_of_substitutions(variable_name)
        self.__default = None if default is None else _default(default)

    @classmethod
    def parse(cls, data: Sequence[Any]) -> _Parsed:
        arguments_of("var", data, 1, 2)
        return cls, dict(zip(("variable_name", "default"), data, strict=False))

    @property
    def variable_name(self) -> list[Substitution]:
        return self.__name

    def describe(self) -> str:
        return f"LaunchConfig({described(self.__name)})"

    def perform(self, context: LaunchContext) -> str:
        name = perform_substitutions(context, self.__name)
        if name in context.launch_configurations:
            return str(context.launch_configurations[name])
        if self.__default is None:
            from bus.base.suggest import did_you_mean

            near = did_you_mean(name, context.launch_configurations)
            raise SubstitutionFailure(f"launch configuration '{name}' does not exist{near}")
        return perform_substitutions(context, self.__default)


def _default(value: Any) -> list[Substitution]:
    """The default as text if it is no substitution: `default=5`."""
    if isinstance(value, Iterable) and not isinstance(value, str):
        return normalize_to_list_of_substitutions(
            one if isinstance(one, Substitution) else str(one) for one in value
        )
    return normalize_to_list_of_substitutions(value if isinstance(value, Substitution) else str(value))


class LocalSubstitution(Substitution):
    """`context.locals.EXPRESSION`, for entities that an event handler visits: `event.returncode`."""

    def __init__(self, expression: str, description: str | None = None) -> None:
        super().__init__()
        self.__expression = expression
        self.__description = description

    @property
    def expression(self) -> str:
        return self.__expression

    def describe(self) -> str:
        return f"LocalVar('{self.__description or self.__expression}')"

    def perform(self, context: LaunchContext) -> str:
        found: Any = context.locals
        for name in self.__expression.split("."):
            found = getattr(found, name)
        return str(found)


@expose_substitution("dirname")
class ThisLaunchFileDir(Substitution):
    """The folder of the launch file that contains it."""

    @classmethod
    def parse(cls, data: Sequence[Any]) -> _Parsed:
        arguments_of("dirname", data, 0)
        return cls, {}

    def describe(self) -> str:
        return "ThisLaunchFileDir()"

    def perform(self, context: LaunchContext) -> str:
        return _of_file(context, "current_launch_file_directory", self)


@expose_substitution("filename")
class ThisLaunchFile(Substitution):
    """The path of the launch file that contains it."""

    @classmethod
    def parse(cls, data: Sequence[Any]) -> _Parsed:
        arguments_of("filename", data, 0)
        return cls, {}

    def describe(self) -> str:
        return "ThisLaunchFile()"

    def perform(self, context: LaunchContext) -> str:
        return _of_file(context, "current_launch_file_path", self)


def _of_file(context: LaunchContext, name: str, sub: Substitution) -> str:
    try:
        return str(context.get_locals_as_dict()[name])
    except KeyError:
        what = type(sub).__name__
        raise SubstitutionFailure(f"{what} used outside of a launch file (in a script)") from None


@expose_substitution("launch_log_dir")
@expose_substitution("log_dir")
class LaunchLogDir(Substitution):
    """The folder with the log files of this launch."""

    @classmethod
    def parse(cls, data: Sequence[Any]) -> _Parsed:
        arguments_of("log_dir", data, 0)
        return cls, {}

    def describe(self) -> str:
        return "LaunchLogDir()"

    def perform(self, context: LaunchContext) -> str:
        return logging.launch_config.log_dir


@expose_substitution("anon")
class AnonName(Substitution):
    """A name that no other process has; the same for the same name in one launch."""

    def __init__(self, name: SomeSubstitutionsType) -> None:
        super().__init__()
        self.__name = normalize_to_list_of_substitutions(name)

    @classmethod
    def parse(cls, data: Sequence[Any]) -> _Parsed:
        return cls, {"name": arguments_of("anon", data, 1)[0]}

    @property
    def name(self) -> list[Substitution]:
        return self.__name

    def describe(self) -> str:
        return f"AnonName({described(self.__name)})"

    def perform(self, context: LaunchContext) -> str:
        name = perform_substitutions(context, self.__name)
        known: dict[str, Any] = context.launch_configurations
        if f"anon{name}" not in known:
            host = "".join(char if char.isalnum() else "_" for char in socket.gethostname())
            known[f"anon{name}"] = f"{name}_{host}_{os.getpid()}_{secrets.randbelow(1 << 63)}"
        return str(known[f"anon{name}"])


class StringJoinSubstitution(Substitution):
    """Texts with a delimiter between them."""

    def __init__(
        self,
        substitutions: Iterable[SomeSubstitutionsType],
        *,
        delimiter: SomeSubstitutionsType = "",
    ) -> None:
        super().__init__()
        self.__parts = [normalize_to_list_of_substitutions(one) for one in substitutions]
        self.__delimiter = normalize_to_list_of_substitutions(delimiter)

    @property
    def substitutions(self) -> list[list[Substitution]]:
        return self.__parts

    @property
    def delimiter(self) -> list[Substitution]:
        return self.__delimiter

    def describe(self) -> str:
        return f"{type(self).__name__}({', '.join(described(part) for part in self.__parts)})"

    def perform(self, context: LaunchContext) -> str:
        delimiter = perform_substitutions(context, self.__delimiter)
        return delimiter.join(perform_substitutions(context, part) for part in self.__parts)


class PathJoinSubstitution(StringJoinSubstitution):
    """A path made of its parts; `path / part` makes a longer one."""

    def __init__(self, substitutions: Iterable[SomeSubstitutionsType]) -> None:
        super().__init__(substitutions, delimiter=os.sep)

    def perform(self, context: LaunchContext) -> str:
        # As in os.path.join, an absolute part drops the parts before it.
        parts = ["".join(one.perform(context) for one in part) for part in self.substitutions]
        return os.path.join(*parts)  # noqa: PTH118

    def __truediv__(self, additional_path: SomeSubstitutionsType) -> "PathJoinSubstitution":
        return PathJoinSubstitution([*self.substitutions, additional_path])


class PathSubstitution(PathJoinSubstitution):
    """A path of one part, to be made longer by `/`."""

    def __init__(self, path: SomeSubstitutionsType) -> None:
        super().__init__([path])
