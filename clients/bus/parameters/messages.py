"""Parameters as ROS 2's messages in rcl_interfaces, and back.

The messages are native ones or rclpy's: the caller passes the classes. Must not know: rules, services.
"""

from typing import Any, Protocol

from bus.parameters.store import Change
from bus.parameters.values import ParameterType, Rules, Setting

__all__ = [
    "SERVICES",
    "MessageClass",
    "descriptor_message",
    "event_message",
    "parameter_message",
    "python_value",
    "value_message",
]

SERVICES = {
    "DescribeParameters": "describe_parameters",
    "GetParameterTypes": "get_parameter_types",
    "GetParameters": "get_parameters",
    "ListParameters": "list_parameters",
    "SetParameters": "set_parameters",
    "SetParametersAtomically": "set_parameters_atomically",
}
"""The services of a node with parameters, below its own name, by their types in rcl_interfaces/srv."""


class MessageClass(Protocol):
    """A function that returns the class of rcl_interfaces/msg/<name>."""

    def __call__(self, name: str, /) -> Any: ...


def value_message(message_class: MessageClass, type_: ParameterType, value: Any) -> Any:
    """Make a ParameterValue. Instead of a list, it accepts a tuple, or an array of another item size."""
    make = message_class("ParameterValue")
    if type_ is ParameterType.NOT_SET:
        return make()
    if type_.is_array and not isinstance(value, bytes):
        value = list(value)
    return make(type=int(type_), **{_field(type_): value})


def parameter_message(message_class: MessageClass, one: Setting) -> Any:
    """Make a Parameter."""
    value = value_message(message_class, one.type_, one.value)
    return message_class("Parameter")(name=one.name, value=value)


def event_message(message_class: MessageClass, node: str, change: Change[Any]) -> Any:
    """Make a ParameterEvent of the node with that full name, without a stamp."""
    return message_class("ParameterEvent")(
        node=node,
        new_parameters=[parameter_message(message_class, one) for one in change.new],
        changed_parameters=[parameter_message(message_class, one) for one in change.changed],
        deleted_parameters=[parameter_message(message_class, one) for one in change.deleted],
    )


def descriptor_message(
    message_class: MessageClass, name: str, rules: Rules, description: str, constraints: str
) -> Any:
    """Make a ParameterDescriptor."""
    integers, doubles = rules.integer_range, rules.floating_point_range
    return message_class("ParameterDescriptor")(
        name=name,
        type=int(rules.type_),
        description=description,
        additional_constraints=constraints,
        read_only=rules.is_read_only,
        dynamic_typing=rules.is_dynamic,
        integer_range=[] if integers is None else [message_class("IntegerRange")(**integers._asdict())],
        floating_point_range=(
            [] if doubles is None else [message_class("FloatingPointRange")(**doubles._asdict())]
        ),
    )


def python_value(message: Any) -> Any:
    """The value in a ParameterValue: arrays as lists (bytes as bytes), None if it is not set.

    Raises ValueError for a type that does not exist.
    """
    try:
        type_ = ParameterType(message.type)
    except ValueError:
        raise ValueError(f"unexpected parameter type {message.type}") from None
    if type_ is ParameterType.NOT_SET:
        return None
    value = getattr(message, _field(type_))
    return list(value) if type_.is_array and not isinstance(value, bytes) else value


def _field(type_: ParameterType) -> str:
    """The field of ParameterValue for a type: BOOL_ARRAY is in bool_array_value."""
    return f"{type_.name.lower()}_value"
