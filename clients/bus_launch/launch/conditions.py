"""Conditions of actions; programs import them as `launch.conditions`."""

import warnings

from bus_launch.launch.core import (
    Condition,
    LaunchContext,
    SomeSubstitutionsType,
    Substitution,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)

__all__ = [
    "IfCondition",
    "InvalidConditionExpressionError",
    "LaunchConfigurationEquals",
    "LaunchConfigurationNotEquals",
    "UnlessCondition",
    "evaluate_condition_expression",
]

__path__: list[str] = []  # there may be modules in it: a file for each class, as in ROS 2

_TRUE = ("true", "1")
_FALSE = ("false", "0")


class InvalidConditionExpressionError(Exception):
    """A text that is neither true nor false."""


def evaluate_condition_expression(context: LaunchContext, expression: list[Substitution]) -> bool:
    """The value of the expression: true or 1, false or 0, in capitals or not."""
    text = perform_substitutions(context, expression)
    word = text.strip().lower()
    if word in _TRUE:
        return True
    if word in _FALSE:
        return False
    raise InvalidConditionExpressionError(
        f"Expression '{text}' is not one of the valid true expressions {list(_TRUE)} or false expressions "
        f"{list(_FALSE)}"
    )


class IfCondition(Condition):
    """True if the predicate is."""

    def __init__(self, predicate_expression: SomeSubstitutionsType) -> None:
        super().__init__()
        self._expression = normalize_to_list_of_substitutions(predicate_expression)

    def evaluate(self, context: LaunchContext) -> bool:
        return evaluate_condition_expression(context, self._expression)

    def describe(self) -> str:
        return f"{type(self).__name__}({' + '.join(one.describe() for one in self._expression)})"


class UnlessCondition(IfCondition):
    """True if the predicate is not."""

    def evaluate(self, context: LaunchContext) -> bool:
        return not super().evaluate(context)


class LaunchConfigurationEquals(Condition):
    """True if a launch configuration has a value; with None, if it is not set. ROS 2 has deprecated it."""

    def __init__(self, launch_configuration_name: str, expected_value: SomeSubstitutionsType | None) -> None:
        other = type(self).__name__.removeprefix("LaunchConfiguration")
        warnings.warn(
            f"{type(self).__name__} is deprecated in ROS 2: use IfCondition({other}Substitution(...))",
            stacklevel=2,
        )
        super().__init__()
        self._name = launch_configuration_name
        self._expected = (
            None if expected_value is None else normalize_to_list_of_substitutions(expected_value)
        )

    def evaluate(self, context: LaunchContext) -> bool:
        value = context.launch_configurations.get(self._name)
        if self._expected is None or value is None:
            return self._expected is None and value is None
        return bool(value == perform_substitutions(context, self._expected))


class LaunchConfigurationNotEquals(LaunchConfigurationEquals):
    """True if a launch configuration has another value."""

    def evaluate(self, context: LaunchContext) -> bool:
        return not super().evaluate(context)
