"""What a declaration of a parameter may say, and how one is described, in the words and messages of rclpy.

Knows single declarations only, not which parameters a node has. What values are allowed is in
`bus.parameters.values`.
"""

import warnings
from collections.abc import Sequence
from typing import Any

from bus.parameters.values import Declared, Rules
from bus.parameters.values import ParameterType as ValueType
from bus_ros.rclpy.parameter import Parameter, parameter_message, parameter_value_to_python

__all__ = ["check_declaration", "describe", "with_required"]

_ONLY_A_NAME = (
    "when declaring parameter named '{}', declaring a parameter only providing its name is deprecated. "
    "You have to either:\n"
    '\t- Pass a name and a default value different to "PARAMETER NOT SET" (and optionally a descriptor).\n'
    "\t- Pass a name and a parameter type.\n"
    "\t- Pass a name and a descriptor with `dynamic_typing=True"
)


def with_required(rules: Rules, name: str, type_: ValueType) -> Rules:
    """For a parameter declared by its type only. Raises ValueError where that means nothing."""
    if type_ is ValueType.NOT_SET:
        raise ValueError(f"Cannot declare parameter {{{name}}} as statically typed of type NOT_SET")
    if rules.is_dynamic:
        raise ValueError(
            f"When declaring parameter {{{name}}} passing a descriptor with `dynamic_typing=True` "
            "is not allowed when the parameter type is indicated"
        )
    return rules._replace(type_=type_)


def describe(declared: Declared[Parameter]) -> Any:
    """Its rcl_interfaces/msg/ParameterDescriptor, made when first asked for; always the same object."""
    if declared.description is None:
        declared.description = parameter_message("ParameterDescriptor")()
    descriptor = declared.description
    descriptor.name = declared.parameter.name
    descriptor.type = int(declared.rules.type_)
    descriptor.dynamic_typing = declared.rules.is_dynamic
    return descriptor


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
