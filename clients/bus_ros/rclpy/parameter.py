"""`rclpy.parameter`: a parameter's name, type and value, and their conversion to and from messages.

Owns: rclpy's class Parameter. Must not know: nodes, declared parameters and their rules. The message classes
are made at their first use: a program without parameters does not pay for them.
"""

from typing import TYPE_CHECKING, Any, TypeAlias

from bus.errors import ConfigurationError
from bus.parameters import messages
from bus.parameters.file import parse_file, parse_typed
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
    """The message classes that rclpy's module has, too."""
    if name not in _MESSAGES:
        raise AttributeError(f"module 'rclpy.parameter' has no attribute '{name}'")
    return parameter_message(_MESSAGES[name])


def parameter_message(name: str) -> Any:
    """The class of rcl_interfaces/msg/<name>; imported only if it is needed: the import is slow."""
    from bus_ros.rosidl import message_class

    return message_class(f"rcl_interfaces/msg/{name}")


class Parameter:
    """A name with a value, which doesn't change; without `type_`, it is the type of the value.

    Raises TypeError if no parameter can have the value, ValueError if type and value disagree.
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
        """The value; None if it is not set."""
        return self._value

    def get_parameter_value(self) -> Any:
        """The rcl_interfaces/msg/ParameterValue."""
        return messages.value_message(parameter_message, self._type, self._value)

    def to_parameter_msg(self) -> Any:
        """The rcl_interfaces/msg/Parameter."""
        return messages.parameter_message(parameter_message, self)

    def __repr__(self) -> str:
        return f"Parameter(name={self._name!r}, type_={self._type}, value={self._value!r})"


def parameter_value_to_python(parameter_value: Any) -> Any:
    """The Python value in a ParameterValue, arrays as lists; None if it is not set.

    Raises RuntimeError for an unknown type.
    """
    try:
        return messages.python_value(parameter_value)
    except ValueError as error:
        raise RuntimeError(str(error)) from None


def get_parameter_value(string_value: str) -> Any:
    """A ParameterValue from YAML text; a text that is not a value in YAML is a string."""
    return _of_text("", parse_typed(string_value)).get_parameter_value()


def _of_text(name: str, value: Any) -> "Parameter":
    # In ROS, an empty list is a list of booleans in text, and of bytes in Parameter.
    return Parameter(name, ValueType.BOOL_ARRAY if value == [] else None, value)


def parameter_dict_from_yaml_file(
    parameter_file: "str | Path",
    use_wildcard: bool = False,
    target_nodes: list[str] | None = None,
    namespace: str = "",
) -> dict[str, Any]:
    """From name to rcl_interfaces/msg/Parameter, for a file of parameters.

    Only sections of `target_nodes`, by default all. Sections of `/**` come first, and only with
    `use_wildcard`. `namespace` is put in front of each name, as it is. Raises OSError if the file can't be
    read, and RuntimeError if it is invalid or a target node has no section in it.
    """
    with open(parameter_file, encoding="utf-8") as file:  # noqa: PTH123
        text = file.read()
    try:
        sections = parse_file(text, str(parameter_file))
    except ConfigurationError as error:
        raise RuntimeError(f"YAML file is not a valid ROS parameter file: {error}") from None
    named = [section for section in sections if section.pattern != "/**"]
    chosen = [section for section in sections if use_wildcard and section.pattern == "/**"]
    if target_nodes:
        known = [section.pattern for section in sections]
        for node in target_nodes:
            own = [section for section in named if section.pattern.lstrip("/") == node.lstrip("/")]
            if not own:
                raise RuntimeError(
                    f"Param file does not contain parameters for {node}, only for nodes: {known}"
                )
            chosen += own
    else:
        chosen += named
    if not chosen:
        raise RuntimeError("Param file does not contain selected parameters")
    return {
        namespace + name: _of_text(namespace + name, value).to_parameter_msg()
        for section in chosen
        for name, value in section.parameters.items()
    }
