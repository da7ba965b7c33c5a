"""Parameters as launch files write them: names, types, and invalid values."""

from pathlib import Path
from typing import Any

import pytest

from bus_launch.launch.core import LaunchContext
from bus_launch.launch.substitutions import LaunchConfiguration, TextSubstitution
from bus_launch.launch_ros.parameter_values import ParameterValue, evaluated, normalized
from rows import for_each

N = LaunchConfiguration("n")


def values(parameters: Any) -> dict[str, Any]:
    context = LaunchContext()
    context.launch_configurations["n"] = "5"
    return evaluated(context, normalized(parameters))


@for_each(
    ("written", "value"),
    [
        ("5", "5"),
        (5, 5),
        (True, True),
        (1.5, 1.5),
        (Path("/a"), "/a"),
        (N, 5),
        ([N, "0"], 50),
        ([[N], ["a"]], ["5", "a"]),
        (TextSubstitution(text="[1, 2]"), [1, 2]),
        (TextSubstitution(text="a:b"), "a:b"),
        (TextSubstitution(text=""), ""),
        ([1, 2], [1, 2]),
        ([1, 2.5], [1.0, 2.5]),
        (("a", "b"), ["a", "b"]),
        ([True, False], [True, False]),
        (ParameterValue(N, value_type=str), "5"),
        (ParameterValue(N, value_type=float), 5.0),
        (ParameterValue("[1, 2]", value_type=list[float]), [1.0, 2.0]),
        (ParameterValue("yes: no", value_type=str), "yes: no"),
    ],
)
def test_values(written: Any, value: Any) -> None:
    found = values({"a": written})["a"]
    assert found == value
    assert type(found) is type(value)


def test_names() -> None:
    assert values({"a": {"b": {"c": 1}, ("d", N): 2}, N: 3}) == {"a.b.c": 1, "a.d5": 2, "5": 3}


@for_each(
    ("written", "text"),
    [
        (
            TextSubstitution(text="{a: 1}"),
            "parameter 'a': Allowed value types are bytes, bool, int, float, str",
        ),
        ([], "Expected a non-empty sequence, with items of uniform type"),
        ([None], "Expected a non-empty sequence"),
        (object(), "Unexpected type for parameter value <object"),
        ([1, [2, 3]], "Unexpected type for parameter value [1, [2, 3]] of parameter"),
        (ParameterValue(N, value_type=bool), "can't be of type bool: '5' is no bool"),
    ],
)
def test_what_is_no_value(written: Any, text: str) -> None:
    with pytest.raises(TypeError) as caught:
        values({"a": written})
    assert text in str(caught.value)
