"""Values of a type that may be substitutions; programs import it as `launch.utilities.type_utils`."""

from collections.abc import Iterable
from typing import Any

from bus_launch.launch.core import (
    LaunchContext,
    Substitution,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from bus_launch.launch.frontend.entity import coerce

__all__ = [
    "get_typed_value",
    "is_substitution",
    "normalize_typed_substitution",
    "perform_typed_substitution",
]


def get_typed_value(value: Any, data_type: Any, can_be_str: bool = False) -> Any:
    """A text as a value of the type, or for None as YAML reads it. Raises ValueError if it is none."""
    return coerce(value, data_type, can_be_str)


def is_substitution(value: object) -> bool:
    """A substitution, or several and texts in turn."""
    if isinstance(value, Substitution):
        return True
    if isinstance(value, str) or not isinstance(value, Iterable):
        return False
    parts = list(value)
    return any(isinstance(one, Substitution) for one in parts) and all(
        isinstance(one, Substitution | str) for one in parts
    )


def normalize_typed_substitution(value: Any, data_type: Any) -> Any:
    """For `perform_typed_substitution`: a value, substitutions, or a list of both.

    Raises TypeError for a value of another type.
    """
    if is_substitution(value):
        return normalize_to_list_of_substitutions(value)
    if isinstance(value, list | tuple):
        return [normalize_to_list_of_substitutions(one) if is_substitution(one) else one for one in value]
    if data_type is not None and not isinstance(value, data_type):
        raise TypeError(f"value='{value}' is not an instance of {data_type}")
    return value


def perform_typed_substitution(context: LaunchContext, value: Any, data_type: Any) -> Any:
    """The value, its substitutions performed. Raises ValueError if it is not of the type."""
    if isinstance(value, list) and value and all(isinstance(one, Substitution) for one in value):
        return coerce(perform_substitutions(context, value), data_type, False)
    if isinstance(value, list):
        performed = [perform_substitutions(context, one) if isinstance(one, list) else one for one in value]
        return coerce(performed, data_type, False) if data_type is not None else performed
    return value
