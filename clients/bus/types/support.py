"""The bus's knowledge about a message class: name, hash, schema, encoder, decoder and check.

Owns: `TypeSupport`, one for each class, and the texts of type errors. Must not know: topics, the wire. It
doesn't import the ready-made classes of bus.msg, and not bus.types.classes, before `find_type` needs one.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cached_property
from typing import Any, Generic, TypeVar, cast

import msgspec
from msgspec import Struct

from bus.errors import MessageTypeError
from bus.types.check import plan, predicate
from bus.types.large_fields import bytes_fields, text_fields
from bus.types.schema_form import Node, Schema, type_name

__all__ = [
    "TypeSupport",
    "find_type",
    "hash_and_description",
    "type_hash",
    "type_name",
    "type_support",
    "wrong_class",
]

M = TypeVar("M", bound=Struct)


def _as_plain(value: object) -> object:
    """A plain value for a value of a type that the encoder doesn't know.

    These are subclasses of the plain types, arrays of bytes, and objects with a method `tolist`, such as
    numpy's scalars and arrays.
    """
    if isinstance(value, float):
        return float(value)
    if isinstance(value, int):
        return int(value)
    if isinstance(value, str):
        return str.__str__(value)
    with suppress(TypeError):
        view = memoryview(cast(Any, value))
        if view.format == "B" and view.c_contiguous:
            return view.cast("B")
    if callable(as_list := getattr(value, "tolist", None)):
        return as_list()
    raise TypeError(f"Encoding objects of type {_full_name(type(value))} is unsupported")


_encoder = msgspec.msgpack.Encoder(enc_hook=_as_plain)
ENCODE_ERRORS = (AttributeError, BufferError, OverflowError, RecursionError, TypeError, ValueError)
"""Errors of encoders for unchecked contents; `TypeSupport.explain` has a better text."""

_PATH = r"(?<=`)\$[^`]*(?=`)"
_STEP = r"\[\.\.\.\]|\[(\d+)\]|\.([^.\[]+)"


class TypeSupport(Generic[M]):
    """Everything about one message class; made by `type_support(cls)`.

    To publish: check `type(message) is cls` (else `wrong_class`), then `is_valid(message)`. If that is False,
    `explain(message)` returns the error to raise, or None if the message is right after all. `encode` itself
    may raise, too (ValueError for text with lone surrogates); then `explain` also has the path.
    """

    cls: type[M]
    name: str
    """`std_msgs/msg/String`"""
    hash: str
    description: bytes
    """`schema` in MessagePack, for other processes."""
    encode: Callable[[M], bytes]
    decode: Callable[[bytes | bytearray | memoryview], M]
    """Decodes a message. Raises ValueError (msgspec.DecodeError or UnicodeDecodeError) for other bytes."""

    def __init__(self, cls: type[M]) -> None:
        self.hash, self.description = hash_and_description(cls)
        self.cls = cls
        self.name = type_name(cls)
        self.encode = _encoder.encode
        try:
            self.decode = msgspec.msgpack.Decoder(cls).decode
            if (unsent := cls.__dict__.get("__unsent__")) is not None:  # the class of a foreign type
                self.decode = unsent.bounded(self.decode)
        except TypeError as error:
            raise MessageTypeError(f"{self.name}: {error}") from error

    # Made at the first use: only publishers need a plan, and only messages that differ from it need a check.

    @cached_property
    def is_valid(self) -> Callable[[M], bool]:
        """A function. True: the fields are surely right. False: `explain` decides."""
        return predicate(self.cls)

    @cached_property
    def plan(self) -> Any:
        """The plan of the native core to check and encode messages (`_core.Plan`); or None."""
        return plan(self.cls)

    @property
    def text_plan(self) -> Any:
        """The plan for `Reader.expect_texts`; or None.

        Without one if the class has code for a complete message: it would see an empty text.
        """
        return None if hasattr(self.cls, "__post_init__") else self.plan

    @cached_property
    def schema(self) -> Schema:
        """The decoded `description`."""
        return cast(Schema, msgspec.msgpack.decode(self.description))

    @cached_property
    def bytes_fields(self) -> tuple[str, ...]:
        """Names of the bytes fields."""
        return bytes_fields(self.cls)

    @cached_property
    def text_fields(self) -> tuple[str, ...]:
        """Names of the text fields."""
        return text_fields(self.cls)

    @property
    def steps(self) -> tuple[type[M], Callable[[M], bool], Callable[[M], bytes], Any]:
        """The native core's tools to publish: the class, its check, its encoder, its plan or None."""
        plan = self.plan
        return self.cls, self.is_valid if plan is None else self._check, self.encode, plan

    def _check(self, message: M) -> bool:
        """`is_valid`, which is made only at the first call: with a plan it is rarely needed."""
        return self.is_valid(message)

    def __repr__(self) -> str:
        return f"TypeSupport({self.name})"

    def encode_checked(self, message: M) -> bytes:
        """Check and encode a message, for callers outside the hot path. Raises MessageTypeError."""
        if (message.__class__ is not self.cls or not self.is_valid(message)) and (
            error := self.explain(message)
        ):
            raise error
        try:
            return bytes(self.encode(message))
        except ENCODE_ERRORS as error:
            raise self.explain(message) or error from None

    def explain(self, message: M) -> MessageTypeError | None:
        """The error that names the wrong field and its path, or None if the message is right after all."""
        if not isinstance(message, self.cls):
            return wrong_class(self.cls, message)
        try:
            data = self.encode(message)
        except ENCODE_ERRORS as error:
            return MessageTypeError(f"{self.name}: {error} - at `{_path_of(error, message)}`")
        try:
            decoded = self.decode(data)
        except msgspec.DecodeError as error:
            return MessageTypeError(f"{self.name}: {self._with_names(str(error))}")
        for path, found, expected in _mistaken(message, decoded):
            wanted = f"Expected `{type_name(expected)}`, got `{_full_name(found)}`"
            return MessageTypeError(f"{self.name}: {wanted} - at `{path}`")
        return None

    def _with_names(self, text: str) -> str:
        return re.sub(_PATH, lambda match: self._named_path(match[0]), text)

    def _named_path(self, path: str) -> str:
        """`$[0][2]` as `$.header.frame_id`: arrays of fields have no names on the wire."""
        named, node = "$", cast(Node, self.schema["root"])
        for step in re.finditer(_STEP, path):
            name, node = self._step(node, step)
            named += name
        return named

    def _step(self, node: Node, step: re.Match[str]) -> tuple[str, Node]:
        if isinstance(node, list) and node[0] == "union":
            members = [member for member in node[1:] if member not in ("none", "unset")]
            node = members[0] if len(members) == 1 else "any"
        index = int(step[1]) if step[1] else None
        if isinstance(node, str):
            described = self.schema["types"].get(node, {"fields": []})
            fields = described["fields"]
            if index is not None and described.get("array"):
                index -= described.get("tag") is not None
                fields = fields[index : index + 1]
            else:
                fields = [field for field in fields if field.get("key", field["name"]) == step[2]]
            return (f".{fields[0]['name']}", fields[0]["type"]) if fields else (step[0], "any")
        match node:
            case ["list", item, *_] | ["dict", _, item]:
                return step[0], item
            case ["tuple", *items] if index is not None and index < len(items):
                return step[0], items[index]
        return step[0], "any"


