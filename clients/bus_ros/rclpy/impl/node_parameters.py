"""The parameters of one node: declared, read, set, described, and the callbacks around a change.

Owns: rclpy's calls, results and exceptions, and declarations and descriptions in rclpy's form.
`bus.parameters.store` has the values and their changes. Must not know: nodes, the bus, files and command
lines. Message classes are made at their first use.
"""

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from typing import Any, TypeAlias

from bus.parameters.store import Change, Declared, ParameterStore
from bus.parameters.values import WRONG_TYPE, Rules
from bus.parameters.values import ParameterType as ValueType
from bus_ros.rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterAlreadyDeclaredException,
    ParameterImmutableException,
    ParameterNotDeclaredException,
    ParameterUninitializedException,
)
from bus_ros.rclpy.parameter import (
    PARAMETER_SEPARATOR_STRING,
    Parameter,
    parameter_message,
    parameter_value_to_python,
)
from bus_ros.rclpy.validate_topic_name import validate_parameter_name

__all__ = ["NodeParameters"]

PreSet: TypeAlias = Callable[[list[Parameter]], list[Parameter]]
OnSet: TypeAlias = Callable[[list[Parameter]], Any]
PostSet: TypeAlias = Callable[[list[Parameter]], None]

_ONLY_A_NAME = (
    "when declaring parameter named '{}', declaring a parameter only providing its name is deprecated. "
    "You have to either:\n"
    '\t- Pass a name and a default value different to "PARAMETER NOT SET" (and optionally a descriptor).\n'
    "\t- Pass a name and a parameter type.\n"
    "\t- Pass a name and a descriptor with `dynamic_typing=True"
)


