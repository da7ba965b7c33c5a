"""The two descriptions of a message type: its encoding as MessagePack, and its type in ROS 2.

Owns: the types and names in ROS 2 for types that only Python has. Must not know: CDR, text.

Types that ROS 2 can describe stay as they are. For the rest:

    int                         int64
    T | None, T | UnsetType     T[<=1]
    dict[K, V]                  <Type><Field>Entry[], messages of `key` and `value`
    an enum, a literal          int64 or string: its value
    tuple[T, T, T]              T[3]
    a list in a list, optional bytes and the like
                                <Type><Field>Item, a message of one field `value`
    anything, other tuples, other unions
                                busd/msg/Json, a message of one string `data` that holds JSON
"""

import re
import unicodedata
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

from bus.errors import ConfigurationError
from bus.types.schema_form import Node, Schema

__all__ = [
    "JSON",
    "SIZES",
    "Bytes",
    "Described",
    "Dict",
    "Json",
    "Message",
    "Optional",
    "Primitive",
    "Sequence",
    "Shape",
    "Wrapped",
    "describe",
    "least",
]

JSON: Final = "busd/msg/Json"

SIZES: Final = {
    **dict.fromkeys(("bool", "byte", "char", "int8", "uint8"), 1),
    **dict.fromkeys(("int16", "uint16"), 2),
    **dict.fromkeys(("int32", "uint32", "float32"), 4),
    **dict.fromkeys(("int64", "uint64", "float64"), 8),
}
"""Size in CDR, in bytes, of each primitive of a fixed size."""


@dataclass(frozen=True)
class Primitive:
    """One value of a primitive type: a key of SIZES, or `string`."""

    kind: str


@dataclass(frozen=True)
class Bytes:
    """A field of bytes: a sequence, or an array of exactly `size`."""

    size: int | None = None
    most: int | None = None


@dataclass(frozen=True, eq=False)
class Sequence:
    """A list: a sequence, or an array of exactly `size`."""

    item: "Shape"
    size: int | None = None
    most: int | None = None


@dataclass(frozen=True, eq=False)
class Optional:
    """One value or none. None is null in MessagePack, or left out if it `can_be_absent`."""

    item: "Shape"
    can_be_absent: bool


@dataclass(frozen=True, eq=False)
class Dict:
    """A map of any keys; a sequence of pairs in ROS 2."""

    key: "Shape"
    value: "Shape"


@dataclass(frozen=True, eq=False)
class Wrapped:
    """A sequence in a sequence: in ROS 2 there is a message around it."""

    item: "Shape"


@dataclass(frozen=True)
class Json:
    """Any value, or a value of the type `node`; JSON in ROS 2."""

    node: Any = field(hash=False)


@dataclass(eq=False)
class Message:
    """A message: an array of its fields in MessagePack, or else a map by their keys."""

    name: str
    """The name on the bus."""
    keys: list[str] = field(default_factory=list)
    shapes: list["Shape"] = field(default_factory=list)
    is_array: bool = True
    tag: str | int | None = None
    tag_field: str | None = None
    leaves: int = 0
    """The number of its values, including the values of nested messages."""
    least: int = 1
    """The smallest size in CDR, in bytes."""


Shape: TypeAlias = Primitive | Bytes | Sequence | Optional | Dict | Wrapped | Json | Message


def least(shape: Shape) -> int:
    """The smallest size of a value in CDR, in bytes."""
    match shape:
        case Primitive(kind):
            return SIZES.get(kind, 4)
        case Bytes(int(size)):
            return size
        case Sequence(item, int(size)):
            return size * least(item)
        case Wrapped(item):
            return least(item)
        case Message():
            return shape.least
    return 4


@dataclass(frozen=True)
class Described:
    """A message type in the form that this package needs."""

    shape: Message
    schema: Schema
    """In the form of `bus.MessageSchema.description`, with types that ROS 2 can describe only."""
    as_json: tuple[str, ...]
    """The fields that are JSON in ROS 2: `local/msg/Wheel.extra`."""


