"""What a declaration of a parameter may say, and what its descriptor allows: type, ranges.

The texts are rclpy's. Knows single declarations and values only, not which parameters a node has.
"""

import warnings
from collections.abc import Sequence
from math import isclose
from typing import Any, NamedTuple

from bus.rclpy.parameter import Parameter, ValueType, parameter_message, parameter_value_to_python

__all__ = ["WRONG_TYPE", "Declared", "Rules", "check_declaration", "find_fault"]

WRONG_TYPE = "Wrong parameter type"
"""What the reason begins with where a value has another type than was declared."""

_TOLERANCE = 1e-6
_ONLY_A_NAME = (
    "when declaring parameter named '{}', declaring a parameter only providing its name is deprecated. "
    "You have to either:\n"
    '\t- Pass a name and a default value different to "PARAMETER NOT SET" (and optionally a descriptor).\n'
    "\t- Pass a name and a parameter type.\n"
    "\t- Pass a name and a descriptor with `dynamic_typing=True"
)


class Rules(NamedTuple):
    """The part of a ParameterDescriptor that values are held against."""

    type_: ValueType = ValueType.NOT_SET
    is_dynamic: bool = False
    is_read_only: bool = False
    integer_range: Any = None
    floating_point_range: Any = None

    @classmethod
    def of(cls, descriptor: Any) -> "Rules":
        """None as descriptor has no rules but that of the static type."""
        if descriptor is None:
            return cls()
        return cls(
            ValueType(descriptor.type),
            descriptor.dynamic_typing,
            descriptor.read_only,
            next(iter(descriptor.integer_range), None),
            next(iter(descriptor.floating_point_range), None),
        )

    def with_type_of(self, parameter: Parameter) -> "Rules":
        """The type is the one that the first value had, or the present one's where it may change."""
        is_fixed = not self.is_dynamic and parameter.type_ is ValueType.NOT_SET
        return self if is_fixed else self._replace(type_=parameter.type_)

    def with_required(self, name: str, type_: ValueType) -> "Rules":
        """For a parameter declared by its type only. Raises ValueError where that means nothing."""
        if type_ is ValueType.NOT_SET:
            raise ValueError(f"Cannot declare parameter {{{name}}} as statically typed of type NOT_SET")
        if self.is_dynamic:
            raise ValueError(
                f"When declaring parameter {{{name}}} passing a descriptor with `dynamic_typing=True` "
                "is not allowed when the parameter type is indicated"
            )
        return self._replace(type_=type_)


class Declared:
    """A parameter with its rules; `descriptor` is made when somebody asks for it."""

    __slots__ = ("descriptor", "parameter", "rules")

    def __init__(self, parameter: Parameter, rules: Rules, descriptor: Any = None) -> None:
        self.parameter = parameter
        self.rules = rules
        self.descriptor = descriptor

    def describe(self) -> Any:
        """Its rcl_interfaces/msg/ParameterDescriptor; always the same object."""
        if self.descriptor is None:
            self.descriptor = parameter_message("ParameterDescriptor")()
        self.descriptor.name = self.parameter.name
        self.descriptor.type = int(self.rules.type_)
        self.descriptor.dynamic_typing = self.rules.is_dynamic
        return self.descriptor


def check_declaration(index: int, entry: Sequence[Any]) -> tuple[str, Any, Any]:
    """Name, value and descriptor of what stands at `index` of a list of declarations.

    Raises TypeError for what is no declaration, ValueError for a static one with a value that is not set.
    """
    if not 1 <= len(entry) <= 3:
        raise TypeError(
            f"Invalid parameter tuple length at index {index} in parameters list: {entry}; "
            "expecting length between 1 and 3"
        )
    name, value, descriptor = (*entry, None, None)[:3]
    if not isinstance(name, str):
        raise TypeError(f"First element {name} at index {index} in parameters list is not a str.")
    if descriptor is not None and not isinstance(descriptor, parameter_message("ParameterDescriptor")):
        raise TypeError(
            f"Third element {descriptor} at index {index} in parameters list is not a ParameterDescriptor."
        )
    if hasattr(value, "integer_array_value"):
        if value.type == ValueType.NOT_SET and not (descriptor and descriptor.dynamic_typing):
            raise ValueError(
                "Cannot declare a statically typed parameter with default value of type PARAMETER_NOT_SET"
            )
        value = parameter_value_to_python(value)
    if len(entry) == 1:
        warnings.warn(_ONLY_A_NAME.format(name), stacklevel=4)
        descriptor = parameter_message("ParameterDescriptor")(dynamic_typing=True)
    return name, value, descriptor


def find_fault(parameter: Parameter, rules: Rules, *, is_known: bool) -> str:
    """Why the value is not allowed, "" where it is; `is_known`: the parameter has been declared before."""
    type_ = parameter.type_
    if not rules.is_dynamic:
        if type_ is ValueType.NOT_SET:
            return "Static parameter cannot be undeclared" if is_known else ""
        if type_ is not rules.type_:
            return f"{WRONG_TYPE}, expected '{rules.type_}' got '{type_}'"
    if type_ is ValueType.INTEGER and rules.integer_range is not None:
        return _integer_fault(parameter, rules.integer_range)
    if type_ is ValueType.DOUBLE and rules.floating_point_range is not None:
        return _float_fault(parameter, rules.floating_point_range)
    return ""


def _integer_fault(parameter: Parameter, allowed: Any) -> str:
    value = parameter.value
    low, high = sorted((allowed.from_value, allowed.to_value))
    if value in (low, high):
        return ""
    if not low < value < high:
        return _out_of_range(parameter, low, high)
    if allowed.step and (value - low) % allowed.step:
        return (
            f"The parameter value for {parameter.name} is not a valid step. "
            f"Min: {low}, max: {high}, value: {value}, step: {allowed.step}"
        )
    return ""


def _float_fault(parameter: Parameter, allowed: Any) -> str:
    value = parameter.value
    low, high = sorted((allowed.from_value, allowed.to_value))
    if isclose(value, low, rel_tol=_TOLERANCE) or isclose(value, high, rel_tol=_TOLERANCE):
        return ""
    if not low < value < high:  # NaN too
        return _out_of_range(parameter, low, high)
    if allowed.step:
        nearest = low + round((value - low) / allowed.step) * allowed.step
        if not isclose(nearest, value, rel_tol=_TOLERANCE):
            return (
                f"The parameter value for {parameter.name} is not close enough to a valid step. "
                f"Min: {low}, max: {high}, value: {value}, step: {allowed.step}"
            )
    return ""


def _out_of_range(parameter: Parameter, low: float, high: float) -> str:
    return f"Parameter {parameter.name} out of range. Min: {low}, Max: {high}, value: {parameter.value}"
