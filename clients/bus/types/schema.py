"""The description of a message type. It travels with discovery, so tools can echo types they can't import.

Owns: type names, the description (`describe`) and the classes made from one (`build`). Must not know: hashes,
topics, the wire. A description comes from another process, so `build` trusts nothing in it.

A schema is plain data:

    {"root": "demo/msg/Wheel",
     "types": {"demo/msg/Wheel": {"array": True, "fields": [
         {"name": "index", "type": "uint8"},
         {"name": "pose", "type": "geometry_msgs/msg/Pose"},
         {"name": "speeds", "type": ["list", "float64", 4, 4]}]}, ...}}

A type has `array` (a MessagePack array of the fields; else a map), `tag` and `tag_field` as in msgspec. A
field has `key` (its name in the map, if that differs), `required`, and `default` if that is not the zero of
its type. The type of a field is a name with two slashes (a reference), a primitive, or a list:

    bool int8 ... uint64 float32 float64 string char byte uint8[] byte[]    as in ROS 2
    int any none unset                                       64 bits; anything; null; left out of the map
    ["list", T]  ["list", T, least, most]  ["tuple", T, ...]  ["dict", K, V]  ["bytes", least, most]
    ["union", T, ...]  ["literal", value, ...]               enums are literals of their values
    ["bytes", least, most, "byte"]                           if it is `byte` in ROS 2, and not uint8
    ["string", most]  ["wstring"]  ["wstring", most]         a bounded string of ROS 2; its wide strings

It only describes the bytes on the wire: a set is a list, a dataclass a dict; a datetime, a class unknown to
msgspec and a type inside itself are `any`. Constraints other than lengths are not in it.
"""

from collections.abc import Callable, Mapping
from enum import Flag
from functools import partial
from keyword import iskeyword
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin

import msgspec
from msgspec import NODEFAULT, UNSET, Meta, Struct, UnsetType, inspect

from bus.errors import ConfigurationError, MessageTypeError
from bus.msg._types import PRIMITIVES, Message
from bus.types.schema_form import Field, Form, Node, Schema, Type, is_key, is_type_name, type_name, zero
from bus.types.unsent import Unsent

__all__ = ["Node", "Schema", "build", "describe", "type_name"]

MAX_NODES: Final = 20_000
MAX_DEPTH: Final = 64
MAX_ELEMENTS: Final = 1_000_000
"""Most values in a default instance that `build` accepts."""

_MAX_DEFAULT_BYTES: Final = 4096
_ANNOTATIONS: Final[dict[str, Any]] = {**PRIMITIVES, "int": int, "any": Any, "none": None, "unset": UnsetType}


def describe(cls: type[Struct]) -> Schema:
    """The schema of a message class. `describe(build(schema)) == schema` is true for results of `describe`.

    Raises MessageTypeError if `cls` is no message class, or if msgspec does not support it. Raises
    ConfigurationError for a bad type name or two classes with one name.
    """
    if not isinstance(cls, type) or not issubclass(cls, Struct):
        from bus.process.mistakes import no_message_class

        raise no_message_class(cls)
    try:
        info = inspect.type_info(cls)
    except (TypeError, NameError) as error:
        raise MessageTypeError(f"{cls.__module__}.{cls.__qualname__}: {error}") from error
    assert isinstance(info, inspect.StructType)
    describer = _Describer()
    root = str(describer.struct(info))
    needed = _needed(root, describer.types)
    schema = Form(root, {name: type_ for name, type_ in describer.types.items() if name in needed})
    plain: Schema = msgspec.to_builtins(schema, builtin_types=(bytes,))
    return plain


def build(schema: Mapping[str, Any]) -> type[Struct]:
    """Make a message class that decodes the messages of the class described by `schema`.

    Its fields are keyword-only, and it is marked `__foreign__`. Safe on hostile input: raises
    ConfigurationError for anything malformed or too large. `type_support(cls).decode` refuses a message that
    leaves out more than a million values (bus.types.unsent).
    """
    try:
        checked = msgspec.convert(schema, Form)
        builder = _Builder(checked.types)
        cls = builder.struct(checked.root, 0)
        cls.__unsent__ = builder.unsent(checked.root)  # type: ignore[attr-defined]
        msgspec.msgpack.Decoder(cls)
    except ConfigurationError:
        raise
    except (TypeError, ValueError, LookupError, OverflowError, RuntimeError) as error:
        raise ConfigurationError(f"schema: {error}") from error
    return cls


