"""`rclpy.parameter`: a parameter's name, type and value, and how they become messages and come out of them.

Owns: types and their conversions. Must not know: nodes, declared parameters and their rules. The message
classes are made when one is first needed: a program that uses no parameters doesn't pay for them.
"""

import array
from enum import IntEnum
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from bus.errors import ConfigurationError
from bus.parameterfile import PARAMETERS_KEY, SEPARATOR, parse_typed, read_file

__all__ = [
    "PARAMETER_SEPARATOR_STRING",
    "AllowableParameterValue",
    "Parameter",
    "ParameterChange",
    "ValueType",
    "get_parameter_value",
    "parameter_dict_from_yaml_file",
    "parameter_message",
    "parameter_value_to_python",
]

PARAMETER_SEPARATOR_STRING = SEPARATOR

AllowableParameterValue: TypeAlias = Any
"""None, bool, int, float, str, or a list, tuple or array of one of these or of bytes."""

_MESSAGES = {
    "ParameterMsg": "Parameter",
    "ParameterType": "ParameterType",
    "ParameterValue": "ParameterValue",
}


def __getattr__(name: str) -> Any:
    """The message classes that rclpy has in this module too."""
    if name not in _MESSAGES:
        raise AttributeError(f"module 'rclpy.parameter' has no attribute '{name}'")
    return parameter_message(_MESSAGES[name])


def parameter_message(name: str) -> Any:
    """The class of rcl_interfaces/msg/<name>; it is slow to import, so this is done when it is needed."""
    from bus.rosidl import message_class

    return message_class(f"rcl_interfaces/msg/{name}")


class ValueType(IntEnum):
    """What a parameter holds; the numbers are those of rcl_interfaces/msg/ParameterType."""

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
    def from_parameter_value(cls, parameter_value: Any) -> "ValueType":
        """The type of a Python value; an empty list is a BYTE_ARRAY. Raises TypeError where it has none."""
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
        if self is ValueType.NOT_SET:
            return parameter_value is None
        if self in _SCALARS:
            return isinstance(parameter_value, _SCALARS[self])
        item_type = _ITEMS[self]
        return isinstance(parameter_value, _SEQUENCES) and all(
            isinstance(item, item_type) for item in parameter_value
        )

    def __str__(self) -> str:
        return f"Type.{self.name}"


# In the order in which they are tried: a bool is an int as well.
_SCALARS = {ValueType.BOOL: bool, ValueType.INTEGER: int, ValueType.DOUBLE: float, ValueType.STRING: str}
_ITEMS = {
    ValueType.BYTE_ARRAY: bytes,
    ValueType.BOOL_ARRAY: bool,
    ValueType.INTEGER_ARRAY: int,
    ValueType.DOUBLE_ARRAY: float,
    ValueType.STRING_ARRAY: str,
}
_SEQUENCES = (list, tuple, array.array)
ValueType.__name__ = "Type"
ValueType.__qualname__ = "Parameter.Type"


class Parameter:
    """A name with a value, which doesn't change; `type_` is the value's where it is not given.

    Raises TypeError for a value that no parameter can have, ValueError where type and value disagree.
    """

    Type: TypeAlias = ValueType

    def __init__(self, name: str, type_: ValueType | None = None, value: Any = None) -> None:
        if type_ is None:
            type_ = ValueType.from_parameter_value(value)
        if not isinstance(type_, ValueType):
            raise TypeError(f"type must be an instance of '{ValueType!r}'")
        if not type_.check(value):
            raise ValueError(f"Type '{type_}' and value '{value}' do not agree")
        self._name = name
        self._type = type_
        self._value = value

    @classmethod
    def from_parameter_msg(cls, param_msg: Any) -> "Parameter":
        """From rcl_interfaces/msg/Parameter."""
        value = parameter_value_to_python(param_msg.value)
        return cls(param_msg.name, ValueType(param_msg.value.type), value)

    @property
    def name(self) -> str:
        return self._name

    @property
    def type_(self) -> ValueType:
        return self._type

    @property
    def value(self) -> Any:
        """None where it is not set."""
        return self._value

    def get_parameter_value(self) -> Any:
        """As rcl_interfaces/msg/ParameterValue."""
        make = partial(parameter_message("ParameterValue"), type=int(self._type))
        if self._type is ValueType.NOT_SET:
            return make()
        # A tuple, or an array of another item size, is as good.
        value = list(self._value) if self._type in _ITEMS else self._value
        return make(**{_field(self._type): value})

    def to_parameter_msg(self) -> Any:
        """As rcl_interfaces/msg/Parameter."""
        return parameter_message("Parameter")(name=self._name, value=self.get_parameter_value())

    def __repr__(self) -> str:
        return f"Parameter(name={self._name!r}, type_={self._type}, value={self._value!r})"


