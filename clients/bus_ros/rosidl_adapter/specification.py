"""The parts of a definition: constants, fields, and the messages, services and actions made of them."""

from collections import Counter
from collections.abc import Collection, Iterable
from typing import Any

from bus_ros.rosidl_adapter.names import (
    PACKAGE_NAME_MESSAGE_TYPE_SEPARATOR,
    PRIMITIVE_TYPES,
    SERVICE_REQUEST_RESPONSE_SEPARATOR,
    VALID_CONSTANT_NAME_PATTERN,
    VALID_FIELD_NAME_PATTERN,
    UnknownMessageType,
    is_valid_constant_name,
    is_valid_field_name,
)
from bus_ros.rosidl_adapter.types import BaseType, Type
from bus_ros.rosidl_adapter.values import parse_primitive_value_string, parse_value_string

__all__ = [
    "ActionSpecification",
    "Constant",
    "Field",
    "MessageSpecification",
    "ServiceSpecification",
    "validate_field_types",
]

Annotations = dict[str, Any]
"""`comment` is a list of lines, `unit` the text in brackets in a comment."""


class Constant:
    """A constant: `int32 LIMIT=10`.

    Raises TypeError if the type is not primitive, NameError for an invalid name, ValueError without a value,
    InvalidValue for a wrong one.
    """

    __slots__ = ["annotations", "name", "type", "value"]

    def __init__(self, primitive_type: str, name: str, value_string: str) -> None:
        if primitive_type not in PRIMITIVE_TYPES:
            raise TypeError(f"the constant type '{primitive_type}' must be a primitive type")
        if not is_valid_constant_name(name):
            raise NameError(
                f"'{name}' is an invalid constant name. "
                f"It should have the pattern '{VALID_CONSTANT_NAME_PATTERN.pattern}'"
            )
        if value_string is None:
            raise ValueError("the constant value must not be 'None'")
        self.type = primitive_type
        self.name = name
        self.value = parse_primitive_value_string(Type(primitive_type), value_string)
        self.annotations: Annotations = {}

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Constant):
            return False
        return (self.type, self.name, self.value) == (other.type, other.name, other.value)

    __hash__ = None  # type: ignore[assignment]

    def __str__(self) -> str:
        value = f"'{self.value}'" if self.type in ("string", "wstring") else self.value
        return f"{self.type} {self.name}={value}"


class Field:
    """A field, with its default value or None: `int32 count 5`.

    Raises TypeError if `type_` is not a Type, NameError for an invalid name, InvalidValue for a wrong value.
    """

    def __init__(self, type_: Type, name: str, default_value_string: str | None = None) -> None:
        if not isinstance(type_, Type):
            raise TypeError(f"the field type '{type_}' must be a 'Type' instance")
        if not is_valid_field_name(name):
            raise NameError(
                f"'{name}' is an invalid field name. "
                f"It should have the pattern '{VALID_FIELD_NAME_PATTERN.pattern}'"
            )
        self.type = type_
        self.name = name
        self.default_value: Any = None
        if default_value_string is not None:
            self.default_value = parse_value_string(type_, default_value_string)
        self.annotations: Annotations = {}

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Field):
            return False
        return (self.type, self.name, self.default_value) == (other.type, other.name, other.default_value)

    __hash__ = None  # type: ignore[assignment]

    def __str__(self) -> str:
        if self.default_value is None:
            return f"{self.type} {self.name}"
        is_text = self.type.type in ("string", "wstring") and not self.type.is_array
        value = f"'{self.default_value}'" if is_text else self.default_value
        return f"{self.type} {self.name} {value}"


class MessageSpecification:
    """A message. Raises TypeError for a wrong field or constant, ValueError if two have the same name."""

    def __init__(
        self, pkg_name: str, msg_name: str, fields: Iterable[Field], constants: Iterable[Constant]
    ) -> None:
        self.base_type = BaseType(f"{pkg_name}{PACKAGE_NAME_MESSAGE_TYPE_SEPARATOR}{msg_name}")
        self.msg_name = msg_name
        self.annotations: Annotations = {}
        self.fields: list[Field] = _checked("field", Field, fields)
        self.constants: list[Constant] = _checked("constant", Constant, constants)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, MessageSpecification):
            return False
        return (self.base_type, self.fields, self.constants) == (
            other.base_type,
            other.fields,
            other.constants,
        )

    __hash__ = None  # type: ignore[assignment]

    def __str__(self) -> str:
        """The text of a definition with the same content."""
        return "\n".join(map(str, (f"# {self.base_type}", *self.constants, *self.fields)))


class ServiceSpecification:
    """A service, with its two messages."""

    def __init__(
        self, pkg_name: str, srv_name: str, request: MessageSpecification, response: MessageSpecification
    ) -> None:
        self.pkg_name = pkg_name
        self.srv_name = srv_name
        self.request = _message(request)
        self.response = _message(response)

    def __str__(self) -> str:
        """The text of a definition with the same content."""
        head = f"# {self.pkg_name}/{self.srv_name}"
        return f"{head}\n{self.request}\n{SERVICE_REQUEST_RESPONSE_SEPARATOR}\n{self.response}"


class ActionSpecification:
    """An action, with its three messages."""

    def __init__(
        self,
        pkg_name: str,
        action_name: str,
        goal: MessageSpecification,
        result: MessageSpecification,
        feedback: MessageSpecification,
    ) -> None:
        self.pkg_name = pkg_name
        self.action_name = action_name
        self.goal = _message(goal)
        self.result = _message(result)
        self.feedback = _message(feedback)


Specification = MessageSpecification | ServiceSpecification | ActionSpecification


def validate_field_types(spec: Specification, known_msg_types: Collection[BaseType]) -> None:
    """Raise UnknownMessageType for a field whose type is neither primitive nor known."""
    if isinstance(spec, MessageSpecification):
        kind, messages = "Message", [spec]
    elif isinstance(spec, ServiceSpecification):
        kind, messages = "Service", [spec.request, spec.response]
    elif isinstance(spec, ActionSpecification):
        kind, messages = "Action", [spec.goal, spec.result, spec.feedback]
    else:
        raise AssertionError(f"Unknown specification type: {type(spec)}")
    for field in (one for message in messages for one in message.fields):
        base = BaseType(BaseType.__str__(field.type))
        if not base.is_primitive_type() and base not in known_msg_types:
            raise UnknownMessageType(f"{kind} interface '{base}' contains an unknown field type: {field}")


def _message(message: MessageSpecification) -> MessageSpecification:
    if not isinstance(message, MessageSpecification):
        raise AssertionError(f"{message!r:.80} is no MessageSpecification")
    return message


def _checked(what: str, kind: type, values: Iterable[Any]) -> list[Any]:
    checked = list(values)
    for index, value in enumerate(checked):
        if not isinstance(value, kind):
            raise TypeError(f"{what} {index} must be a '{kind.__name__}' instance")
    twice = sorted(name for name, count in Counter(one.name for one in checked).items() if count > 1)
    if twice:
        raise ValueError(f"the {what}s iterable contains duplicate names: {', '.join(twice)}")
    return checked
