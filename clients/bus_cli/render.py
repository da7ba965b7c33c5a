"""Messages as text: YAML as ros2 prints it, CSV, and plain values for JSON.

First converts a message to plain values by its schema, because a value alone does not tell an array of octets
from an octet. Then writes them. The rules are those of rosidl_runtime_py/convert.py.
"""

import sys
from collections.abc import Iterable
from functools import cache
from typing import Any

import msgspec

from bus.base.printable import printable
from bus.types.support import type_support

__all__ = ["Budget", "TooManyValuesError", "View", "represent_text", "to_csv", "to_text", "to_yaml"]

# Names of types in IDL; the others are the same.
_IDL_NAMES = {"bool": "boolean", "byte": "octet", "char": "uint8", "float32": "float", "float64": "double"}


class TooManyValuesError(Exception):
    """A message has more values to show than its budget allows."""


class Budget:
    """The number of values of one message that may still be shown. Set `left` to `most` for each message."""

    def __init__(self, most: int) -> None:
        self.most = self.left = most


class View(msgspec.Struct, frozen=True, kw_only=True):
    """The parts of a message to show. Lengths are of strings and arrays; None shows all of them."""

    truncate_length: int | None = None
    no_arr: bool = False
    no_str: bool = False
    octets: bool = False
    """Whether single octets are shown as numbers, and not as characters as ros2 does."""
    budget: Budget | None = None
    """None: any number of values is shown."""

    def plain(self, schema: dict[str, Any], node: Any, value: Any) -> Any:
        """`value`, which is of the type `node` of `schema`, as dicts, lists and scalars.

        Raises TooManyValuesError if that are more than the budget allows.
        """
        budget = self.budget
        if budget is not None:
            budget.left -= 1
            if budget.left < 0:
                raise TooManyValuesError
        match node:
            case "string":
                return self._string(value)
            case "byte":
                return value[0] if self.octets else chr(value[0])
            case "uint8[]":
                return self._sequence(schema, "uint8", value, None)
            case "byte[]":
                return self._sequence(schema, "byte", [value[at : at + 1] for at in range(len(value))], None)
            case str() if "/" in node:
                return self._struct(schema, node, value)
            case ["list", item, *bounds]:
                return self._sequence(schema, item, value, bounds)
            case ["bytes", *bounds]:
                return self._sequence(schema, "uint8", value, bounds)
            case ["tuple", *items]:
                return [self.plain(schema, *pair) for pair in zip(items, value, strict=True)]
            case ["dict", key, item]:
                return {
                    self.plain(schema, key, name): self.plain(schema, item, of) for name, of in value.items()
                }
            case ["union", *_] | "any":
                return self._anything(value)
        return value

    def _struct(self, schema: dict[str, Any], name: str, value: Any) -> dict[str, Any]:
        parts: dict[str, Any] = {}
        for field in schema["types"][name]["fields"]:
            part = getattr(value, field["name"])
            if part is not msgspec.UNSET:
                parts[field["name"]] = self.plain(schema, field["type"], part)
        return parts

    def _sequence(self, schema: dict[str, Any], item: Any, value: Any, bounds: list[Any] | None) -> Any:
        if self.no_arr:
            return _array_text(item, len(value), bounds)
        shown = [self.plain(schema, item, part) for part in value[: self.truncate_length]]
        return shown if len(shown) == len(value) else [*shown, "..."]

    def _string(self, value: str) -> str:
        if self.no_str:
            return f"<string length: <{len(value)}>>"
        shown = value[: self.truncate_length]
        return shown if len(shown) == len(value) else f"{shown}..."

    def _anything(self, value: Any) -> Any:
        """A value whose schema says too little: its class decides."""
        match value:
            case msgspec.Struct():
                schema = type_support(type(value)).schema
                return self.plain(schema, schema["root"], value)
            case str():
                return self._string(value)
            case bytes() | bytearray() | memoryview():
                return self._sequence({}, "uint8", value, None)
            case list() | tuple():
                return self._sequence({}, "any", value, None)
            case dict():
                return {self._anything(name): self._anything(part) for name, part in value.items()}
            case None | bool() | int() | float():
                return value
        return str(value)


def to_text(plain: Any, *, flow_style: bool = False) -> str:
    """A field by itself: scalars as they are, except control characters; the rest as YAML.

    Ends with a newline.
    """
    is_scalar = not isinstance(plain, dict | list)
    return f"{printable(str(plain))}\n" if is_scalar else to_yaml(plain, flow_style=flow_style)


def to_yaml(plain: Any, *, flow_style: bool = False) -> str:
    """YAML as ros2 prints it: fields in their order, nothing wrapped, no aliases.

    Control characters are escaped as in YAML: a reader gets the same texts.
    """
    import yaml

    text: str = yaml.dump(
        plain, Dumper=_dumper(), allow_unicode=True, width=sys.maxsize, default_flow_style=flow_style
    )
    return printable(text)


def to_csv(plain: Any) -> str:
    """The leaves in their order, separated by commas, on one line; nothing is quoted, as ros2 does.

    Newlines and other control characters, except tabs, are escaped.
    """
    return printable(",".join(str(leaf) for leaf in _leaves(plain)), keep="\t")


def _leaves(plain: Any) -> Iterable[Any]:
    if isinstance(plain, dict):
        plain = plain.values()
    elif not isinstance(plain, list):
        return [plain]
    return [leaf for part in plain for leaf in _leaves(part)]


def _array_text(item: Any, length: int, bounds: list[Any] | None) -> str:
    name = _IDL_NAMES.get(item, item) if isinstance(item, str) else item[0]
    least, most = bounds or (0, None)
    if most is not None and least == most:
        return f"<array type: {name}[{most}]>"
    return f"<sequence type: {name}{'' if most is None else f'[{most}]'}, length: {length}>"


@cache
def _dumper() -> Any:
    """PyYAML's, with mappings in their order and in blocks at the top, as ros2's representer makes them."""
    import yaml

    class Dumper(yaml.SafeDumper):
        def ignore_aliases(self, data: object) -> bool:
            return True

    def represent_mapping(dumper: Any, data: dict[Any, Any]) -> yaml.MappingNode:
        pairs = [(dumper.represent_data(key), dumper.represent_data(value)) for key, value in data.items()]
        return yaml.MappingNode("tag:yaml.org,2002:map", pairs)

    Dumper.add_representer(dict, represent_mapping)
    Dumper.add_representer(str, represent_text)
    return Dumper


def represent_text(dumper: Any, text: str, style: str | None = None) -> Any:
    """For PyYAML: `text` in `style`, or in double quotes if `printable` must escape something in it.

    PyYAML itself does not escape some control characters. Escapes are only read in double quotes.
    """
    if printable(text) != text:
        style = '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)