class NodeParameters:
    """The parameters of a node.

    `overrides` are the values of the command line by name (`bus.parameters.file.overrides`). The values of
    the node's constructor, `parameter_overrides`, override them. `on_change` is called with each change,
    before the post-set callbacks. If overrides are declared at once, raises as `declare_parameters`.
    """

    def __init__(
        self,
        *,
        overrides: Mapping[str, Any] | None = None,
        parameter_overrides: Iterable[Parameter] | None = None,
        allow_undeclared_parameters: bool = False,
        automatically_declare_parameters_from_overrides: bool = False,
        on_change: Callable[[Change[Parameter]], object] | None = None,
    ) -> None:
        self.__allow_undeclared = allow_undeclared_parameters
        self.__store: ParameterStore[Parameter] = ParameterStore(on_change)
        self.__declared = self.__store.declared
        self.__overrides: dict[str, Any] = dict(overrides or {})
        self.__overrides.update({one.name: one.value for one in parameter_overrides or ()})
        if automatically_declare_parameters_from_overrides:
            for name, value in self.__overrides.items():
                # rclpy gives them a static type too.
                self.__declare(name, value, None, ignore_override=True)

    # --- declaring

    def declare_parameter(
        self, name: str, value: Any = None, descriptor: Any = None, ignore_override: bool = False
    ) -> Parameter:
        """Declare a parameter; `value` is a default, or a Parameter.Type if the value must come from outside.

        Raises ParameterAlreadyDeclaredException, InvalidParameterException (the name),
        InvalidParameterTypeException, InvalidParameterValueException (a callback or a range refuses),
        TypeError if no parameter can have the value.
        """
        only_a_name = value is None and descriptor is None
        entry = (name,) if only_a_name else (name, value, descriptor)
        return self.declare_parameters("", [entry], ignore_override)[0]

    def declare_parameters(
        self, namespace: str, parameters: Iterable[Sequence[Any]], ignore_override: bool = False
    ) -> list[Parameter]:
        """Declare several: each (name), (name, value) or (name, value, descriptor), `namespace.` in front.

        After an error, the parameters before it stay declared. Raises as `declare_parameter`, and ValueError
        if a type contradicts its descriptor.
        """
        prefix = f"{namespace}{PARAMETER_SEPARATOR_STRING}" if namespace else ""
        entries = [_check_declaration(index, entry) for index, entry in enumerate(parameters)]
        known = [prefix + name for name, *_ in entries if prefix + name in self.__declared]
        if known:
            raise ParameterAlreadyDeclaredException(known)
        return [
            self.__declare(prefix + name, value, descriptor, ignore_override=ignore_override)
            for name, value, descriptor in entries
        ]

    def undeclare_parameter(self, name: str) -> None:
        """Undeclare a parameter. Raises ParameterNotDeclaredException, ParameterImmutableException."""
        if self.__find(name).rules.is_read_only:
            raise ParameterImmutableException(name)
        del self.__declared[name]

    def has_parameter(self, name: str) -> bool:
        return name in self.__declared

    # --- reading

    def get_parameter(self, name: str) -> Parameter:
        """Raises ParameterNotDeclaredException; ParameterUninitializedException if it has no value."""
        declared = self.__declared.get(name)
        if declared is None:
            if self.__allow_undeclared:
                return Parameter(name, ValueType.NOT_SET)
            raise ParameterNotDeclaredException(name)
        if declared.parameter.type_ is ValueType.NOT_SET and not declared.rules.is_dynamic:
            raise ParameterUninitializedException(name)
        return declared.parameter

    def get_parameters(self, names: Iterable[str]) -> list[Parameter]:
        """Raises as `get_parameter`; TypeError if a name is not a text."""
        return [self.get_parameter(name) for name in _texts("names", names)]

    def get_parameter_or(self, name: str, alternative_value: Parameter | None = None) -> Parameter:
        """The parameter; the alternative (default: an unset one) if it is undeclared or has no value."""
        declared = self.__declared.get(name)
        if declared is None or declared.parameter.type_ is ValueType.NOT_SET:
            return alternative_value or Parameter(name, ValueType.NOT_SET)
        return declared.parameter

    def get_parameters_by_prefix(self, prefix: str) -> dict[str, Parameter]:
        """The parameters below `prefix`, by the rest of their names; "": all."""
        start = f"{prefix}{PARAMETER_SEPARATOR_STRING}" if prefix else ""
        return {
            name[len(start) :]: declared.parameter
            for name, declared in tuple(self.__declared.items())
            if name.startswith(start)
        }

    def get_parameter_type(self, name: str) -> ValueType:
        """The type of a parameter. Raises ParameterNotDeclaredException."""
        if name not in self.__declared and self.__allow_undeclared:
            return ValueType.NOT_SET
        return self.__find(name).parameter.type_

    def get_parameter_types(self, names: Iterable[str]) -> list[ValueType]:
        """Raises as `get_parameter_type`; TypeError if a name is not a text."""
        return [self.get_parameter_type(name) for name in _texts("names", names)]

    def list_parameters(self, prefixes: list[str], depth: int) -> Any:
        """List names below any of `prefixes` (none: all), at most `depth` levels down (0: all).

        Returns rcl_interfaces/msg/ListParametersResult. Raises TypeError or ValueError for invalid arguments.
        """
        if not isinstance(prefixes, list):
            raise TypeError("The prefixes argument must be a list")
        _texts("prefixes", prefixes)
        if not isinstance(depth, int):
            raise TypeError("The depth must be instance of type int")
        if depth < 0:
            raise ValueError("The depth argument must not be negative")
        found, above = self.__store.find_below(prefixes, depth)
        return parameter_message("ListParametersResult")(names=found, prefixes=above)

    # --- setting

    def set_parameters(self, parameter_list: Iterable[Parameter]) -> list[Any]:
        """Set each separately; returns a rcl_interfaces/msg/SetParametersResult for each.

        Raises ParameterNotDeclaredException, after setting the parameters before it.
        """
        return [self.set_parameters_atomically([parameter]) for parameter in parameter_list]

    def set_parameters_atomically(self, parameter_list: Iterable[Parameter]) -> Any:
        """Set all or none; returns a SetParametersResult. A parameter without a value is undeclared.

        Raises ParameterNotDeclaredException, TypeError for anything but a Parameter.
        """
        wanted = list(parameter_list)
        if not all(isinstance(one, Parameter) for one in wanted):
            raise TypeError(f"parameter must be instance of type '{Parameter!r}'")
        wanted = self.__store.prepare(wanted)
        unknown = self.__store.unknown(wanted)
        if unknown and not self.__allow_undeclared:
            raise ParameterNotDeclaredException(unknown)
        outcome = self.__store.set(wanted)
        return parameter_message("SetParametersResult")(**outcome._asdict())

    # --- describing

    def describe_parameter(self, name: str) -> Any:
        """Its rcl_interfaces/msg/ParameterDescriptor. Raises ParameterNotDeclaredException."""
        if name not in self.__declared and self.__allow_undeclared:
            return parameter_message("ParameterDescriptor")()
        return _describe(self.__find(name))

    def describe_parameters(self, names: Iterable[str]) -> list[Any]:
        """Raises as `describe_parameter`; TypeError if a name is not a text."""
        return [self.describe_parameter(name) for name in _texts("names", names)]

    def set_descriptor(self, name: str, descriptor: Any, alternative_value: Any = None) -> Any:
        """Replace a parameter's descriptor; returns the value (a ParameterValue) after it.

        `alternative_value`, a ParameterValue, is set if the present value does not fit. Raises
        ParameterNotDeclaredException, ParameterImmutableException, InvalidParameterValueException.
        """
        if name not in self.__declared and self.__allow_undeclared:
            return Parameter(name, ValueType.NOT_SET).get_parameter_value()
        declared = self.__find(name)
        if declared.rules.is_read_only:
            raise ParameterImmutableException(name)
        rules, descriptor = Rules.of(descriptor), copy(descriptor)
        parameter = declared.parameter
        reason = rules.find_fault(parameter, is_known=True)
        if reason and alternative_value is not None:
            parameter = Parameter(name, value=parameter_value_to_python(alternative_value))
            reason = rules.find_fault(parameter, is_known=True)
        if reason:
            raise InvalidParameterValueException(name, parameter.value, reason)
        if parameter is declared.parameter:
            self.__declared[name] = Declared(parameter, rules.with_type_of(parameter), descriptor)
        else:
            successful, reason = self.__store.declare(parameter, rules, descriptor)
            if not successful:
                raise InvalidParameterValueException(name, parameter.value, reason)
        return parameter.get_parameter_value()

    # --- callbacks

    def add_pre_set_parameters_callback(self, callback: PreSet) -> None:
        """Before a change: gets the parameters to set, returns the parameters to set instead."""
        self.__store.pre_set.insert(0, callback)

    def add_on_set_parameters_callback(self, callback: OnSet) -> None:
        """May refuse a change: returns a SetParametersResult. The newest callback is called first."""
        self.__store.on_set.insert(0, callback)

    def add_post_set_parameters_callback(self, callback: PostSet) -> None:
        """After a change: gets the parameters that were set."""
        self.__store.post_set.insert(0, callback)

    def remove_pre_set_parameters_callback(self, callback: PreSet) -> None:
        """Raises ValueError if it was not added."""
        self.__store.pre_set.remove(callback)

    def remove_on_set_parameters_callback(self, callback: OnSet) -> None:
        """Raises ValueError if it was not added."""
        self.__store.on_set.remove(callback)

    def remove_post_set_parameters_callback(self, callback: PostSet) -> None:
        """Raises ValueError if it was not added."""
        self.__store.post_set.remove(callback)

    # --- inside

    def __find(self, name: str) -> Declared[Parameter]:
        declared = self.__declared.get(name)
        if declared is None:
            raise ParameterNotDeclaredException(name)
        return declared

    def __declare(self, name: str, value: Any, descriptor: Any, *, ignore_override: bool) -> Parameter:
        validate_parameter_name(name)
        rules = Rules.of(descriptor)
        if isinstance(value, ValueType):
            rules, value = _with_required(rules, name, value), None
        elif not rules.is_dynamic and value is not None:
            rules = rules.with_type_of(Parameter(name, value=value))
        if not ignore_override and name in self.__overrides:
            value = self.__overrides[name]
        parameter = Parameter(name, value=value)
        successful, reason = self.__store.declare(parameter, rules, copy(descriptor))
        if successful:
            return self.__declared[name].parameter
        if reason.startswith(WRONG_TYPE):
            raise InvalidParameterTypeException(parameter, rules.type_.name)
        raise InvalidParameterValueException(name, value, reason)


