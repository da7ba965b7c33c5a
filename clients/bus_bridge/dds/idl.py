"""Message types for cyclonedds: classes that describe types. No instance is ever made.

Owns: one class for each type. Descriptions of types come from ROS 2 (`bus_ros.cdr`), which also encodes and
decodes messages.
"""

from collections.abc import Callable
from typing import Any, Final

from bus.types.schema_form import Node
from bus_bridge.errors import BridgeError
from bus_bridge.ros2.type_names import type_to_dds
from bus_ros.cdr import Codec, schema_of_definition

__all__ = ["idl_type"]

_MAX_BOUND: Final = 65535
"""The largest bound of a sequence in type descriptions of DDS. A larger bound counts as no bound."""


def idl_type(codec: Codec) -> Any:
    """The class for a type. Raises BridgeError if cyclonedds can't describe it."""
    from cyclonedds.idl import make_idl_struct

    description = schema_of_definition(codec.type_name, codec.definition).description
    made: dict[str, Any] = {}

    def struct(name: str) -> Any:
        if name not in made:
            fields = {
                field["name"]: _type(field["type"], struct) for field in description["types"][name]["fields"]
            }
            made[name] = make_idl_struct(
                name.rpartition("/")[2] + "_",
                type_to_dds(name),
                fields or {"structure_needs_at_least_one_member": _type("uint8", struct)},
                dataclassify=False,
            )
        return made[name]

    try:
        return struct(codec.type_name)
    except (TypeError, ValueError, RecursionError) as error:
        raise BridgeError(f"DDS can't describe {codec.type_name}: {error}") from None


def _type(node: Node, struct: Callable[[str], Any]) -> Any:
    from cyclonedds.idl import types

    match node:
        case str() if "/" in node:
            return struct(node)
        case "bool":
            return bool
        case "string":
            return str
        case "char" | "byte":
            return types.byte if node == "byte" else types.uint8
        case "uint8[]" | "byte[]":
            return types.sequence[_type(node[:-2], struct)]
        case str():
            return getattr(types, node)
        case ["string", int(most)]:
            return types.bounded_str[most]
        case ["bytes", int(least), most, *kind]:
            return _many(_type(kind[0] if kind else "uint8", struct), least, most)
        case ["list", item]:
            return types.sequence[_type(item, struct)]
        case ["list", item, int(least), most]:
            return _many(_type(item, struct), least, most)
    raise TypeError(f"there is no type {node!r} in DDS")


def _many(item: Any, least: int, most: int) -> Any:
    from cyclonedds.idl import types

    if least:
        return types.array[item, least]
    return types.sequence[item, most] if most <= _MAX_BOUND else types.sequence[item]
