"""Texts of constants and default values."""

from typing import Any

import pytest

from bus_ros.rosidl_adapter.types import Type
from bus_ros.rosidl_adapter.values import (
    InvalidValue,
    find_matching_end_quote,
    parse_primitive_value_string,
    parse_value_string,
)
from rows import for_each


@for_each(
    ("type_", "text", "value"),
    [
        ("bool", "TRUE", True),
        ("bool", "0", False),
        ("int8", "-128", -128),
        ("uint8", "0x1F", 31),
        ("byte", "255", 255),
        ("char", "0b11", 3),
        ("float32", "1.5e3", 1500.0),
        ("string", "as it is", "as it is"),
        ("string", "' with spaces '", " with spaces "),
        ("string", r"'it\'s'", "it's"),
        ("string", '"it\'s"', "it's"),
        ("string<=3", "'abc'", "abc"),
        ("bool[]", "[true, 0]", [True, False]),
        ("int8[2]", "[1, 2]", [1, 2]),
        ("float64[]", "[]", []),
        ("string[]", '[ a , \'b,c\', "d\\"e"]', ["a", "b,c", 'd"e']),
    ],
)
def test_values(type_: str, text: str, value: Any) -> None:
    assert parse_value_string(Type(type_), text) == value


@for_each(
    ("type_", "text", "fault"),
    [
        ("bool", "maybe", "must be either 'true' / '1' or 'false' / '0'"),
        ("int8", "128", "must be a valid integer value >= -128 and <= 127"),
        ("uint64", "-1", "must be a valid integer value >= 0 and <= 18446744073709551615"),
        ("int8", "x", "must be a valid integer value"),
        ("float32", "1,5", "must be a floating point number using '.' as the separator"),
        ("string", "'it's'", "string inner quotes not properly escaped"),
        ("string<=3", "abcd", "string must not exceed the maximum length of 3 characters"),
        ("int8[2]", "[1]", "array must have exactly 2 elements, not 1"),
        ("int8[<=2]", "[1, 2, 3]", "array must have not more than 2 elements, not 3"),
        ("int8[]", "1, 2", "array value must start with '[' and end with ']'"),
        ("int8[]", "[1, x]", "element 1 with value 'x' can not be converted to type 'int8'"),
    ],
)
def test_wrong_values(type_: str, text: str, fault: str) -> None:
    with pytest.raises(InvalidValue) as caught:
        parse_value_string(Type(type_), text)
    assert str(caught.value).startswith("value '") and fault in str(caught.value)


@for_each("text", ["[,a]", "['a]", '[a, "b]'])
def test_malformed_arrays_of_texts(text: str) -> None:
    with pytest.raises(ValueError):
        parse_value_string(Type("string[]"), text)


def test_only_primitives_have_values() -> None:
    with pytest.raises(ValueError, match="the passed type must be a non-array primitive type"):
        parse_primitive_value_string(Type("int8[]"), "1")
    with pytest.raises(AssertionError, match="unknown primitive type 'time'"):
        parse_primitive_value_string(Type("time"), "1")


def test_the_end_of_a_quoted_text() -> None:
    assert find_matching_end_quote("'ab' c", "'") == 2
    assert find_matching_end_quote(r"'a\'b'", "'") == 4
    assert find_matching_end_quote("'ab", "'") == -1
