"""bus_launch.launch.utilities.type_utils: values of a type, given as texts or as substitutions."""

from typing import Any, List  # noqa: UP035 (a launch file's `data_type`)

import pytest

from bus_launch.launch.core import LaunchContext, TextSubstitution
from bus_launch.launch.substitutions import LaunchConfiguration
from bus_launch.launch.utilities.type_utils import (
    coerce_list,
    extract_type,
    get_typed_value,
    is_instance_of,
    is_instance_of_valid_type,
    is_substitution,
    is_typing_list,
    normalize_typed_substitution,
    perform_typed_substitution,
)
from rows import for_each

INTS: Any = List[int]  # noqa: UP006
FLOATS: Any = List[float]  # noqa: UP006
BOOLS: Any = List[bool]  # noqa: UP006
TEXTS: Any = List[str]  # noqa: UP006
X = LaunchConfiguration("x")


def test_types() -> None:
    assert is_typing_list(List) and is_typing_list(INTS)  # noqa: UP006
    assert not is_typing_list(list) and not is_typing_list(int)
    assert extract_type(bool) == (bool, False)
    assert extract_type(INTS) == (int, True)
    for wrong in (bytes, List, List[bytes]):  # noqa: UP006
        with pytest.raises(ValueError, match="Unrecognized data type"):
            extract_type(wrong)


@for_each(
    ("value", "data_type", "can_be_str", "is_one"),
    [
        (1, None, False, True),
        ([1, 2], None, False, True),
        ([1, "a"], None, False, False),
        ([1, "a"], None, True, True),
        ([1, 2.5, "a"], None, True, False),
        ({}, None, False, False),
        ([], None, False, True),
        (1, int, False, True),
        ("a", int, False, False),
        ("a", int, True, True),
        ([1], int, False, False),
        ([1], INTS, False, True),
        ([1, "a"], INTS, True, True),
        (1, INTS, False, False),
    ],
)
def test_instances(value: Any, data_type: Any, can_be_str: bool, is_one: bool) -> None:
    assert is_instance_of(value, data_type, can_be_str=can_be_str) is is_one
    if data_type is None:
        assert is_instance_of_valid_type(value, can_be_str=can_be_str) is is_one


@for_each(
    ("text", "data_type", "value"),
    [
        ("5", int, 5),
        ("5", float, 5.0),
        ("5", str, "5"),
        ("1", bool, True),
        ("off", bool, False),
        ("5", None, 5),
        ("a", None, "a"),
        ("", None, ""),
        ("[1, 2]", INTS, [1, 2]),
        ("[1, 2]", None, [1, 2]),
        ("[on, off]", BOOLS, [True, False]),
        (["1", "2.5"], FLOATS, [1.0, 2.5]),
        (["1", "2"], None, [1, 2]),
        (["1", "a"], TEXTS, ["1", "a"]),
    ],
)
def test_texts(text: Any, data_type: Any, value: Any) -> None:
    found = get_typed_value(text, data_type)
    assert found == value
    assert type(found) is type(value)


@for_each(
    ("text", "data_type", "kind"),
    [
        ("a", int, ValueError),
        ("2", bool, ValueError),
        ("5", INTS, ValueError),
        ("[1, a]", INTS, ValueError),
        ("{a: 1}", None, ValueError),
        ("[", None, ValueError),
        (["1"], int, TypeError),
        (["1", "a"], None, ValueError),
        (5, int, TypeError),
    ],
)
def test_texts_of_no_such_type(text: Any, data_type: Any, kind: type[Exception]) -> None:
    with pytest.raises(kind):
        get_typed_value(text, data_type)


def test_text_that_may_hold_substitutions_stays_text() -> None:
    assert get_typed_value("$(var x)", int, can_be_str=True) == "$(var x)"
    assert get_typed_value("[", None, can_be_str=True) == "["
    assert coerce_list(["1", "$(var x)"], int, can_be_str=True) == [1, "$(var x)"]
    with pytest.raises(TypeError):
        coerce_list("1", int)  # type: ignore[arg-type]


def test_substitutions() -> None:
    assert is_substitution(X)
    assert is_substitution(["a", X])
    assert not is_substitution(["a"])
    assert not is_substitution("a")


@for_each(
    ("given", "data_type", "value"),
    [
        (5, int, 5),
        (X, int, 3),
        (X, float, 3.0),
        (X, None, 3),
        (["1", X], int, 13),
        ([1, X], INTS, [1, 3]),
        ([1, 2.5, [X]], FLOATS, [1.0, 2.5, 3.0]),
        (["a", [X]], TEXTS, ["a", "3"]),
        ([[X], [X]], None, [3, 3]),
        ([1, [TextSubstitution(text="2")]], None, [1, 2]),
        ([], INTS, []),
    ],
)
def test_values_that_may_be_substitutions(given: Any, data_type: Any, value: Any) -> None:
    context = LaunchContext()
    context.launch_configurations["x"] = "3"
    normal = normalize_typed_substitution(given, data_type)
    assert perform_typed_substitution(context, normal, data_type) == value


@for_each(
    ("given", "data_type"),
    [("a", int), (object(), int), ([1, "a"], None), ([1], int), (["a"], INTS), ([{}], None), ([2.5], INTS)],
)
def test_values_of_no_such_type(given: Any, data_type: Any) -> None:
    with pytest.raises(TypeError):
        normalize_typed_substitution(given, data_type)


def test_substitutions_of_no_such_type() -> None:
    context = LaunchContext()
    context.launch_configurations["x"] = "a"
    with pytest.raises(ValueError, match="invalid literal for int"):
        perform_typed_substitution(context, [X], int)
    with pytest.raises(ValueError, match="does not match values of one type"):
        perform_typed_substitution(context, [1, [X]], None)
    with pytest.raises(ValueError, match="is a list, and not an instance of"):
        perform_typed_substitution(context, [1], int)
    for wrong, data_type in ((1, str), (object(), None)):
        with pytest.raises(TypeError):
            perform_typed_substitution(context, wrong, data_type)