def _plain(value: object) -> Any:
    """A value as decoded without types. Raises an error if it can't be decoded, or is too large to send."""
    data = msgspec.msgpack.encode(value)
    if len(data) > _MAX_DEFAULT_BYTES:
        raise ValueError("too large")
    return msgspec.msgpack.decode(data)


class _Undecodable(Exception):
    """A type with values that can be encoded, but not decoded."""


class _Describer:
    def __init__(self) -> None:
        self.types: dict[str, Type] = {}
        self._classes: dict[str, type[Struct]] = {}
        self._open: set[str] = set()

    def struct(self, info: inspect.StructType) -> Node:
        if not isinstance(info.cls, type):
            return "any"  # a generic class with parameters, which has no name
        name = type_name(info.cls)
        other = self._classes.setdefault(name, info.cls)
        if other is not info.cls:
            first, second = (f"{cls.__module__}.{cls.__qualname__}" for cls in (other, info.cls))
            raise ConfigurationError(
                f"{first} and {second} are both {name}; set __type_name__ in one of them"
            )
        if name in self._open:
            return "any"
        if name not in self.types:
            self._open.add(name)
            described = self.types[name] = Type([], info.array_like, info.tag)
            described.tag_field = None if info.array_like else info.tag_field
            for field in info.fields:
                try:
                    described.fields.append(self._field(field))
                except _Undecodable as error:
                    from bus.process.mistakes import array_field

                    raise array_field(name, field.name, *error.args) from None
            self._open.discard(name)
        return name

    def _field(self, info: inspect.Field) -> Field:
        node = self._node(info.type)
        key = None if info.encode_name == info.name else info.encode_name
        field = Field(info.name, node, key, info.required)
        default, factory = info.default, info.default_factory
        if info.required or (isinstance(node, str) and self._classes.get(node) is factory):
            pass
        elif default is not NODEFAULT:
            self._set_default(field, lambda: default)
        elif factory is NODEFAULT:
            field.type = _union([node, "unset"])
        elif isinstance(factory, type) or (isinstance(factory, partial) and factory.func in _PURE):
            self._set_default(field, factory)
        else:
            field.required = True  # a factory may return any value, so no other process can know it
        return field

    def _set_default(self, field: Field, factory: Callable[[], object]) -> None:
        try:
            plain = _plain(factory())
        except (TypeError, ValueError, OverflowError):
            field.required = True
            return
        try:
            is_zero = plain == _plain(zero(field.type, self._classes))
        except (TypeError, ValueError):
            is_zero = False
        if not is_zero:
            field.default = plain

    def _node(self, info: inspect.Type) -> Node:
        extra: dict[str, Any] = {}
        while isinstance(info, inspect.Metadata):
            extra = info.extra or extra
            info = info.type
        ros = str(extra.get("ros", ""))
        match info:
            case inspect.BoolType():
                return "bool"
            case inspect.IntType():
                return ros if ros in _INTEGERS else "int"
            case inspect.FloatType():
                return "float32" if ros == "float32" else "float64"
            case inspect.StrType() if ros == "wstring" or (ros and info.max_length):
                return [ros, *([info.max_length] if info.max_length else ())]
            case inspect.StrType():
                return "string"
            case inspect.NoneType():
                return "none"
            case inspect.BytesType() | inspect.ByteArrayType() | inspect.MemoryViewType():
                if ros == "byte" or not (info.min_length or info.max_length):
                    return ros if ros in ("byte", "byte[]") else "uint8[]"
                return [
                    "bytes",
                    info.min_length or 0,
                    info.max_length,
                    *(["byte"] if ros == "byte[]" else ()),
                ]
            case inspect.StructType():
                return self.struct(info)
            case inspect.CollectionType():
                bounds = [info.min_length or 0, info.max_length]
                return ["list", self._node(info.item_type), *(bounds if any(bounds) else ())]
            case inspect.TupleType():
                return ["tuple", *map(self._node, info.item_types)]
            case inspect.NamedTupleType():
                return ["tuple", *(self._node(field.type) for field in info.fields)]
            case inspect.DictType():
                key = self._node(info.key_type)
                return ["dict", key if is_key(key) else "any", self._node(info.value_type)]
            case inspect.DataclassType() | inspect.TypedDictType():
                return ["dict", "string", "any"]
            case inspect.EnumType() if not issubclass(info.cls, Flag):
                return ["literal", *sorted((member.value for member in info.cls), key=repr)]
            case inspect.EnumType():
                return "int"
            case inspect.CustomType(cls=cls) if hasattr(cls, "tolist"):
                raise _Undecodable(cls)  # it could be sent as a list, but would be received as a list
            case inspect.LiteralType():
                return ["literal", *sorted(info.values, key=repr)]
            case inspect.UnionType():
                return _union([self._node(member) for member in info.types])
        return "any"


