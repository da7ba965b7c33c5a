"""The form of a schema: its parts, the names of types, and the value of a field that was not set.

Owns: the possible contents of a schema; `bus.types.schema` describes their meaning. Must not know: how a
schema is made or used.
"""

import re
from collections.abc import Mapping
from typing import Annotated, Any, Final, TypeAlias

from msgspec import UNSET, Meta, Struct

from bus.errors import ConfigurationError

__all__ = ["Field", "Form", "Node", "Schema", "Type", "is_key", "is_type_name", "type_name", "zero"]

Schema: TypeAlias = dict[str, Any]
Node: TypeAlias = str | list[Any]
"""A type in a schema: a reference, a primitive or a list; see `bus.types.schema`."""

MAX_TYPES: Final = 256
MAX_FIELDS: Final = 1024

_KINDS: Final = ("msg", "srv", "action")
_ZEROS: Final[dict[str, Any]] = {
    **dict.fromkeys(("any", "none")),
    **dict.fromkeys(("uint8[]", "byte[]"), b""),
    **dict.fromkeys(("float32", "float64"), 0.0),
    "bool": False,
    "byte": b"\x00",
    "string": "",
    "unset": UNSET,
}


class Field(Struct, omit_defaults=True):
    """One field of a type."""

    name: Annotated[str, Meta(max_length=255)]
    type: str | list[Any]
    key: str | None = None
    required: bool = False
    default: Any = UNSET


class Type(Struct, omit_defaults=True):
    """One type, and how its fields are encoded."""

    fields: Annotated[list[Field], Meta(max_length=MAX_FIELDS)]
    array: bool = False
    tag: str | int | None = None
    tag_field: str | None = None


class Form(Struct):
    """A whole schema: the type in question, and all types that it needs."""

    root: str
    types: Annotated[dict[str, Type], Meta(max_length=MAX_TYPES)]


def type_name(cls: type[Struct]) -> str:
    """The ROS 2 name of a message class, such as `std_msgs/msg/String`.

    A class sets it by `__type_name__: ClassVar[str] = "demo/msg/Wheel"`, which is not inherited. Without
    that, it is `local/msg/<its name>`. Raises ConfigurationError for a name without the three parts.
    """
    name = vars(cls).get("__type_name__", f"local/msg/{cls.__name__}")
    if not isinstance(name, str) or not is_type_name(name):
        raise ConfigurationError(
            f"__type_name__ of {cls.__module__}.{cls.__qualname__} must have three parts, "
            f"like 'std_msgs/msg/String'; it is {name!r}"
        )
    return name


def is_type_name(name: str) -> bool:
    """Whether a name has the three parts: `[A-Za-z][A-Za-z0-9_]*`, one of _KINDS, letters of any script."""
    package, _, rest = name.partition("/")
    kind, _, own = rest.partition("/")
    return (
        len(name) <= 255
        and package.isascii()
        and package.isidentifier()
        and package[0] != "_"
        and kind in _KINDS
        and (own.isidentifier() if own.isascii() else re.fullmatch(r"[^\W\d]\w*", own) is not None)
    )


def zero(node: Node, classes: Mapping[str, type[Struct]]) -> Any:
    """The value of a field of this type that was not set, as in ROS 2."""
    if isinstance(node, str):
        return classes[node]() if "/" in node else _ZEROS.get(node, 0)
    kind, *rest = node
    match kind:
        case "list":
            return [zero(rest[0], classes) for _ in range(rest[1] if len(rest) > 1 else 0)]
        case "tuple":
            return tuple(zero(item, classes) for item in rest)
        case "bytes":
            return bytes(rest[0])
        case "union":
            return UNSET if "unset" in rest else None if "none" in rest else zero(rest[0], classes)
        case "literal":
            return rest[0]
        case "string" | "wstring":
            return ""
    return {}


def is_key(node: Node) -> bool:
    """Whether a type can be the key of a dict."""
    return node[:1] == ["literal"] if isinstance(node, list) else "/" not in node and node != "unset"
