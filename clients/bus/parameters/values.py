"""The allowed values of a parameter: types and rules; for both APIs, `bus.Node` and the facade of rclpy.

Owns: ROS 2's types and its rules for values, with its texts. Must not know: messages, nodes, the bus, files
and command lines, or a program's classes of parameters: it only uses the protocol `Setting`.
"""

import array
from enum import IntEnum
from math import inf, isclose, isfinite
from typing import Any, NamedTuple, Protocol

__all__ = [
    "SEPARATOR",
    "UNDECLARED",
    "WRONG_TYPE",
    "ParameterType",
    "Range",
    "Rules",
    "Setting",
]

SEPARATOR = "."
"""The character between the parts of a parameter's name."""

UNDECLARED = "Invalid access to undeclared parameter(s)"
WRONG_TYPE = "Wrong parameter type"
"""The start of the reason if a value has another type than declared."""

_TOLERANCE = 1e-6


class ParameterType(IntEnum):
    """The type of a parameter's value, with the numbers of rcl_interfaces/msg/ParameterType."""

    NOT_SET = 0
    BOOL = 1
    INTEGER = 2
    DOUBLE = 3
    STRING = 4
    BYTE_ARRAY = 5
    BOOL_ARRAY = 6
    INTEGER_ARRAY = 7
    DOUBLE_ARRAY = 8
    STRING_ARRAY = 9

    @classmethod
    def from_parameter_value(cls, parameter_value: Any) -> "ParameterType":
        """The type of a Python value; an empty list is a BYTE_ARRAY. Raises TypeError if there is none."""
        if parameter_value is None:
            return cls.NOT_SET
        for type_, python_type in _SCALARS.items():
            if isinstance(parameter_value, python_type):
                return type_
        if not isinstance(parameter_value, _SEQUENCES):
            raise TypeError(f"The given value is not one of the allowed types '{parameter_value}'.")
        for type_, python_type in _ITEMS.items():
            if all(isinstance(item, python_type) for item in parameter_value):
                return type_
        raise TypeError(f"The given value is not a list of one of the allowed types '{parameter_value}'.")

    def check(self, parameter_value: Any) -> bool:
        """Whether a Python value is of this type."""
        if self is ParameterType.NOT_SET:
            return parameter_value is None
        if self in _SCALARS:
            return isinstance(parameter_value, _SCALARS[self])
        item_type = _ITEMS[self]
        return isinstance(parameter_value, _SEQUENCES) and all(
            isinstance(item, item_type) for item in parameter_value
        )

    @property
    def is_array(self) -> bool:
        return self in _ITEMS

    def __str__(self) -> str:
        return f"Type.{self.name}"

    def __repr__(self) -> str:
        return f"<{self}: {self.value}>"


# In the order of the checks: a bool is an int as well.
_SCALARS = {
    ParameterType.BOOL: bool,
    ParameterType.INTEGER: int,
    ParameterType.DOUBLE: float,
    ParameterType.STRING: str,
}
_ITEMS = {
    ParameterType.BYTE_ARRAY: bytes,
    ParameterType.BOOL_ARRAY: bool,
    ParameterType.INTEGER_ARRAY: int,
    ParameterType.DOUBLE_ARRAY: float,
    ParameterType.STRING_ARRAY: str,
}
_SEQUENCES = (list, tuple, array.array)


class Setting(Protocol):
    """A present or requested parameter; it doesn't change."""

    @property
    def name(self) -> str: ...

    @property
    def type_(self) -> ParameterType: ...

    @property
    def value(self) -> Any: ...


class Range(NamedTuple):
    """A range with both ends included, in any order; `step` 0 = every value between."""

    from_value: float
    to_value: float
    step: float = 0


class Rules(NamedTuple):
    """The rules that values must obey. The ranges are `Range` objects or their messages."""

    type_: ParameterType = ParameterType.NOT_SET
    is_dynamic: bool = False
    is_read_only: bool = False
    integer_range: Any = None
    floating_point_range: Any = None

    @classmethod
    def of(cls, descriptor: Any) -> "Rules":
        """The rules in a rcl_interfaces/msg/ParameterDescriptor; for None, only the static type."""
        if descriptor is None:
            return cls()
        return cls(
            ParameterType(descriptor.type),
            descriptor.dynamic_typing,
            descriptor.read_only,
            next(iter(descriptor.integer_range), None),
            next(iter(descriptor.floating_point_range), None),
        )

    def with_type_of(self, one: Setting) -> "Rules":
        """The rules with the type of the first value, or of the current value if the type may change."""
        is_fixed = not self.is_dynamic and one.type_ is ParameterType.NOT_SET
        return self if is_fixed else self._replace(type_=one.type_)

    def find_fault(self, one: Setting, *, is_known: bool) -> str:
        """The reason why a value is not allowed, "" if it is; `is_known`: the parameter was declared
        before."""
        type_ = one.type_
        if not self.is_dynamic:
            if type_ is ParameterType.NOT_SET:
                return "Static parameter cannot be undeclared" if is_known else ""
            if type_ is not self.type_:
                return f"{WRONG_TYPE}, expected '{self.type_}' got '{type_}'"
        if type_ is ParameterType.INTEGER and self.integer_range is not None:
            return _integer_fault(one, self.integer_range)
        if type_ is ParameterType.DOUBLE and self.floating_point_range is not None:
            return _float_fault(one, self.floating_point_range)
        return ""


def _integer_fault(one: Setting, allowed: Any) -> str:
    value = one.value
    low, high = sorted((allowed.from_value, allowed.to_value))
    if value in (low, high):
        return ""
    if not low < value < high:
        return _out_of_range(one, low, high)
    if allowed.step and (value - low) % allowed.step:
        return (
            f"The parameter value for {one.name} is not a valid step. "
            f"Min: {low}, max: {high}, value: {value}, step: {allowed.step}"
        )
    return ""


def _float_fault(one: Setting, allowed: Any) -> str:
    value = one.value
    low, high = sorted((allowed.from_value, allowed.to_value))
    if isclose(value, low, rel_tol=_TOLERANCE) or isclose(value, high, rel_tol=_TOLERANCE):
        return ""
    if not low < value < high:  # also True for NaN
        return _out_of_range(one, low, high)
    steps = (value - low) / allowed.step if allowed.step else inf
    if isfinite(steps):  # else there is no first step, or the steps are too small to distinguish
        nearest = low + round(steps) * allowed.step
        if not isclose(nearest, value, rel_tol=_TOLERANCE):
            return (
                f"The parameter value for {one.name} is not close enough to a valid step. "
                f"Min: {low}, max: {high}, value: {value}, step: {allowed.step}"
            )
    return ""


def _out_of_range(one: Setting, low: float, high: float) -> str:
    return f"Parameter {one.name} out of range. Min: {low}, Max: {high}, value: {one.value}"