_INTEGERS: Final = frozenset(name for name in PRIMITIVES if "int" in name and "[" not in name) | {"char"}
_PURE: Final = (list, zero, msgspec.msgpack.decode)


def _needed(root: str, types: dict[str, Type]) -> set[str]:
    """The types reachable from the root; a union with `any` reaches none."""
    needed = {root}
    todo: list[Any] = [field.type for field in types[root].fields]
    while todo:
        node = todo.pop()
        if isinstance(node, list):
            todo += node[1:] if node[0] != "literal" else []
        elif isinstance(node, str) and "/" in node and node not in needed:
            needed.add(node)
            todo += [field.type for field in types[node].fields]
    return needed


def _union(nodes: list[Node]) -> Node:
    members: list[Node] = []
    for node in nodes:
        for member in node[1:] if isinstance(node, list) and node[0] == "union" else [node]:
            if member not in members:
                members.append(member)
    if "any" in members:
        members = [member for member in members if member in ("any", "unset")]
    return members[0] if len(members) == 1 else ["union", *members]


class _Builder:
    """Makes one class for each type, and counts everything that it makes."""

    def __init__(self, types: dict[str, Type]) -> None:
        self._types = types
        self._classes: dict[str, type[Struct]] = {}
        self._elements: dict[str, int] = {}
        self._open: set[str] = set()
        self._nodes = 0

    def struct(self, name: str, depth: int) -> type[Struct]:
        if name in self._classes:
            return self._classes[name]
        if name not in self._types or not is_type_name(name):
            raise ConfigurationError(f"schema: no type {name!r}, or not the name of one")
        if name in self._open:
            raise ConfigurationError(f"schema: {name} contains itself")
        self._open.add(name)
        described = self._types[name]
        elements = 1
        fields: list[tuple[str, Any, Any]] = []
        for field in described.fields:
            _check_field_name(name, field.name)
            annotation, size = self._node(field.type, depth + 1)
            elements = _limited("elements", elements + size + self._values_of_default(field), MAX_ELEMENTS)
            fields.append((field.name, annotation, self._default(field, annotation)))
        if len({field.name for field in described.fields}) != len(fields):
            raise ConfigurationError(f"schema: {name} has two fields of one name")
        self._elements[name] = elements
        self._classes[name] = cls = msgspec.defstruct(
            name.rpartition("/")[2],
            fields,
            bases=(Message,),
            namespace={"__type_name__": name, "__foreign__": True},
            module=__name__,
            array_like=described.array,
            kw_only=True,
            rename={field.name: field.key for field in described.fields if field.key is not None},
            tag=described.tag,
            tag_field=described.tag_field,
        )
        self._open.discard(name)
        return cls

    def unsent(self, name: str) -> Unsent:
        """The bound for left-out values in messages of a type that was made."""
        return Unsent(self._types, self._elements, name)

    def _values_of_default(self, field: Field) -> int:
        """Number of values in a default with items, including values that the items leave out."""
        if not isinstance(field.default, list | dict):
            return 0
        data = msgspec.msgpack.encode(field.default)
        unsent = self.unsent("").count(field.type, data)
        return _limited("elements", MAX_ELEMENTS + 1 if unsent is None else len(data) + unsent, MAX_ELEMENTS)

    def _default(self, field: Field, annotation: Any) -> Any:
        if field.required:
            return NODEFAULT
        if field.default is UNSET:
            if field.type[0] == "union" and "unset" in field.type:
                return UNSET
            return msgspec.field(default_factory=partial(zero, field.type, self._classes))
        data = msgspec.msgpack.encode(field.default)
        value = msgspec.msgpack.decode(data, type=annotation)
        if isinstance(value, bool | int | float | str | bytes | None):
            return value
        return msgspec.field(default_factory=partial(msgspec.msgpack.decode, data, type=annotation))

    def _node(self, node: Any, depth: int) -> tuple[Any, int]:
        """The annotation of a type, and the number of values in its zero."""
        self._nodes = _limited("types", self._nodes + 1, MAX_NODES)
        _limited("depth", depth, MAX_DEPTH)
        inner: Any
        match node:
            case str() if "/" in node:
                return self.struct(node, depth), self._elements[node]
            case str() if node in _ANNOTATIONS:
                return _ANNOTATIONS[node], 1
            case ["list", item]:
                inner, _ = self._node(item, depth + 1)
                return _of(list, inner), 1
            case ["list", item, least, most]:
                length = _length(least, most)
                inner, size = self._node(item, depth + 1)
                return Annotated[_of(list, inner), length], 1 + (length.min_length or 0) * size
            case ["bytes", least, most] | ["bytes", least, most, "byte"]:
                length = _length(least, most, {"ros": "byte[]"} if len(node) > 3 else None)
                return Annotated[bytes, length], 1 + (length.min_length or 0) // 256
            case ["string" | "wstring" as kind, int(most)]:
                return Annotated[str, _length(0, most, {"ros": kind})], 1
            case ["wstring"]:
                return Annotated[str, Meta(extra={"ros": "wstring"})], 1
            case ["tuple", *items]:
                inners, sizes = self._nodes_of(items, depth)
                return _of(tuple, inners), 1 + sum(sizes)
            case ["dict", key, value] if is_key(key):
                inners, _ = self._nodes_of([key, value], depth)
                return _of(dict, inners), 1
            case ["union", _, *_]:
                inners, sizes = self._nodes_of(node[1:], depth)
                inner = _of(Union, inners)
                _check_union(inner)
                return inner, max(sizes)
            case ["literal", *values] if values and all(v is None or type(v) in (int, str) for v in values):
                self._nodes += len(values)
                return _of(Literal, tuple(values)), 1
        raise ConfigurationError(f"schema: no such type: {node!r:.80}")

    def _nodes_of(self, nodes: list[Any], depth: int) -> tuple[tuple[Any, ...], tuple[int, ...]]:
        pairs = [self._node(node, depth + 1) for node in nodes]
        return tuple(annotation for annotation, _ in pairs), tuple(size for _, size in pairs)


