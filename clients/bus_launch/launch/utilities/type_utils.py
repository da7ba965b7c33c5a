"""Values of a type that may be substitutions; programs import it as `launch.utilities.type_utils`.

A data type is `int`, `float`, `bool`, `str`, `List[...]` of one of these, or None for any of them.
"""

from collections.abc import Iterable
from typing import Any, Final, List  # noqa: UP035 (the genuine one's `data_type`)

from bus_launch.launch.core import (
    LaunchContext,
    Substitution,
    ensure_argument_type,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)

__all__ = [
    "ScalarTypesTuple",
    "coerce_list",
    "coerce_to_type",
    "extract_type",
    "get_typed_value",
    "is_instance_of",
    "is_instance_of_valid_type",
    "is_normalized_substitution",
    "is_substitution",
    "is_typing_list",
    "is_valid_scalar_type",
    "normalize_typed_substitution",
    "perform_typed_substitution",
]

ScalarTypesTuple: Final = (int, float, bool, str)


def is_typing_list(data_type: Any) -> bool:
    """Whether it is `typing.List`, or `List[...]`."""
    return data_type is List or getattr(data_type, "__origin__", None) is list  # noqa: UP006


def is_valid_scalar_type(data_type: Any) -> bool:
    return data_type in ScalarTypesTuple


def extract_type(data_type: Any) -> tuple[Any, bool]:
    """The type of a scalar or of a list's items, and whether it is a list; raises ValueError for others."""
    arguments: tuple[Any, ...] = getattr(data_type, "__args__", ())
    is_list = is_typing_list(data_type) and len(arguments) == 1
    scalar = arguments[0] if is_list else data_type
    if not is_valid_scalar_type(scalar):
        raise ValueError(f"Unrecognized data type: {data_type}")
    return scalar, is_list


def is_instance_of_valid_type(value: Any, *, can_be_str: bool = False) -> bool:
    """Whether it is a scalar, or a list of scalars of one type; with `can_be_str`, also with texts in it."""
    if not isinstance(value, list):
        return isinstance(value, ScalarTypesTuple)
    kinds = {type(one) for one in value}
    if can_be_str:
        kinds.discard(str)
    return len(kinds) <= 1 and kinds <= set(ScalarTypesTuple)


def is_instance_of(value: Any, data_type: Any = None, *, can_be_str: bool = False) -> bool:
    """Whether it is of the type; with `can_be_str`, texts are, too. Raises ValueError for a wrong type."""
    if data_type is None:
        return is_instance_of_valid_type(value, can_be_str=can_be_str)
    kind, is_list = extract_type(data_type)
    kinds = (str, kind) if can_be_str else (kind,)
    if not is_list:
        return isinstance(value, kinds)
    return isinstance(value, list) and all(isinstance(one, kinds) for one in value)


def coerce_to_type(value: str, data_type: Any = None, *, can_be_str: bool = False) -> Any:
    """A text as a value of the type, or for None as YAML reads it; with `can_be_str`, other text stays text.

    Raises ValueError if it is none, TypeError if `value` is no text.
    """
    ensure_argument_type(value, str, "value", "coerce_to_type")
    kind, is_list = (None, False) if data_type is None else extract_type(data_type)
    if kind is str and not is_list:
        return value
    if kind in (int, float) and not is_list:
        try:
            return kind(value)
        except ValueError:
            if can_be_str:
                return value
            raise
    if kind is bool and not is_list and value in ("0", "1"):
        return value == "1"
    found = _by_yaml(value, can_be_str)
    # For a list, a text is not enough: its items may be texts.
    if is_list and not isinstance(found, list):
        raise ValueError(f"Cannot convert value '{value}' to '{data_type}'")
    if not is_instance_of(found, data_type, can_be_str=can_be_str):
        wanted = "a value" if data_type is None else f"'{data_type}'"
        raise ValueError(f"Cannot convert value '{value}' to {wanted}, got {found!r}")
    return found


