"""The exceptions of rclpy.exceptions, and exceptions of rclpy's C extension that programs use by name."""

from typing import Any

from bus.errors import ConfigurationError
from bus.parameters.values import UNDECLARED

__all__ = [
    "InvalidHandle",
    "InvalidNamespaceException",
    "InvalidNodeNameException",
    "InvalidParameterException",
    "InvalidParameterTypeException",
    "InvalidParameterValueException",
    "InvalidServiceNameException",
    "InvalidTopicNameException",
    "NameValidationException",
    "NoTypeSupportImportedException",
    "NodeNameNonExistentError",
    "NotInitializedException",
    "ParameterAlreadyDeclaredException",
    "ParameterException",
    "ParameterImmutableException",
    "ParameterNotDeclaredException",
    "ParameterUninitializedException",
    "RCLError",
    "RCLInvalidROSArgsError",
    "ROSInterruptException",
    "TimeSourceChangedError",
    "TimerCancelledError",
    "UnknownROSArgsError",
    "UnsupportedEventTypeError",
]


class RCLError(RuntimeError):
    """Base of errors that ROS's C layer would report."""


class RCLInvalidROSArgsError(RCLError):
    """The command line has an invalid ROS argument."""


class UnknownROSArgsError(RuntimeError):
    """The command line has unknown ROS arguments."""


class NodeNameNonExistentError(RCLError):
    """No node of that name is in the graph."""


class UnsupportedEventTypeError(RCLError):
    """The middleware has no such event; never raised, because busd has all of them."""


class TimerCancelledError(RCLError):
    """A timer was asked for its next call after it was cancelled."""


class InvalidHandle(RuntimeError):
    """An object was used after it was destroyed."""


class NotInitializedException(Exception):
    """A context was used before `rclpy.init()`, or after its shutdown."""

    def __init__(self, message: str | None = None) -> None:
        detail = f" msg:{message}" if message else ""
        super().__init__(f"rclpy.init() has not been called.{detail}")


class NoTypeSupportImportedException(Exception):
    """A message class can't be put on the wire."""

    def __init__(self) -> None:
        super().__init__("no type_support imported")


class TimeSourceChangedError(Exception):
    """Simulated time began or ended during a sleep."""

    def __init__(self, text: str = "the time source has changed") -> None:
        super().__init__(text)


class ROSInterruptException(Exception):
    """The context was shut down during a wait."""

    def __init__(self) -> None:
        super().__init__("rclpy.shutdown() has been called")


class NameValidationException(Exception):
    """A name of a topic, service, node or namespace breaks a rule; a caret in the text shows the place."""

    def __init__(self, name_type: str, name: str, error_msg: str, invalid_index: int) -> None:
        super().__init__(f"Invalid {name_type}: {error_msg}:\n  '{name}'\n   {' ' * invalid_index}^")


class _NameException(NameValidationException):
    """Base of the exceptions for one kind of name each."""

    kind = ""

    def __init__(self, name: str, error_msg: str, invalid_index: int) -> None:
        super().__init__(self.kind, name, error_msg, invalid_index)

    @classmethod
    def of(cls, name: str, error: ConfigurationError) -> "_NameException":
        """The exception for an error of `bus.names` about `name`, or its full name, in rclpy's words."""
        # Texts of bus.names: "Invalid <kind>: <rule>:\n  '<full>' (expanded from '<name>')\n   ^"
        full, expanded, _ = str(error).partition(":\n  '")[2].partition(f"' (expanded from '{name}')\n")
        return cls(full if expanded else name, rule_of(error), error.index or 0)


def rule_of(error: ConfigurationError) -> str:
    """The rule in an error of `bus.names`."""
    return str(error).partition(": ")[2].partition(":\n")[0] or str(error)


class InvalidNamespaceException(_NameException):
    kind = "namespace"


class InvalidNodeNameException(_NameException):
    kind = "node name"


class InvalidTopicNameException(_NameException):
    kind = "topic name"


class InvalidServiceNameException(_NameException):
    kind = "service name"


class ParameterException(Exception):
    """Base of errors about parameters; the text ends with their names."""

    def __init__(self, error_msg: str, parameters: str | list[str]) -> None:
        super().__init__(f"{error_msg}: {parameters}")


class ParameterNotDeclaredException(ParameterException):
    """An undeclared parameter was used, in a node that requires declarations."""

    def __init__(self, parameters: str | list[str]) -> None:
        super().__init__(UNDECLARED, parameters)


class ParameterAlreadyDeclaredException(ParameterException):
    """A parameter was declared twice."""

    def __init__(self, parameters: str | list[str]) -> None:
        super().__init__("Parameter(s) already declared", parameters)


class InvalidParameterException(ParameterException):
    """A parameter's name is not allowed."""

    def __init__(self, parameter_name: str) -> None:
        super().__init__("Invalid parameter name", parameter_name)


class InvalidParameterTypeException(ParameterException):
    """A value's type differs from the parameter's; `desired_parameter` is a Parameter."""

    def __init__(self, desired_parameter: Any, expected_type: object) -> None:
        super().__init__(
            f"Trying to set parameter '{desired_parameter.name}' to '{desired_parameter.value}'"
            f" of type '{desired_parameter.type_.name}', expecting type '{expected_type}'",
            desired_parameter.name,
        )


class InvalidParameterValueException(ParameterException):
    """A callback, or the parameter's descriptor, refuses a value."""

    def __init__(self, parameter: str, value: object, reason: str) -> None:
        super().__init__(f"Invalid parameter value ({value}) for parameter. Reason: {reason}", parameter)


class ParameterImmutableException(ParameterException):
    """A program tried to change a read-only parameter."""

    def __init__(self, parameter_name: str) -> None:
        super().__init__("Attempted to modify read-only parameter", parameter_name)


class ParameterUninitializedException(ParameterException):
    """A parameter was read that has no value yet, only a declared type."""

    def __init__(self, parameter_name: str) -> None:
        super().__init__(f"The parameter '{parameter_name}' is not initialized", parameter_name)
