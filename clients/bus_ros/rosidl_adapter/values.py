"""Values in definitions, of constants and of fields by default: their texts become Python values."""

import re
from collections.abc import Callable
from typing import Any, Final, NoReturn

from bus_ros.rosidl_adapter.types import BaseType, Type

__all__ = [
    "InvalidValue",
    "find_matching_end_quote",
    "parse_primitive_value_string",
    "parse_string_array_value_string",
    "parse_value_string",
]

_TRUTHS: Final = {"true": True, "1": True, "false": False, "0": False}
_TEXTS: Final = ("string", "wstring")
_QUOTES: Final = "\"'"


class InvalidValue(Exception):
    """A text is not a value of a type."""

    def __init__(self, type_: object, value_string: str, message_suffix: str | None = None) -> None:
        suffix = "" if message_suffix is None else f": {message_suffix}"
        super().__init__(f"value '{value_string}' can not be converted to type '{type_}'{suffix}")


def parse_value_string(type_: Type, value_string: str) -> Any:
    """The value of a field by default: a primitive, or a list of primitives. Raises InvalidValue."""
    if not type_.is_primitive_type():
        raise NotImplementedError(f"parsing string values into type '{type_}' is not supported")
    if not type_.is_array:
        return parse_primitive_value_string(type_, value_string)
    if not (value_string.startswith("[") and value_string.endswith("]")):
        raise InvalidValue(type_, value_string, "array value must start with '[' and end with ']'")
    inside = value_string[1:-1]
    if type_.type in _TEXTS:
        texts = parse_string_array_value_string(inside, type_.array_size)
    else:
        texts = inside.split(",") if inside else []
    _check_length(type_, value_string, len(texts))
    element = Type(BaseType.__str__(type_))
    values = []
    for index, text in enumerate(texts):
        try:
            values.append(parse_primitive_value_string(element, text.strip()))
        except InvalidValue as error:
            raise InvalidValue(type_, value_string, f"element {index} with {error}") from None
    return values


def parse_string_array_value_string(element_string: str, expected_size: int | None) -> list[str]:
    """The texts between the brackets of an array of texts. In quotes, a comma does not separate.

    Raises ValueError for a missing text or a missing quote.
    """
    found: list[str] = []
    rest = element_string.lstrip(" ")
    while rest:
        if rest[0] == ",":
            raise ValueError(f"unexpected ',' at beginning of [{rest}]")
        if rest[0] in _QUOTES:
            end = find_matching_end_quote(rest, rest[0])
            if end == -1:
                raise ValueError(f"string [{rest}] incorrectly quoted\n{found}")
            found.append(rest[1 : end + 1].replace(f"\\{rest[0]}", rest[0]))
            rest = rest[end + 2 :]
        else:
            text, comma, after = rest.partition(",")
            found.append(text)
            rest = comma + after
        rest = rest.lstrip(" ").removeprefix(",").lstrip(" ")
    return found


def find_matching_end_quote(string: str, quote: str) -> int:
    """The length of the text in quotes at the beginning of `string`; -1 if its end is missing."""
    closing = re.compile(rf"(?<!\\){re.escape(quote)}").search(string, 1)
    return -1 if closing is None else closing.start() - 1


def parse_primitive_value_string(type_: Type, value_string: str) -> Any:
    """The value of a constant, or of one element. Raises InvalidValue."""
    if not type_.is_primitive_type() or type_.is_array:
        raise ValueError("the passed type must be a non-array primitive type")
    if type_.type in _TEXTS:
        return _text(type_, value_string)
    if type_.type == "bool":
        return _truth(value_string)
    if type_.type in ("float32", "float64"):
        return _number(type_.type, value_string)
    found = re.fullmatch(r"(u?)int(\d+)", type_.type)
    if found is not None:
        return _whole(type_.type, value_string, unsigned=bool(found[1]), bits=int(found[2]))
    if type_.type in ("byte", "char"):
        return _whole(type_.type, value_string, unsigned=True, bits=8)
    raise AssertionError(f"unknown primitive type '{type_.type}'")


def _check_length(type_: Type, value_string: str, length: int) -> None:
    if not type_.array_size:
        return
    if type_.is_upper_bound and length > type_.array_size:
        fault = f"array must have not more than {type_.array_size} elements, not {length}"
    elif not type_.is_upper_bound and length != type_.array_size:
        fault = f"array must have exactly {type_.array_size} elements, not {length}"
    else:
        return
    raise InvalidValue(type_, value_string, fault)


def _truth(text: str) -> bool:
    if (found := _TRUTHS.get(text.lower())) is None:
        raise InvalidValue("bool", text, "must be either 'true' / '1' or 'false' / '0'")
    return found


def _number(kind: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        fault = "must be a floating point number using '.' as the separator"
        raise InvalidValue(kind, text, fault) from None


def _whole(kind: str, text: str, *, unsigned: bool, bits: int) -> int:
    lowest = 0 if unsigned else -(2 ** (bits - 1))
    highest = 2 ** (bits if unsigned else bits - 1) - 1

    def refuse() -> NoReturn:
        fault = f"must be a valid integer value >= {lowest} and <= {highest}"
        raise InvalidValue(kind, text, fault) from None

    value = _converted(text, int, lambda one: int(one, 0))
    if value is None or not lowest <= value <= highest:
        refuse()
    return value


def _converted(text: str, *ways: Callable[[str], int]) -> int | None:
    for way in ways:
        try:
            return way(text)
        except ValueError:
            pass
    return None


def _text(type_: Type, text: str) -> str:
    value = text
    quote = text[:1]
    if quote and quote in _QUOTES and text.endswith(quote):
        value = text[1:-1]
        if re.search(rf"(?<!\\){quote}", value):
            raise InvalidValue(type_.type, value, "string inner quotes not properly escaped")
        value = value.replace(f"\\{quote}", quote)
    if type_.string_upper_bound and len(value) > type_.string_upper_bound:
        fault = f"string must not exceed the maximum length of {type_.string_upper_bound} characters"
        raise InvalidValue(Type(BaseType.__str__(type_)), value, fault)
    return value