def coerce_list(value: list[str], data_type: Any = None, *, can_be_str: bool = False) -> list[Any]:
    """Texts as values of a scalar's type; raises ValueError or TypeError as `coerce_to_type`."""
    ensure_argument_type(value, list, "value", "coerce_list")
    found = [coerce_to_type(one, data_type, can_be_str=can_be_str) for one in value]
    if not is_instance_of_valid_type(found, can_be_str=can_be_str):
        raise ValueError(f"Cannot convert value '{value}' to a list of values of one type")
    return found


def get_typed_value(value: str | list[str], data_type: Any, can_be_str: bool = False) -> Any:
    """A text or a list of texts as a value of the type, or for None as YAML reads it.

    Raises ValueError if it is none, TypeError for a list if the type is a scalar's.
    """
    if not isinstance(value, list):
        return coerce_to_type(value, data_type, can_be_str=can_be_str)
    kind, is_list = (None, True) if data_type is None else extract_type(data_type)
    if not is_list:
        raise TypeError(f"Cannot convert input '{value}' of type '{type(value)}' to '{data_type}'")
    return coerce_list(value, kind, can_be_str=can_be_str)


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


def is_normalized_substitution(value: object) -> bool:
    """A list of substitutions only."""
    return isinstance(value, list) and bool(value) and all(isinstance(one, Substitution) for one in value)


def normalize_typed_substitution(value: Any, data_type: Any) -> Any:
    """For `perform_typed_substitution`: a value, substitutions, or a list of both.

    Raises TypeError for a value of another type, ValueError for a wrong type.
    """
    if isinstance(value, ScalarTypesTuple):
        if not is_instance_of(value, data_type):
            raise TypeError(f"value='{value}' is not an instance of {data_type}")
        return value
    if is_substitution(value):
        return normalize_to_list_of_substitutions(value)
    if not isinstance(value, Iterable):
        raise TypeError(f"value='{value}' is no scalar, no substitution and no list of both")
    items = list(value)
    kind, is_list = (None, True) if data_type is None else extract_type(data_type)
    if not is_list:
        raise TypeError(f"value='{items}' is a list, and not an instance of {data_type}")
    kinds = {type(one) for one in items if not is_substitution(one)}
    if kinds == {int, float}:
        kinds = {float}
    if len(kinds) > 1 or not kinds <= set(ScalarTypesTuple):
        raise TypeError(f"value='{items}' must hold substitutions and scalars of one type")
    if kinds and kind not in (None, *kinds, *({float} if kinds == {int} else ())):
        raise TypeError(f"value='{items}' is a list of {kinds.pop().__name__}, not '{data_type}'")
    to_float = kind is float or kinds == {float}
    return [
        normalize_to_list_of_substitutions(one) if is_substitution(one) else float(one) if to_float else one
        for one in items
    ]


def perform_typed_substitution(context: LaunchContext, value: Any, data_type: Any) -> Any:
    """The value, its substitutions performed; raises ValueError if it is not of the type, or TypeError."""
    if isinstance(value, ScalarTypesTuple):
        if not is_instance_of(value, data_type):
            raise TypeError(f"value='{value}' is not an instance of {data_type}")
        return value
    if is_normalized_substitution(value):
        return coerce_to_type(perform_substitutions(context, value), data_type)
    if not isinstance(value, list):
        raise TypeError(f"value='{value}' is no scalar, no substitution and no list of both")
    kind, is_list = (None, True) if data_type is None else extract_type(data_type)
    if not is_list:
        raise ValueError(f"value='{value}' is a list, and not an instance of {data_type}")
    found = [
        coerce_to_type(perform_substitutions(context, one), kind) if is_normalized_substitution(one) else one
        for one in value
    ]
    if not is_instance_of(found, data_type):
        wanted = "values of one type" if data_type is None else str(data_type)
        raise ValueError(f"value='{found}' does not match {wanted}")
    return found


def _by_yaml(text: str, can_be_str: bool) -> Any:
    """The value of YAML; an empty text is itself, and text that is not YAML only if it may be a text."""
    if not text:
        return text
    import yaml  # late: most launch files need none

    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        if can_be_str:
            return text
        raise ValueError(f"'{text}' is not YAML: {str(error).partition(chr(10))[0]}") from None
