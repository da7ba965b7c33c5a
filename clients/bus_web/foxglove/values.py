"""Values of parameters, as Foxglove's protocol has them in JSON, and as ROS 2 has them. Pure."""

import base64
import binascii
from collections.abc import Callable, Iterable
from typing import Any

from bus.parameters.messages import python_value
from bus.parameters.values import ParameterType
from bus_web.foxglove.protocol import Misunderstood, Parameter

__all__ = ["join", "parameter_of", "split", "value_of"]

_INT64 = range(-(2**63), 2**63)
_TYPES = {
    ParameterType.BYTE_ARRAY: "byte_array",
    ParameterType.DOUBLE: "float64",
    ParameterType.DOUBLE_ARRAY: "float64_array",
}


def join(node: str, parameter: str) -> str:
    """`/robot/arm` and `gains.p` as `/robot/arm.gains.p`."""
    return f"{node}.{parameter}"


def split(name: str) -> tuple[str, str] | None:
    """The node and its parameter; None for a text that names none."""
    node, dot, parameter = name.partition(".")
    return (node, parameter) if dot and parameter and node.startswith("/") else None


def parameter_of(name: str, message: Any) -> Parameter:
    """From a rcl_interfaces/msg/ParameterValue; an unset value, or an unknown type, gives no value."""
    try:
        value = python_value(message)
    except ValueError:
        return Parameter(name)
    kind = ParameterType(message.type)
    if kind is ParameterType.BYTE_ARRAY:
        value = base64.b64encode(bytes(value)).decode()
    return Parameter(name, value, _TYPES.get(kind))


def value_of(said: Parameter, present: ParameterType) -> tuple[ParameterType, Any]:
    """The type and the value that are meant for a parameter that has the type `present` now.

    Browsers write 1.0 as 1: if the parameter is a double, a whole number becomes one. Raises Misunderstood.
    """
    value = said.value
    try:
        if value is None:
            return ParameterType.NOT_SET, None
        if said.type == "byte_array":
            return ParameterType.BYTE_ARRAY, base64.b64decode(value, validate=True)
        if said.type == "float64":
            return ParameterType.DOUBLE, _float(value)
        if said.type == "float64_array":
            return ParameterType.DOUBLE_ARRAY, [_float(one) for one in value]
        if isinstance(value, list):
            return _array_of(value, present)
        return _scalar_of(value, present)
    except (TypeError, ValueError, OverflowError, binascii.Error):
        raise Misunderstood(f"{said.name}: {value!r:.100} is not a parameter value") from None


def _scalar_of(value: Any, present: ParameterType) -> tuple[ParameterType, Any]:
    match value:
        case bool():
            return ParameterType.BOOL, value
        case int() if present is ParameterType.DOUBLE:
            return ParameterType.DOUBLE, float(value)
        case int():
            return ParameterType.INTEGER, _int(value)
        case float():
            return ParameterType.DOUBLE, value
        case str():
            return ParameterType.STRING, value
    raise TypeError


def _array_of(value: list[Any], present: ParameterType) -> tuple[ParameterType, Any]:
    if not value:
        kind = present if present.is_array else ParameterType.BOOL_ARRAY
        return kind, b"" if kind is ParameterType.BYTE_ARRAY else []
    if _all(value, lambda one: isinstance(one, bool)):
        return ParameterType.BOOL_ARRAY, value
    if _all(value, lambda one: isinstance(one, str)):
        return ParameterType.STRING_ARRAY, value
    is_whole = _all(value, lambda one: isinstance(one, int) and not isinstance(one, bool))
    if is_whole and present is not ParameterType.DOUBLE_ARRAY:
        return ParameterType.INTEGER_ARRAY, [_int(one) for one in value]
    return ParameterType.DOUBLE_ARRAY, [_float(one) for one in value]


def _all(values: Iterable[Any], fits: Callable[[Any], bool]) -> bool:
    return all(map(fits, values))


def _int(value: int) -> int:
    if value not in _INT64:
        raise OverflowError
    return value


def _float(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError
    return float(value)
