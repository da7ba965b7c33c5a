"""`rclpy.parameter`: a parameter's name, type and value, and how they become messages and come out of them.

Owns: rclpy's class of them. Must not know: nodes, declared parameters and their rules. The message
classes are made when one is first needed: a program that uses no parameters doesn't pay for them.
"""

from typing import TYPE_CHECKING, Any, TypeAlias

from bus.errors import ConfigurationError
from bus.parameters import messages
from bus.parameters.file import PARAMETERS_KEY, parse_typed, read_file
from bus.parameters.values import SEPARATOR
from bus.parameters.values import ParameterType as ValueType

if TYPE_CHECKING:  # it takes milliseconds to import
    from pathlib import Path

__all__ = [
    "PARAMETER_SEPARATOR_STRING",
    "AllowableParameterValue",
    "Parameter",
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
    from bus_ros.rosidl import message_class

    return message_class(f"rcl_interfaces/msg/{name}")


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
        return messages.value_message(parameter_message, self._type, self._value)

    def to_parameter_msg(self) -> Any:
        """As rcl_interfaces/msg/Parameter."""
        return messages.parameter_message(parameter_message, self)

    def __repr__(self) -> str:
        return f"Parameter(name={self._name!r}, type_={self._type}, value={self._value!r})"


def parameter_value_to_python(parameter_value: Any) -> Any:
    """The Python value in a ParameterValue, arrays as lists, None where it is not set.

    Raises RuntimeError for a type that does not exist.
    """
    try:
        return messages.python_value(parameter_value)
    except ValueError as error:
        raise RuntimeError(str(error)) from None


def get_parameter_value(string_value: str) -> Any:
    """A ParameterValue from YAML text; what is no value in YAML is a text."""
    value: Any = parse_typed(string_value)
    # To ROS an empty list is one of booleans here, and of bytes in Parameter.
    type_ = ValueType.BOOL_ARRAY if value == [] else None
    return Parameter("", type_, value).get_parameter_value()


def parameter_dict_from_yaml_file(
    parameter_file: "str | Path",
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
