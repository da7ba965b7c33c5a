"""Parameters of a node, as launch files write them: made of dicts, values and substitutions.

Pure: `normalized` checks the written form, `evaluated` makes values of it in a launch.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from bus_launch.launch.core import (
    LaunchContext,
    SomeSubstitutionsType,
    Substitution,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from bus_launch.launch.frontend.entity import coerce
from bus_launch.launch.yaml_values import load

__all__ = ["ParameterValue", "Parameters", "evaluated", "normalized"]

Parameters = list[tuple[list[Substitution], Any]]
"""Names, and values: scalars, lists of one type, ParameterValue."""

_SCALARS: Final = (bool, int, float, str, bytes)


class ParameterValue:
    """A value that is made in the launch: as `value_type` says, else as YAML reads the text."""

    def __init__(self, value: Any, *, value_type: Any = None) -> None:
        self.__value = value
        self.__type = value_type

    @property
    def value(self) -> Any:
        return self.__value

    @property
    def value_type(self) -> Any:
        return self.__type

    def evaluate(self, context: LaunchContext) -> Any:
        """Raises TypeError if the value is no parameter value, or not of the type."""
        value = self.__value
        if _has_substitution(value):
            value = perform_substitutions(context, normalize_to_list_of_substitutions(value))
            if self.__type is None:
                return _checked(load(value))
        elif isinstance(value, Sequence) and not isinstance(value, str | bytes):
            value = [_item(context, one) for one in value]
        if self.__type is None:
            return _checked(value)
        try:
            return coerce(value, self.__type, can_be_str=False)
        except ValueError as error:
            raise TypeError(
                f"the value of a parameter can't be of type {_name(self.__type)}: {error}"
            ) from None


def normalized(parameters: Mapping[Any, Any]) -> Parameters:
    """A dict with dicts in it as a list of dotted names; raises TypeError if a value can't be a parameter."""
    if not isinstance(parameters, Mapping):
        raise TypeError("expected dict")
    return list(_flat(parameters, []))


def evaluated(context: LaunchContext, parameters: Parameters) -> dict[str, Any]:
    """Names and values; raises TypeError that names the parameter."""
    found: dict[str, Any] = {}
    for subs, value in parameters:
        name = perform_substitutions(context, subs)
        try:
            found[name] = value.evaluate(context)
        except TypeError as error:
            raise TypeError(f"parameter '{name}': {error}") from None
    return found


def _flat(
    parameters: Mapping[Any, Any], before: list[Substitution]
) -> Iterable[tuple[list[Substitution], ParameterValue]]:
    for key, value in parameters.items():
        name = [*before, *normalize_to_list_of_substitutions(key)]
        if isinstance(value, Mapping):
            yield from _flat(value, [*name, *normalize_to_list_of_substitutions(".")])
        elif isinstance(value, ParameterValue):
            yield name, value
        elif isinstance(value, Path):
            yield name, ParameterValue(str(value))
        elif isinstance(value, (*_SCALARS, Substitution)) or _is_list(value):
            yield name, ParameterValue(value)
        elif hasattr(value, "tolist"):  # NumPy's
            yield name, ParameterValue(value.tolist())
        else:
            shown = "".join(getattr(one, "text", "$(...)") for one in name)
            raise TypeError(f"Unexpected type for parameter value {value!r} of parameter '{shown}'")


def _is_list(value: object) -> bool:
    """Whether it is a list, and none of its items is a list of values."""
    return isinstance(value, Sequence) and all(
        isinstance(part, str | Substitution)
        for one in value
        if isinstance(one, Sequence) and not isinstance(one, str | bytes)
        for part in one
    )


def _has_substitution(value: object) -> bool:
    """A substitution, or a list of some and of texts, which are one text together."""
    if isinstance(value, Substitution):
        return True
    if isinstance(value, str | bytes) or not isinstance(value, Sequence):
        return False
    kinds = [isinstance(one, Substitution) for one in value]
    return any(kinds) and all(
        is_one or isinstance(one, str) for is_one, one in zip(kinds, value, strict=True)
    )


def _item(context: LaunchContext, value: object) -> Any:
    """The value of a list item, which may be a list of substitutions."""
    if isinstance(value, Substitution) or (
        isinstance(value, Sequence) and not isinstance(value, str | bytes)
    ):
        some: SomeSubstitutionsType = value
        return load(perform_substitutions(context, normalize_to_list_of_substitutions(some)))
    return value


def _checked(value: Any) -> Any:
    if isinstance(value, _SCALARS):
        return value
    if value is None:
        return ""  # an empty text, as YAML reads it
    if not isinstance(value, list | tuple):
        raise TypeError(
            "Allowed value types are bytes, bool, int, float, str, Sequence[bool], Sequence[int], "
            f"Sequence[float], Sequence[str]. Got {type(value)}. If the parameter is meant to be a string, "
            "try wrapping it in launch_ros.parameter_descriptions.ParameterValue(value, value_type=str)"
        )
    kinds = {type(one) for one in value}
    if kinds == {int, float}:
        return [float(one) for one in value]
    if len(kinds) != 1 or not kinds <= {bool, int, float, str}:
        if kinds and kinds <= {bool, int, float, str}:
            return [str(one) for one in value]
        raise TypeError(
            "Expected a non-empty sequence, with items of uniform type. Allowed sequence item types are "
            "bool, int, float, str."
        )
    return list(value)


def _name(kind: Any) -> str:
    return kind.__name__ if isinstance(kind, type) else str(kind)