_supports: dict[type[Struct], TypeSupport[Any]] = {}


def type_support(cls: type[M]) -> TypeSupport[M]:
    """The TypeSupport of a message class, made once.

    Raises MessageTypeError if `cls` is no message class, ConfigurationError for a bad type name.
    """
    if not isinstance(cls, type) or getattr(cls, "__foreign__", False):
        return TypeSupport(cls)  # raises an error, or is for a short-lived class
    if (known := _supports.get(cls)) is not None:
        return known
    own = getattr(cls, "__type_support__", None)  # of a class that is no Struct, such as in bus_ros.rosidl
    return _supports.setdefault(cls, TypeSupport(cls) if own is None else own())


def type_hash(cls: type[Struct]) -> str:
    """ROS 2's hash of the type (`RIHS01_...`) if ROS 2 can describe it, else our own (`BUS01_...`)."""
    return hash_and_description(cls)[0]


def hash_and_description(cls: type[Struct]) -> tuple[str, bytes]:
    """The hash and description of a class. For classes of bus.msg both are precomputed.

    Raises as `type_support`.
    """
    if isinstance(cls, type) and cls.__module__.startswith("bus.msg."):
        from bus.msg._described import DESCRIBED

        known = DESCRIBED.get(type_name(cls))
    else:
        known = getattr(cls, "__dict__", {}).get("__described__")  # not inherited
    if known is not None:
        return known
    # Most programs only have messages of bus.msg.
    from bus.types.hash import schema_hash
    from bus.types.schema import describe

    schema = describe(cls)
    return schema_hash(schema), msgspec.msgpack.encode(schema)


