"""Definitions as in bag files: the text of a type, followed by the texts of all types that it needs.

Owns: that text ("ros2msg"), both ways. Must not know: CDR, payloads.

Each needed type comes after a line of 80 `=` and a line `MSG: geometry_msgs/Point`.
"""

import re
from typing import Any, Final

from bus.errors import ConfigurationError
from bus.types.definitions import check_size
from bus.types.idl import Field, Message, Type, parse_part
from bus.types.schema_form import Node, Schema, is_type_name

__all__ = ["parse", "write"]

_LINE: Final = "=" * 80
_PART: Final = re.compile(r"^={3,}[ \t]*\nMSG: *(\S+)[ \t]*(?:\n|\Z)", re.MULTILINE)
_NO_FIELD: Final = "structure_needs_at_least_one_member"


def write(schema: Schema) -> str:
    """The text for a schema of a type that ROS 2 can describe."""
    types, root = schema["types"], schema["root"]
    parts = [_fields(types[root])]
    for name in _needed(types, root):
        parts.append(f"{_LINE}\nMSG: {_reference(name)}\n{_fields(types[name])}")
    return "".join(parts)


def parse(type_name: str, text: str) -> Schema:
    """The schema of a type and its text. Raises ConfigurationError, with the mistake in its text."""
    type_name = _full_name(type_name)
    if not is_type_name(type_name):
        raise ConfigurationError(f"'{type_name}' is no name of a type: they are like std_msgs/msg/String")
    first, *others = _PART.split(text.replace("\r\n", "\n"))
    parts = {type_name: first}
    for name, part in zip(others[::2], others[1::2], strict=True):
        parts.setdefault(_full_name(name), part)
    types: dict[str, Any] = {}
    todo = [type_name]
    for name in todo:  # the loop extends `todo`
        if name in types:
            continue
        if name not in parts:
            raise ConfigurationError(f"the definition of {type_name} lacks {name}")
        own = f"{name.partition('/')[0]}/msg/Header"
        message = parse_part(parts[name], name, has_header=own in parts and own != name)
        types[name] = {"array": True, "fields": [_field(name, field) for field in _real(message)]}
        todo += [field.type.base for field in message.fields if "/" in field.type.base]
    return {"root": type_name, "types": types}


def _full_name(name: str) -> str:
    return name.replace("/", "/msg/") if name.count("/") == 1 else name


def _real(message: Message) -> tuple[Field, ...]:
    """The fields; without the placeholder that IDL needs in an empty message."""
    return () if [field.name for field in message.fields] == [_NO_FIELD] else message.fields


def _field(owner: str, field: Field) -> dict[str, Any]:
    check_size(owner, field)
    return {"name": field.name, "type": _node(field.type)}


def _node(type_: Type) -> Node:
    item: Node = type_.base
    if type_.base == "wstring" or type_.string_bound is not None:
        item = [type_.base, *([] if type_.string_bound is None else [type_.string_bound])]
    bounds = [] if type_.array == "unbounded" else [type_.size if type_.array == "fixed" else 0, type_.size]
    if not type_.array:
        return item
    if type_.base in ("uint8", "byte"):
        kind = ["byte"] if type_.base == "byte" else []
        return ["bytes", *bounds, *kind] if bounds else f"{type_.base}[]"
    return ["list", item, *bounds]


def _needed(types: dict[str, Any], root: str) -> list[str]:
    """The types below the root, each once, in the order in which they are named."""
    found: dict[str, None] = {root: None}
    todo = [root]
    for name in todo:  # the loop extends `todo`
        for field in types[name]["fields"]:
            base = _base(field["type"])
            if "/" in base and base not in found:
                found[base] = None
                todo.append(base)
    return list(found)[1:]


def _fields(type_: dict[str, Any]) -> str:
    return "".join(f"{_type(field['type'])} {field['name']}\n" for field in type_["fields"])


def _base(node: Node) -> str:
    return node if isinstance(node, str) else _base(node[1]) if node[0] == "list" else node[0]


def _type(node: Node) -> str:
    match node:
        case "char":
            # ROS 2 makes it a uint8, and the hash is over that. rosbags refuses a bag if this hash and the
            # hash of the text differ.
            return "uint8"
        case str():
            return _reference(node) if "/" in node else node
        case ["string", most]:
            return f"string<={most}"
        case ["bytes", least, most, *kind]:
            return _array(kind[0] if kind else "uint8", least, most)
        case ["list", item, *bounds]:
            return _array(_type(item), *bounds)
    raise AssertionError(node)


def _array(item: str, least: int = 0, most: int | None = None) -> str:
    return f"{item}[{'' if most is None else most if least else f'<={most}'}]"


def _reference(name: str) -> str:
    """`geometry_msgs/Point`, as in definitions; a service or action type keeps its kind."""
    return name.replace("/msg/", "/")