def _of(generic: Any, arguments: Any) -> Any:
    return generic[arguments]


def _check_union(union: Any) -> None:
    """Refuse unions that make msgspec (at least 0.22) read foreign memory until the process crashes."""
    members = get_args(union) if get_origin(union) is Union else ()
    limits = (
        getattr(meta, name)
        for member in members
        for meta in getattr(member, "__metadata__", ())
        for name in ("ge", "le", "min_length", "max_length")
    )
    if any(get_origin(member) is tuple for member in members) and any(limit is not None for limit in limits):
        raise ConfigurationError("schema: a tuple and a type with limits can't be in one union")


def _check_field_name(type_: str, name: str) -> None:
    if not name.isidentifier() or iskeyword(name) or name.startswith("__"):
        raise ConfigurationError(f"schema: {type_} has a field {name!r:.80}, which is no name of a field")


def _length(least: object, most: object, extra: dict[str, str] | None = None) -> Meta:
    if type(least) is not int or least < 0 or not (most is None or (type(most) is int and most >= least)):
        raise ConfigurationError(f"schema: no such length: {least!r:.40} to {most!r:.40}")
    return Meta(min_length=least or None, max_length=most, extra=extra)


def _limited(what: str, value: int, limit: int) -> int:
    if value > limit:
        raise ConfigurationError(f"schema: {what}: more than {limit}")
    return value
