"""The hash that distinguishes message types with the same name.

Owns: ROS 2's type hash (RIHS01, from rosidl's type description) for types that ROS 2 can describe, and a hash
of our own (BUS01) for all others. Must not know: classes, topics.

`RIHS01_<sha256>` is over the JSON text of a type_description_interfaces/msg/TypeDescription without defaults.
A type has the same hash here and in a real ROS 2 system.
"""

import re
from typing import Any, Final

from bus.types.schema_form import Node, Schema

__all__ = ["schema_hash"]

_NESTED: Final = 1
_PRIMITIVES: Final = {
    "int8": 2,
    "uint8": 3,
    "char": 3,
    "int16": 4,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float32": 10,
    "float64": 11,
    "bool": 15,
    "byte": 16,
    "string": 17,
    "wstring": 18,
}
"""Constants of type_description_interfaces/msg/FieldType; rosidl makes a char of a .msg file a uint8."""

_BOUNDED_STRINGS: Final = {"string": 21, "wstring": 22}
_ARRAY: Final = 48
_BOUNDED_SEQUENCE: Final = 96
_UNBOUNDED_SEQUENCE: Final = 144
_FIELD_NAME: Final = re.compile(r"[a-z](_?[a-z0-9])*")
_TYPE_NAME: Final = re.compile(r"[a-z](_?[a-z0-9])*/(msg|srv|action)/[A-Z][A-Za-z0-9_]*")


class _NotROS(Exception):
    """ROS 2 has no such type."""


def schema_hash(schema: Schema) -> str:
    """`RIHS01_...` if ROS 2 can describe the type, else `BUS01_...`. Defaults don't count."""
    # Both are slow to import, and most programs that import this module hash nothing.
    import hashlib
    import json

    try:
        prefix, described = "RIHS01", _ros_description(schema)
        text = json.dumps(described, separators=(", ", ": "), ensure_ascii=True)
    except _NotROS:
        prefix = "BUS01"
        text = json.dumps(_layout(schema), separators=(",", ":"), sort_keys=True, ensure_ascii=True)
    return f"{prefix}_{hashlib.sha256(text.encode()).hexdigest()}"


def _layout(schema: Schema) -> dict[str, Any]:
    types = {
        name: type_
        | {
            "fields": [
                {key: field[key] for key in field if key not in ("default", "required")}
                for field in type_["fields"]
            ]
        }
        for name, type_ in schema["types"].items()
    }
    return {"root": schema["root"], "types": types}


def _ros_description(schema: Schema) -> dict[str, Any]:
    described = {name: _ros_type(name, type_) for name, type_ in schema["types"].items()}
    root = described.pop(schema["root"])
    return {
        "type_description": root,
        "referenced_type_descriptions": [described[name] for name in sorted(described)],
    }


def _ros_type(name: str, type_: dict[str, Any]) -> dict[str, Any]:
    if not type_.get("array") or type_.get("tag") is not None or not _TYPE_NAME.fullmatch(name):
        raise _NotROS
    fields = [(field["name"], _ros_field_type(field["type"])) for field in type_["fields"]]
    if not all(_FIELD_NAME.fullmatch(field) for field, _ in fields):
        raise _NotROS
    # IDL has no empty struct; rosidl adds this field.
    fields = fields or [("structure_needs_at_least_one_member", _ros_field_type("uint8"))]
    return {"type_name": name, "fields": [{"name": field, "type": type_} for field, type_ in fields]}


def _ros_field_type(node: Node) -> dict[str, Any]:
    kind, capacity, element = _UNBOUNDED_SEQUENCE, 0, node
    match node:
        case "uint8[]" | "byte[]":
            element = node[:-2]
        case ["string" | "wstring", *_]:
            kind = 0
        case ["bytes" | "list" as list_kind, *_]:
            if list_kind == "list":
                element, *bounds = node[1:]
            else:
                bounds, element = node[1:3], node[3] if len(node) > 3 else "uint8"
            least, most = bounds or (0, None)
            if least == most:
                kind, capacity = _ARRAY, least
            elif least == 0:
                kind, capacity = (_BOUNDED_SEQUENCE, most) if most else (_UNBOUNDED_SEQUENCE, 0)
            else:
                raise _NotROS
        case _:
            kind = 0
    length = 0
    if isinstance(element, list) and element[0] in _BOUNDED_STRINGS:
        element, *bound = element
        length = bound[0] if bound else 0
    if not isinstance(element, str) or ("/" not in element and element not in _PRIMITIVES):
        raise _NotROS
    return {
        "type_id": kind + (_BOUNDED_STRINGS[element] if length else _PRIMITIVES.get(element, _NESTED)),
        "capacity": capacity,
        "string_capacity": length,
        "nested_type_name": element if "/" in element else "",
    }