def _texts(what: str, values: Iterable[str]) -> list[str]:
    texts = list(values)
    if not all(isinstance(text, str) for text in texts):
        raise TypeError(f"All {what} must be instances of type str")
    return texts


def _with_required(rules: Rules, name: str, type_: ValueType) -> Rules:
    """Rules for a parameter with a type but no value. Raises ValueError for NOT_SET or a dynamic type."""
    if type_ is ValueType.NOT_SET:
        raise ValueError(f"Cannot declare parameter {{{name}}} as statically typed of type NOT_SET")
    if rules.is_dynamic:
        raise ValueError(
            f"When declaring parameter {{{name}}} passing a descriptor with `dynamic_typing=True` "
            "is not allowed when the parameter type is indicated"
        )
    return rules._replace(type_=type_)


def _describe(declared: Declared[Parameter]) -> Any:
    """Its rcl_interfaces/msg/ParameterDescriptor, made at its first use; always the same object."""
    if declared.description is None:
        declared.description = parameter_message("ParameterDescriptor")()
    descriptor = declared.description
    descriptor.name = declared.parameter.name
    descriptor.type = int(declared.rules.type_)
    descriptor.dynamic_typing = declared.rules.is_dynamic
    return descriptor


def _check_declaration(index: int, entry: Sequence[Any]) -> tuple[str, Any, Any]:
    """Name, value and descriptor of the declaration at `index` of a list.

    Raises TypeError for an invalid declaration, ValueError for a static one with a value that is not set.
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
        value = parameter_value_to_python(value)
    if value is None and len(entry) > 1 and not (descriptor and descriptor.dynamic_typing):
        raise ValueError(
            "Cannot declare a statically typed parameter with default value of type PARAMETER_NOT_SET"
        )
    if len(entry) == 1:
        warnings.warn(_ONLY_A_NAME.format(name), stacklevel=4)
        descriptor = parameter_message("ParameterDescriptor")(dynamic_typing=True)
    return name, value, descriptor