class ParameterChange(NamedTuple):
    """What one change did to the parameters of a node."""

    node: str
    new: tuple[Parameter, ...]
    changed: tuple[Parameter, ...]
    deleted: tuple[Parameter, ...]

    def to_msg(self, stamp: Any = None) -> Any:
        """As rcl_interfaces/msg/ParameterEvent; `stamp` is a builtin_interfaces/msg/Time."""
        event = parameter_message("ParameterEvent")(
            node=self.node,
            new_parameters=[one.to_parameter_msg() for one in self.new],
            changed_parameters=[one.to_parameter_msg() for one in self.changed],
            deleted_parameters=[one.to_parameter_msg() for one in self.deleted],
        )
        if stamp is not None:
            event.stamp = stamp
        return event


def parameter_value_to_python(parameter_value: Any) -> Any:
    """The Python value in a ParameterValue, arrays as lists, None where it is not set.

    Raises RuntimeError for a type that does not exist.
    """
    try:
        type_ = ValueType(parameter_value.type)
    except ValueError:
        raise RuntimeError(f"unexpected parameter type {parameter_value.type}") from None
    if type_ is ValueType.NOT_SET:
        return None
    value = getattr(parameter_value, _field(type_))
    return list(value) if type_ in _ITEMS else value


def get_parameter_value(string_value: str) -> Any:
    """A ParameterValue from YAML text; what is no value in YAML is a text."""
    value: Any = parse_typed(string_value)
    # To ROS an empty list is one of booleans here, and of bytes in Parameter.
    type_ = ValueType.BOOL_ARRAY if value == [] else None
    return Parameter("", type_, value).get_parameter_value()


def parameter_dict_from_yaml_file(
    parameter_file: str | Path,
    use_wildcard: bool = False,
    target_nodes: list[str] | None = None,
    namespace: str = "",
) -> dict[str, Any]:
    """Name to rcl_interfaces/msg/Parameter, of a file of parameters.

    Only sections of `target_nodes`, by default all; those of `/**` first, and only with `use_wildcard`.
    `namespace` is put in front of each name. Raises RuntimeError where the file has nothing of that, or can't
    be used.
    """
    try:
        sections = read_file(parameter_file)
    except ConfigurationError as error:
        raise RuntimeError(f"YAML file is not a valid ROS parameter file: {error}") from None
    named = [section for section in sections if section.pattern != "/**"]
    chosen = [section for section in sections if use_wildcard and section.pattern == "/**"]
    if target_nodes:
        known = [section.pattern for section in sections]
        for node in target_nodes:
            own = [section for section in named if section.pattern.lstrip("/") == node.lstrip("/")]
            if not own and not chosen:
                raise RuntimeError(
                    f"Param file does not contain parameters for {node}, only for nodes: {known}"
                )
            chosen += own
    else:
        chosen += named
    if not chosen:
        raise RuntimeError(f"Param file does not contain selected parameters ({PARAMETERS_KEY})")
    prefix = f"{namespace}{PARAMETER_SEPARATOR_STRING}" if namespace else ""
    return {
        prefix + name: Parameter(prefix + name, value=value).to_parameter_msg()
        for section in chosen
        for name, value in section.parameters.items()
    }


def _field(type_: ValueType) -> str:
    """ParameterValue's field for it: BOOL_ARRAY is in bool_array_value."""
    return f"{type_.name.lower()}_value"