def describe(description: Mapping[str, Any]) -> Described:
    """The type of a schema; the caller has checked the schema with `bus.types.schema.build`.

    Raises ConfigurationError for a `wstring`, which neither ROS 2's bag files nor this package support.
    """
    describer = _Describer(description["types"])
    root = description["root"]
    shape = describer.message(root)
    schema: Schema = {"root": describer.names[root], "types": describer.made}
    return Described(shape, schema, tuple(describer.as_json))


_PACKAGE: Final = re.compile(r"[a-z](_?[a-z0-9])*")
_NAME: Final = re.compile(r"[A-Z][A-Za-z0-9]*")
_PART: Final = re.compile(r"[A-Z][A-Za-z0-9_]*")
_FIELD: Final = re.compile(r"[a-z](_?[a-z0-9])*")


class _Describer:
    def __init__(self, types: Mapping[str, Any]) -> None:
        self._types = types
        self._shapes: dict[str, Message] = {}
        self.names: dict[str, str] = {}
        self.made: dict[str, Any] = {}
        self.as_json: list[str] = []
        # Names that are valid in ROS 2 stay; other names must differ from them.
        self._taken = {name for name in types if _ros_name(name) == name}

    def message(self, name: str) -> Message:
        if name in self._shapes:
            return self._shapes[name]
        described = self._types[name]
        ros_name = _ros_name(name)
        if ros_name != name:
            ros_name = self._unique(ros_name)
        self.names[name] = ros_name
        fields: list[dict[str, Any]] = []
        self.made[ros_name] = {"fields": fields, "array": True}
        shape = Message(
            name,
            is_array=described.get("array", False),
            tag=described.get("tag"),
            tag_field=described.get("tag_field"),
        )
        names = {one["name"] for one in described["fields"] if _FIELD.fullmatch(one["name"])}
        for one in described["fields"]:
            field_name = one["name"]
            if not _FIELD.fullmatch(field_name):
                field_name = _numbered(_field_name(field_name), names)
                names.add(field_name)
            part, node = self._field(_Place(name, one["name"], ros_name, field_name), one["type"])
            if shape.is_array and isinstance(part, Optional):
                part = Optional(part.item, can_be_absent=False)  # every field of an array has a value
            shape.keys.append(one.get("key", one["name"]))
            shape.shapes.append(part)
            shape.leaves += part.leaves if isinstance(part, Message) else 1
            fields.append({"name": field_name, "type": node})
        shape.least = sum(map(least, shape.shapes)) or 1
        self._shapes[name] = shape
        return shape

    def _field(self, place: "_Place", node: Node) -> tuple[Shape, Node]:
        """The encoding of a field of this type, and its type in ROS 2."""
        match node:
            case str() if "/" in node:
                return self.message(node), self.names[node]
            case "int":
                return Primitive("int64"), "int64"
            case "uint8[]" | "byte[]":
                return Bytes(), node
            case "string" | ["string", _]:
                return Primitive("string"), node
            case str() if node in SIZES:
                return Primitive(node), node
            case "wstring" | ["wstring", *_]:
                raise ConfigurationError(
                    f"field '{place.field}' of {place.type} is a wstring, of which implementations of ROS 2 "
                    "have different encodings: make it a string"
                )
            case ["bytes", least, most, *kind]:
                element = kind[0] if kind else "uint8"
                bounds = _bounds(least, most)
                if bounds is None:
                    return Bytes(), f"{element}[]"
                return Bytes(*_sizes(bounds)), ["bytes", *bounds, *kind]
            case ["list", item, *limits]:
                one, element = self._element(place, item)
                bounds = _bounds(*limits) if limits else None
                if bounds is None:
                    return Sequence(one), ["list", element]
                return Sequence(one, *_sizes(bounds)), ["list", element, *bounds]
            case ["tuple", first, *others] if all(other == first for other in others):
                return self._field(place, ["list", first, 1 + len(others), 1 + len(others)])
            case ["dict", key, value]:
                return self._dict(place, key, value)
            case ["literal", *values] if all(type(value) is int for value in values):
                return Primitive("int64"), "int64"
            case ["literal", *values] if all(type(value) is str for value in values):
                return Primitive("string"), "string"
            case ["union", *members] if len(members) == 2 and ("none" in members) != ("unset" in members):
                nothing = "none" if "none" in members else "unset"
                (item,) = (member for member in members if member != nothing)
                one, element = self._element(place, item)
                return Optional(one, nothing == "unset"), ["list", element, 0, 1]
        if not self.as_json or self.as_json[-1] != f"{place.type}.{place.field}":
            self.as_json.append(f"{place.type}.{place.field}")
        self.made[JSON] = {"fields": [{"name": "data", "type": "string"}], "array": True}
        return Json(node), JSON

    def _element(self, place: "_Place", node: Node) -> tuple[Shape, Node]:
        """As `_field`, for an element of a sequence: in ROS 2 it can't be a sequence itself."""
        shape, ros = self._field(place, node)
        if ros in ("uint8[]", "byte[]") or (isinstance(ros, list) and ros[0] in ("list", "bytes")):
            name = self._unique(f"{place.ros_type}{_camel(place.ros_field)}Item")
            self.made[name] = {"fields": [{"name": "value", "type": ros}], "array": True}
            return Wrapped(shape), name
        return shape, ros

    def _dict(self, place: "_Place", key: Node, value: Node) -> tuple[Shape, Node]:
        name = self._unique(f"{place.ros_type}{_camel(place.ros_field)}Entry")
        entry: dict[str, Any] = {"fields": [], "array": True}
        self.made[name] = entry
        shapes = []
        for part, node in (("key", key), ("value", value)):
            shape, ros = self._field(_Place(place.type, place.field, name, part), node)
            shapes.append(shape)
            entry["fields"].append({"name": part, "type": ros})
        return Dict(*shapes), ["list", name]

    def _unique(self, name: str) -> str:
        found = _numbered(name, self._taken | self.made.keys())
        self._taken.add(found)
        return found


