"""Substitutions that are `true` or `false`, and a choice by such a value."""

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from bus_launch.launch.conditions import (
    InvalidConditionExpressionError,
    evaluate_condition_expression,
)
from bus_launch.launch.core import (
    LaunchContext,
    SomeSubstitutionsType,
    Substitution,
    SubstitutionFailure,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from bus_launch.launch.frontend import expose_substitution
from bus_launch.launch.substitutions.values import arguments_of, described
from bus_launch.launch.utilities.type_utils import coerce_to_type

__all__ = [
    "AllSubstitution",
    "AndSubstitution",
    "AnySubstitution",
    "EqualsSubstitution",
    "IfElseSubstitution",
    "NotEqualsSubstitution",
    "NotSubstitution",
    "OrSubstitution",
]

_Parsed = tuple[type[Substitution], dict[str, Any]]


class _OfSeveral(Substitution):
    def __init__(self, *parts: SomeSubstitutionsType) -> None:
        super().__init__()
        self._parts = [normalize_to_list_of_substitutions(part) for part in parts]

    def describe(self) -> str:
        return f"{type(self).__name__}({', '.join(described(part) for part in self._parts)})"

    def _values(self, context: LaunchContext) -> list[bool]:
        return [_is_true(context, part) for part in self._parts]


def _is_true(context: LaunchContext, part: list[Substitution]) -> bool:
    try:
        return evaluate_condition_expression(context, part)
    except InvalidConditionExpressionError as error:
        with suppress(ValueError):  # YAML's words, such as `yes` and `off`
            return bool(coerce_to_type(perform_substitutions(context, part), bool))
        raise SubstitutionFailure(str(error)) from None


def _text(value: bool) -> str:
    return "true" if value else "false"


@expose_substitution("not")
class NotSubstitution(_OfSeveral):
    """`true` if the value is false."""

    def __init__(self, value: SomeSubstitutionsType) -> None:
        super().__init__(value)

    @property
    def value(self) -> list[Substitution]:
        return self._parts[0]

    @classmethod
    def parse(cls, data: Sequence[Any]) -> _Parsed:
        return cls, {"value": arguments_of("not", data, 1)[0]}

    def perform(self, context: LaunchContext) -> str:
        return _text(not self._values(context)[0])


@expose_substitution("and")
class AndSubstitution(_OfSeveral):
    """`true` if both are."""

    def __init__(self, left: SomeSubstitutionsType, right: SomeSubstitutionsType) -> None:
        super().__init__(left, right)

    @property
    def left(self) -> list[Substitution]:
        return self._parts[0]

    @property
    def right(self) -> list[Substitution]:
        return self._parts[1]

    @classmethod
    def parse(cls, data: Sequence[Any]) -> _Parsed:
        left, right = arguments_of("and", data, 2)
        return cls, {"left": left, "right": right}

    def perform(self, context: LaunchContext) -> str:
        return _text(all(self._values(context)))


@expose_substitution("or")
class OrSubstitution(AndSubstitution):
    """`true` if one of the two is."""

    def perform(self, context: LaunchContext) -> str:
        return _text(any(self._values(context)))


@expose_substitution("any")
class AnySubstitution(_OfSeveral):
    """`true` if one of them is."""

    @classmethod
    def parse(cls, data: Sequence[Any]) -> tuple[Any, dict[str, Any]]:
        return (lambda: cls(*data)), {}

    def perform(self, context: LaunchContext) -> str:
        return _text(any(self._values(context)))


@expose_substitution("all")
class AllSubstitution(AnySubstitution):
    """`true` if all are."""

    def perform(self, context: LaunchContext) -> str:
        return _text(all(self._values(context)))


def _operand(value: Any) -> SomeSubstitutionsType:
    if isinstance(value, bool):
        return _text(value)
    if value is None:
        return ""
    return str(value) if isinstance(value, int | float) else value


@expose_substitution("equals")
class EqualsSubstitution(_OfSeveral):
    """`true` if both are the same: as numbers, truth values or texts."""

    def __init__(self, left: Any, right: Any) -> None:
        super().__init__(_operand(left), _operand(right))

    @property
    def left(self) -> list[Substitution]:
        return self._parts[0]

    @property
    def right(self) -> list[Substitution]:
        return self._parts[1]

    @classmethod
    def parse(cls, data: Sequence[Any]) -> _Parsed:
        left, right = arguments_of("equals", data, 2)
        return cls, {"left": left, "right": right}

    def perform(self, context: LaunchContext) -> str:
        return _text(self._are_same(context))

    def _are_same(self, context: LaunchContext) -> bool:
        left, right = (perform_substitutions(context, part) for part in self._parts)
        truths = {"true": True, "1": True, "false": False, "0": False}
        if left.lower() in truths and right.lower() in truths:
            return truths[left.lower()] == truths[right.lower()]
        try:
            return float(left) == float(right)
        except ValueError:
            return left == right


@expose_substitution("not-equals")
class NotEqualsSubstitution(EqualsSubstitution):
    """`true` if they differ."""

    def perform(self, context: LaunchContext) -> str:
        return _text(not self._are_same(context))


@expose_substitution("if")
class IfElseSubstitution(_OfSeveral):
    """One text if the condition is true, else the other."""

    def __init__(
        self,
        condition: SomeSubstitutionsType,
        if_value: SomeSubstitutionsType = "",
        else_value: SomeSubstitutionsType = "",
    ) -> None:
        if if_value == else_value == "":
            raise RuntimeError("One of if_value and else_value must be specified")
        super().__init__(condition, if_value, else_value)

    @classmethod
    def parse(cls, data: Sequence[Any]) -> _Parsed:
        arguments_of("if", data, 2, 3)
        return cls, dict(zip(("condition", "if_value", "else_value"), data, strict=False))

    def perform(self, context: LaunchContext) -> str:
        condition, if_value, else_value = self._parts
        chosen = if_value if _is_true(context, condition) else else_value
        return perform_substitutions(context, chosen)