def wrong_class(cls: type[Any], message: object) -> MessageTypeError:
    """The error for the publication of an object with a wrong class."""
    if cls is bytes:
        return MessageTypeError(f"expected an encoded message as bytes, got {_full_name(type(message))}")
    expected = f"{type_name(cls)}: expected a {_full_name(cls)}, got "
    if isinstance(message, type):
        return MessageTypeError(f"{expected}the class {message.__qualname__}; write {message.__name__}()")
    hint = ""
    fields: tuple[str, ...] = getattr(cls, "__struct_fields__", ())
    if len(fields) == 1 and not isinstance(message, Struct):
        hint = f"; write {cls.__name__}({fields[0]}=...)"
    return MessageTypeError(f"{expected}{_full_name(type(message))}{hint}")


def find_type(name: str) -> type[Struct] | None:
    """The class of `std_msgs/msg/String` (or `std_msgs/String`): ready-made, or made of its definition.

    None if there is neither. Raises ConfigurationError if the definition is malformed.
    """
    from bus.types.classes import find_class

    return find_class(name)


def _full_name(cls: type) -> str:
    return cls.__qualname__ if cls.__module__ == "builtins" else f"{cls.__module__}.{cls.__qualname__}"


def _path_of(error: Exception, value: object) -> str:
    """Path of the innermost part of `value` that can't be encoded; `error` is the encoder's error."""
    path = "$"
    # A value that contains itself has no innermost part.
    while not isinstance(error, RecursionError):
        for step, part in _parts(value):
            try:
                _encoder.encode(part)
            except ENCODE_ERRORS as inner:
                path, value, error = path + step, part, inner
                break
        else:
            break
    return path


def _parts(value: object) -> Iterator[tuple[str, object]]:
    if isinstance(value, Struct):
        for name in value.__struct_fields__:
            yield f".{name}", getattr(value, name, _Unset())
    elif isinstance(value, dict):
        for key, item in value.items():
            yield "[...]", key
            yield f"[{key!r:.40}]", item
    elif isinstance(value, list | tuple | set | frozenset):
        for index, item in enumerate(value):
            yield f"[{index}]", item


def _mistaken(value: object, decoded: object, path: str = "$") -> Iterator[tuple[str, type, type[Struct]]]:
    """Parts that have another class than the decoded one: a Point and a Vector3 are the same on the wire."""
    if isinstance(decoded, Struct) and not isinstance(value, type(decoded)):
        yield path, type(value), type(decoded)
    elif isinstance(decoded, Struct | list | tuple | dict):
        for (step, part), (_, decoded_part) in zip(_parts(value), _parts(decoded), strict=False):
            yield from _mistaken(part, decoded_part, path + step)


class _Unset:
    """Stands for a field that was deleted; the encoder refuses it."""
