"""bus_launch.launch.conditions: texts for true and false, and the actions that are executed."""

import pytest

from bus_launch.launch.conditions import (
    IfCondition,
    InvalidConditionExpressionError,
    LaunchConfigurationEquals,
    LaunchConfigurationNotEquals,
    UnlessCondition,
)
from bus_launch.launch.core import LaunchContext
from rows import for_each


@for_each(
    ("text", "expected"),
    [("true", True), ("1", True), (" True ", True), ("false", False), ("0", False), ("FALSE", False)],
)
def test_what_is_true(text: str, expected: bool) -> None:
    assert IfCondition(text).evaluate(LaunchContext()) is expected
    assert UnlessCondition(text).evaluate(LaunchContext()) is not expected


@pytest.mark.parametrize("text", ["", "yes", "2", "none"])
def test_what_is_neither(text: str) -> None:
    with pytest.raises(InvalidConditionExpressionError):
        IfCondition(text).evaluate(LaunchContext())


@for_each(
    ("value", "expected", "is_equal"),
    [("a", "a", True), ("a", "b", False), (None, "a", False), (None, None, True), ("a", None, False)],
)
def test_the_value_of_a_configuration(value: str | None, expected: str | None, is_equal: bool) -> None:
    context = LaunchContext()
    if value is not None:
        context.launch_configurations["x"] = value
    with pytest.warns(UserWarning, match=r"use IfCondition\(EqualsSubstitution"):
        assert LaunchConfigurationEquals("x", expected).evaluate(context) is is_equal
    with pytest.warns(UserWarning, match=r"use IfCondition\(NotEqualsSubstitution"):
        assert LaunchConfigurationNotEquals("x", expected).evaluate(context) is not is_equal
