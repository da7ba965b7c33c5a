"""Parameters of nodes in launch descriptions; programs import it as `launch_ros.parameter_descriptions`."""

from pathlib import Path
from typing import Any

from bus_launch.launch.core import (
    LaunchContext,
    SomeSubstitutionsType,
    Substitution,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from bus_launch.launch_ros.parameter_values import ParameterValue

__all__ = ["Parameter", "ParameterFile", "ParameterValue"]


class ParameterFile:
    """A YAML file of parameters; with `allow_substs` its text may hold `$(...)`."""

    def __init__(
        self,
        param_file: SomeSubstitutionsType,
        *,
        allow_substs: bool | SomeSubstitutionsType = False,
    ) -> None:
        self.__file = normalize_to_list_of_substitutions(param_file)
        self.__allow = allow_substs

    @property
    def param_file(self) -> list[Substitution]:
        return self.__file

    @property
    def allow_substs(self) -> bool | SomeSubstitutionsType:
        return self.__allow

    def may_have_substitutions(self, context: LaunchContext) -> bool:
        if isinstance(self.__allow, bool):
            return self.__allow
        text = perform_substitutions(context, normalize_to_list_of_substitutions(self.__allow))
        return text.strip().lower() in ("true", "1")

    def evaluate(self, context: LaunchContext) -> Path:
        """The path of the original file."""
        return Path(perform_substitutions(context, self.__file))


class Parameter:
    """A parameter with its value."""

    def __init__(
        self,
        name: SomeSubstitutionsType,
        value: Any,
        *,
        value_type: Any = None,
        description: SomeSubstitutionsType = "",
    ) -> None:
        self.__name = normalize_to_list_of_substitutions(name)
        self.__description = normalize_to_list_of_substitutions(description)
        self.__value = (
            value if isinstance(value, ParameterValue) else ParameterValue(value, value_type=value_type)
        )

    @property
    def name(self) -> list[Substitution]:
        return self.__name

    @property
    def value(self) -> Any:
        return self.__value.value

    @property
    def value_type(self) -> Any:
        return self.__value.value_type

    @property
    def description(self) -> list[Substitution]:
        return self.__description

    @property
    def typed_value(self) -> ParameterValue:
        """The value, converted to its type."""
        return self.__value

    def evaluate(self, context: LaunchContext) -> tuple[str, Any]:
        return perform_substitutions(context, self.__name), self.__value.evaluate(context)
