"""Messages from YAML values, by the rules of `ros2 topic pub` (rosidl_runtime_py/set_message.py)."""

from collections.abc import Mapping
from time import time_ns
from typing import Any, get_args, get_type_hints

import msgspec

from bus.types.support import type_name, type_support
from bus_cli.output import CommandError

__all__ = ["Prototype"]

_HEADER = "std_msgs/msg/Header"
_TIME = "builtin_interfaces/msg/Time"


class Prototype:
    """A message of `message_type` filled with `values`; each `stamp` call sets its stamps to the time.

    Raises CommandError with ros2's text if the values don't fit.
    """

    def __init__(self, message_type: type[msgspec.Struct], values: Any) -> None:
        if not isinstance(values, dict):
            raise CommandError("The passed value needs to be a dictionary in YAML format")
        support = type_support(message_type)
        self._schema = support.schema
        self._classes = _classes(message_type)
        self._stamps: list[Any] = []
        try:
            self.message: Any = self._make(support.schema["root"], values)
            if (error := support.explain(self.message)) is not None:
                raise error
        except (ArithmeticError, AttributeError, TypeError, ValueError) as error:
            raise CommandError(f"Failed to populate field: {error}") from None

    def stamp(self) -> None:
        """Write the time into every field with the given value `now` or `auto`."""
        sec, nanosec = divmod(time_ns(), 1_000_000_000)
        for time in self._stamps:
            time.sec, time.nanosec = sec, nanosec

    def _make(self, node: Any, value: Any) -> Any:
        """Convert `value` from YAML for a field of the type `node`; keep it if the type is unknown."""
        match node:
            case str() if "/" in node:
                return self._struct(node, value)
            case "string" if value is not None and not isinstance(value, list | dict):
                return str(value)
            case "bool" if isinstance(value, int):
                return bool(value)
            case "float32" | "float64" if isinstance(value, str | int | float):
                return float(value)
            case "byte":
                return _octets([value])
            case "uint8[]" | "byte[]" | ["bytes", *_] if isinstance(value, list | str):
                return _octets(value)
            case str() if "int" in node or node == "char":
                return _integer(value)
            case ["list", item, *_] if isinstance(value, list):
                return [self._make(item, part) for part in value]
            case ["dict", _, item] if isinstance(value, dict):
                return {key: self._make(item, part) for key, part in value.items()}
        return value

    def _struct(self, name: str, value: Any) -> Any:
        cls = self._classes[name]
        if name == _TIME and value == "now":
            self._stamps.append(cls())
            return self._stamps[-1]
        if name == _HEADER and value == "auto":
            header: Any = cls()
            self._stamps.append(header.stamp)
            return header
        if not isinstance(value, Mapping):
            raise TypeError(f"Value '{value}' is expected to be a dictionary but is a {type(value).__name__}")
        fields = {field["name"]: field["type"] for field in self._schema["types"][name]["fields"]}
        for field in value:
            if field not in fields:
                from bus.base.suggest import did_you_mean

                hint = did_you_mean(str(field), fields)
                raise AttributeError(f"'{cls.__name__}' object has no attribute '{field}'{hint}")
        return cls(**{field: self._field(field, fields[field], part) for field, part in value.items()})

    def _field(self, name: str, node: Any, value: Any) -> Any:
        try:
            return self._make(node, value)
        except ValueError:
            if isinstance(value, str) and isinstance(node, str) and "/" not in node:
                raise ValueError(f"'{name}' takes {node}, not '{value}'") from None
            raise


def _integer(value: Any) -> Any:
    if isinstance(value, float) and value != int(value):
        raise ValueError(f"{value} is not a whole number")
    return int(value) if isinstance(value, str | int | float) else value


def _octets(values: Any) -> bytes:
    """Octets from numbers, or from characters, because ros2 prints octets as characters."""
    return bytes(
        ord(value) if isinstance(value, str) and len(value) == 1 else _integer(value) for value in values
    )


def _classes(cls: type[msgspec.Struct]) -> dict[str, type[msgspec.Struct]]:
    """`cls` and all message classes that its fields need, by name."""
    found: dict[str, type[msgspec.Struct]] = {}
    waiting: list[Any] = [cls]
    while waiting:
        hint = waiting.pop()
        if not (isinstance(hint, type) and issubclass(hint, msgspec.Struct)):
            waiting += get_args(hint)
        elif type_name(hint) not in found:
            found[type_name(hint)] = hint
            waiting += get_type_hints(hint).values()
    return found