@dataclass(frozen=True)
class _Place:
    """The location of a type: its message type and field, by the names on the bus and in ROS 2."""

    type: str
    field: str
    ros_type: str
    ros_field: str


def _bounds(least: int, most: int | None) -> tuple[int, int] | None:
    """Bounds that ROS 2 can express: exactly, or at most. None: any number."""
    if not most:
        return None
    return (most, most) if least == most else (0, most)


def _sizes(bounds: tuple[int, int]) -> tuple[int | None, int | None]:
    least, most = bounds
    return (most, None) if least else (None, most)


def _ros_name(name: str) -> str:
    package, kind, own = name.split("/")
    if not _PACKAGE.fullmatch(package):
        package = _field_name(package)
    if not (_NAME if kind == "msg" else _PART).fullmatch(own):
        own = _camel(_ascii(own)) or "Type"
        if not own[0].isalpha():
            own = f"Type{own}"
    return f"{package}/{kind}/{own}"


def _field_name(name: str) -> str:
    """A name in ROS 2's style: `camera_info` for `cameraInfo` and `_camera__info`."""
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", _ascii(name)).lower()
    words = "_".join(filter(None, re.split(r"[^a-z0-9]+", words)))
    return words if words[:1].isalpha() else f"field_{words}" if words else "field"


def _camel(name: str) -> str:
    return "".join(word[0].upper() + word[1:] for word in re.split(r"[^A-Za-z0-9]+", name) if word)


def _ascii(name: str) -> str:
    return unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()


def _numbered(name: str, taken: Collection[str]) -> str:
    number, found = 1, name
    while found in taken:
        number += 1
        found = f"{name}{number}"
    return found
